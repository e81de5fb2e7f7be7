"""A person without markers in Blender, without a window: two films, the real network, worker and take."""

from contextlib import closing
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from perfanim.core.api.solving import solve
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.geometry.rig_file import load_rig, save_rig
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject, save_subject
from perfanim.core.vision.people.network_file import body_network_file
from ticking import stop_and_keep, tick_poses

COUNT = 24
CAMERAS = (0, 3)  # 108 degrees apart


@pytest.fixture
def filmed(chosen: Any, shared_dir: Path, tmp_path: Path) -> Any:
    """The settings with two films of a person and their calibration."""
    if not body_network_file().is_file():
        pytest.skip("the body network is not here: perfanim network get")
    films = shared_dir / "people" / "walk-on-beam"
    rig = load_rig(films / "Calib.qca.txt")
    save_rig(CameraRig(tuple(rig.cameras[camera] for camera in CAMERAS), rig.metadata), tmp_path / "cameras.toml")
    chosen.source, chosen.follow, chosen.calibration = "VIDEOS", "PERSON", str(tmp_path / "cameras.toml")
    chosen.left_video, chosen.right_video = (str(films / f"cam0{camera + 1}.mp4") for camera in CAMERAS)
    return chosen


@pytest.mark.long
def test_two_films_of_a_person_drive_a_character_and_are_kept(part: Any, filmed: Any, new_capture: Any) -> None:
    assert part("settings.readiness").first_missing_step(filmed) == ""  # no markers, no calibration poses
    with closing(new_capture()) as capture:
        tick_poses(capture, COUNT)
        bone = filmed.armature.pose.bones["thigh.L"]
        assert not np.allclose(bone.rotation_quaternion, (1, 0, 0, 0))
        assert "frames recorded" in stop_and_keep(capture)
    (take_file,) = part("take_library").listed()
    take = read_take_file(take_file.path)
    assert take.complete and len(take.poses) == len(take.frames) >= COUNT
    assert take.setup.capture["people"] == str(body_network_file())
    assert all([len(rows) for rows in frame.detected] == [33, 33] for frame in take.frames)
    heights_m = [pose.pose.performers[0].root_position_m[1] for pose in take.poses]
    assert 1.0 < np.median(heights_m) < 1.6  # he balances on a beam
    again = solve(take)
    assert len(again.poses) == len(take.frames) and again.report["warnings"] == []


def test_the_performer_is_a_body_of_the_typed_height_or_has_measured_bones(
    part: Any, filmed: Any, tmp_path: Path
) -> None:
    readiness = part("settings.readiness")
    filmed.subject_height = 1.6
    subject = readiness.worn_subject(filmed)
    assert subject.marker_set.name == "blazepose-33"
    np.testing.assert_allclose(subject.skeleton.offsets_m, default_skeleton(1.6).offsets_m)
    assert readiness.performer(filmed).text == "1.60 m, average body"
    measured = Subject("Anna", default_skeleton(1.7), load_marker_set("boxing"), 0.006)
    save_subject(measured, tmp_path / "anna.toml")
    filmed.subject = str(tmp_path / "anna.toml")
    subject = readiness.worn_subject(filmed)
    assert (subject.name, subject.marker_set.name) == ("Anna", "blazepose-33")
    np.testing.assert_allclose(subject.skeleton.offsets_m, default_skeleton(1.7).offsets_m)
    assert readiness.first_missing_step(filmed) == ""


def test_one_camera_is_enough(part: Any, filmed: Any) -> None:
    readiness = part("settings.readiness")
    filmed.right_video = ""
    assert readiness.first_missing_step(filmed) == ""
    assert readiness.cameras(filmed).text == "one camera"


def test_other_performers_and_props_are_refused(part: Any, filmed: Any, targets: Any) -> None:
    target_settings = part("settings.target_settings")
    for kind, text in (("PROP", "props are found by their markers"), ("PERFORMER", "only one person is followed")):
        targets.entries.clear()
        entry = targets.entries.add()
        entry.kind = kind
        if kind == "PERFORMER":
            save_subject(
                Subject("Ben", default_skeleton(), load_marker_set("boxing")), Path(bpy.app.tempdir) / "ben.toml"
            )
            entry.subject = str(Path(bpy.app.tempdir) / "ben.toml")
        assert text in target_settings.problem(bpy.context.scene)


def test_the_guide_has_steps_for_a_person(part: Any, filmed: Any, tmp_path: Path) -> None:
    guide = part("settings.guide_steps")
    titles = [step.title for step in guide.steps(filmed)]
    assert titles == [
        "Cameras", "Body Network", "Calibrate", "Person", "Floor", "Performer", "Database", "Character", "Capture",
    ]  # fmt: skip
    _, step, _ = guide.next_step(filmed)
    assert (step.title, step.operator(filmed)) == ("Person", "check_setup")
    guide.keep_check(filmed, {"findings": [], "space": ""})
    assert guide.next_step(filmed)[1].title == "Floor"
    bpy.ops.perfanim.skip_step()
    assert guide.next_step(filmed)[1].title == "Capture"
    filmed.follow = "MARKERS"
    assert [step.title for step in guide.steps(filmed)][1] == "Exposure"
    assert guide.next_step(filmed)[1].title == "Exposure"  # the check of a person says nothing about markers
