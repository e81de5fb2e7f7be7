"""What the panels say about good and bad settings."""

import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from motion_synthesis import perform
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.database.store import open_database
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.geometry.rig_file import save_rig
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject, load_subject, save_subject
from perfanim.core.simulate.studio.studio_rig import default_rig


@pytest.fixture
def states(part: Any) -> Any:
    return part("settings.readiness")


def test_the_defaults_are_ready(states: Any, chosen: Any) -> None:
    assert states.first_missing_step(chosen) == ""
    assert [step(chosen).ready for step in states.STEPS] == [True] * 5


def test_a_character_that_is_active_is_offered(states: Any, chosen: Any, new_character: Any) -> None:
    assert states.character(chosen).text == "new at start"
    hero = new_character(default_skeleton(), "Hero")
    assert states.character(chosen).text == "use Hero?"
    bpy.context.view_layer.objects.active = hero.children[0]  # as importers leave it
    assert states.character(chosen).text == "use Hero?"
    chosen.armature = hero
    assert states.character(chosen).text == "Hero"


def test_files_that_are_missing_or_bad_are_named(states: Any, chosen: Any, tmp_path: Path) -> None:
    chosen.source = "VIDEOS"
    assert "left camera" in states.first_missing_step(chosen)
    chosen.left_video = chosen.right_video = str(tmp_path / "no.mp4")
    assert "no.mp4: not found" in states.first_missing_step(chosen)
    video = tmp_path / "yes.mp4"
    video.touch()
    chosen.left_video = chosen.right_video = str(video)
    assert "calibrate the cameras" in states.first_missing_step(chosen)
    bad = tmp_path / "bad.toml"
    bad.write_text("this is not toml")
    chosen.calibration = str(bad)
    assert "bad.toml" in states.first_missing_step(chosen)
    save_rig(default_rig(), bad)
    assert "calibrate the performer" in states.first_missing_step(chosen)
    chosen.subject = str(bad)
    assert "not a subject" in states.first_missing_step(chosen)
    good = tmp_path / "anna.toml"
    save_subject(Subject("Anna", default_skeleton(), load_marker_set("boxing"), 0.006), good)
    chosen.subject = str(good)
    assert states.performer(chosen).text == "Anna, 6 mm"
    assert states.first_missing_step(chosen) == ""
    chosen.database = str(tmp_path / "none.pfdb")
    assert "none.pfdb" in states.first_missing_step(chosen)
    empty = tmp_path / "empty.pfdb"
    empty.touch()
    chosen.database = str(empty)
    assert "not a motion database" in states.first_missing_step(chosen)


@pytest.fixture
def database(tmp_path: Path) -> Path:
    write_bvh(perform("walking", 3.0), tmp_path / "walk.bvh")
    build_database([str(tmp_path / "walk.bvh")], tmp_path / "mine.pfdb", BuildSettings(fps=60.0))
    return tmp_path / "mine.pfdb"


def test_the_chosen_markers_must_be_the_subjects(
    states: Any, chosen: Any, part: Any, database: Path, tmp_path: Path
) -> None:
    chosen.database = str(database)
    setup = part("capture.capture_request")
    path = tmp_path / "anna.toml"
    save_subject(Subject("Anna", default_skeleton(), load_marker_set("locomotion"), 0.006), path)
    chosen.subject = str(path)
    chosen.marker_set = "boxing"
    problem = states.first_missing_step(chosen)
    assert problem.startswith(
        "Anna: calibrated with the marker set locomotion, which lacks head of boxing; choose locomotion as"
    )
    chosen.marker_set = "locomotion"
    assert states.first_missing_step(chosen) == ""
    # fewer markers than calibrated may be worn: the choice decides
    save_subject(Subject("Anna", default_skeleton(), load_marker_set("boxing"), 0.006), path)
    assert states.first_missing_step(chosen) == ""
    captured = setup.make(chosen).request.performers[0]
    assert captured.marker_set.names == load_marker_set("locomotion").names


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="looks at /proc")
def test_no_database_is_kept_open(states: Any, chosen: Any, database: Path) -> None:
    chosen.database = str(database)
    assert states.motion(chosen).ready
    assert "mine.pfdb" not in Path("/proc/self/maps").read_text()
    before = states.motion(chosen).text
    build_database([str(database.with_name("walk.bvh"))], database, BuildSettings(fps=30.0))
    assert states.motion(chosen).text != before


def test_an_armature_that_cannot_be_driven_says_why(states: Any, chosen: Any) -> None:
    armature = bpy.data.objects.new("Other", bpy.data.armatures.new("Other"))
    bpy.context.scene.collection.objects.link(armature)
    chosen.armature = armature
    assert "Other: the armature has no bones" in states.first_missing_step(chosen)
    assert len(armature.perfanim_character.joints) == 29  # to be chosen by hand
    assert states.character(chosen).text == "cannot be driven"
    bpy.context.scene.collection.objects.unlink(armature)
    assert states.character(chosen).text == "deleted"
    assert "Other: it was deleted from the scene" in states.first_missing_step(chosen)


def test_a_marker_set_of_the_users_own(states: Any, chosen: Any, tmp_path: Path) -> None:
    assert states.markers(chosen).text == "9 markers"
    chosen.marker_set_file = str(tmp_path / "mine.toml")
    assert "mine.toml" in states.first_missing_step(chosen)


def test_long_messages_are_cut_into_lines(part: Any) -> None:
    panels = part("panels.panel_drawing")
    text = "/a/very/long/path/" + "x" * 100 + " is not a motion database; build it again"
    lines = panels.wrapped(text, 32)
    assert all(len(line) <= 32 for line in lines)
    assert panels.wrapped("", 32) == []
    assert panels.wrapped("in /home/anna/animation/takes/walk_0001.bvh", 22) == [
        "in",
        "/home/anna/animation/",
        "takes/walk_0001.bvh",
    ]
    assert panels.wrapped("lower legs 10\u00a0% shorter (±\u00a012\u00a0%)\nagain", 30) == [
        "lower legs 10\u00a0% shorter",
        "(±\u00a012\u00a0%) again",
    ]
    assert "".join(lines).replace(" ", "") == text.replace(" ", "")


def test_a_state_does_not_lie_over_its_panel_s_name(part: Any) -> None:
    panels = part("panels.panel_drawing")
    assert panels.shortened("Anna, 6 mm", 21) == "Anna, 6 mm"
    assert panels.shortened("Simulated performer, average body", 21) == "Simulated performer…"
    assert len(panels.shortened("x" * 30, 21)) == 21


def names_of(rig: Any) -> list[str]:
    return [camera.name for camera in rig.cameras]


def test_the_left_camera_alone_captures_where_no_right_one_is_chosen(states: Any, chosen: Any, tmp_path: Path) -> None:
    setup = sys.modules[states.__name__.replace("settings.readiness", "capture.capture_request")]
    video = tmp_path / "left.mp4"
    video.touch()
    chosen.source, chosen.left_video = "VIDEOS", str(video)
    save_rig(default_rig(), tmp_path / "two.toml")
    chosen.calibration = str(tmp_path / "two.toml")
    assert states.cameras(chosen).text == "one camera"
    assert "use an average body" in states.performer(chosen).problem
    asked = setup.cameras(chosen)
    assert asked.source.paths == (str(video),)
    assert names_of(asked.rig) == ["left"]
    # a calibration of one camera leaves a right source out
    save_rig(CameraRig(default_rig().cameras[:1]), tmp_path / "one.toml")
    chosen.right_video, chosen.calibration = str(video), str(tmp_path / "one.toml")
    assert setup.cameras(chosen).source.paths == (str(video),)
    assert names_of(setup.cameras(chosen).rig) == ["left"]
    chosen.source, chosen.left_device, chosen.right_device = "CAMERAS", 3, -1
    chosen.calibration = str(tmp_path / "two.toml")
    assert setup.cameras(chosen).source.devices == (3,)
    chosen.right_device = 1
    assert setup.cameras(chosen).source.devices == (3, 1)
    assert names_of(setup.cameras(chosen).rig) == ["left", "right"]
    assert states.cameras(chosen).ready
    chosen.further_devices = "0 2"
    assert "calibrated for 2 cameras, but 4 are chosen" in states.cameras(chosen).problem
    chosen.further_devices = "-1"
    assert "not a device number or an address" in states.cameras(chosen).problem


def test_an_average_body_of_the_right_height_is_a_profile(states: Any, chosen: Any) -> None:
    chosen.subject_name, chosen.subject_height, chosen.marker_set = "Tall one", 1.9, "one-camera"
    assert bpy.ops.perfanim.average_performer("EXEC_DEFAULT") == {"FINISHED"}
    assert states.performer(chosen).text == "Tall one, average body"
    found = load_subject(chosen.subject)
    assert len(found.marker_set) == 14
    lengths = [np.linalg.norm(s.offsets_m, axis=1).sum() for s in (found.skeleton, default_skeleton(1.75))]
    assert lengths[0] / lengths[1] == pytest.approx(1.9 / 1.75)


def test_databases_with_the_old_suffix_are_opened(states: Any, chosen: Any, database: Path) -> None:
    old = states.user_folder("databases") / "starter.perfdb"
    old.write_bytes(database.read_bytes())
    assert states.starter_database_path() == states.database_path(chosen) == old
    assert states.motion(chosen).text == f"{open_database(database).frames} frames"
    new = old.with_suffix(".pfdb")
    new.write_bytes(database.read_bytes())
    assert states.starter_database_path() == new
    old.unlink()
    new.unlink()
    assert states.starter_database_path() == new
    chosen.database = str(database.rename(database.with_suffix(".perfdb")))
    assert states.motion(chosen).ready
