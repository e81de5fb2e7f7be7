"""*Calibrate by Walking*: cameras from two recordings of a person, in Blender."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from clicked import run_job
from perfanim.core.geometry.rig_file import load_rig, rig_tables, save_rig
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.people.network_file import body_network_file


@pytest.fixture
def recorded(chosen: Any, tmp_path: Path) -> Any:
    """The settings with two recordings of a person, and a calibration by the board."""
    save_rig(default_rig(), tmp_path / "board.toml")
    chosen.source, chosen.follow, chosen.subject_height = "IMAGES", "PERSON", 1.8
    chosen.left_folder, chosen.right_folder = str(tmp_path / "left"), str(tmp_path / "right")
    chosen.calibration = str(tmp_path / "board.toml")
    return chosen


def test_the_recordings_the_height_and_the_board_s_lenses_are_used(part: Any, recorded: Any, tmp_path: Path) -> None:
    operator = part("operators.camera_operators").PERFANIM_OT_calibrate_walking
    given = operator.arguments(SimpleNamespace(), bpy.context)
    options = dict(zip(given[3::2], given[4::2], strict=True))
    assert given[:3] == ["calibrate", "cameras", "--by-walking"]
    assert options["--height"] == "1.800" and options["--lenses"] == recorded.calibration
    assert [options["--left"], options["--right"]] == [str(tmp_path / "left"), str(tmp_path / "right")]
    walked = load_rig(tmp_path / "board.toml")
    walked.metadata["by"] = "walking"  # its lenses were only estimated
    save_rig(walked, tmp_path / "walked.toml")
    recorded.calibration = str(tmp_path / "walked.toml")
    assert "--lenses" not in operator.arguments(SimpleNamespace(), bpy.context)


def test_the_guide_offers_it_for_recordings_of_a_person(part: Any, recorded: Any) -> None:
    steps = part("settings.guide_steps")
    (step,) = [each for each in steps.steps(recorded) if each.title == "Calibrate"]
    assert step.operator(recorded) == "calibrate_walking" and "height" in step.text(recorded)
    recorded.source = "SIMULATED"
    assert step.operator(recorded) == "calibrate_board"
    missing = part("operators.camera_operators").PERFANIM_OT_calibrate_walking.missing_input(bpy.context)
    assert missing.startswith("Needs cameras, videos or image folders")


def test_two_live_cameras_are_recorded_and_calibrated(part: Any, recorded: Any, tmp_path: Path) -> None:
    operator = part("operators.camera_operators").PERFANIM_OT_calibrate_walking
    (step,) = [each for each in part("settings.guide_steps").steps(recorded) if each.title == "Calibrate"]
    recorded.source, recorded.left_device, recorded.right_device = "CAMERAS", 0, 1
    assert step.operator(recorded) == "calibrate_walking" and "click, then walk about" in step.text(recorded)
    asked = operator.request(SimpleNamespace(), bpy.context)
    assert asked.job == "record walk" and asked.source.devices == (0, 1) and asked.height_m == pytest.approx(1.8)
    assert [camera.name for camera in asked.rig.cameras] == ["left", "right"]  # the board's lenses
    summary = {"rig": rig_tables(default_rig()), "verdict": "good", "stereo_rms_px": 1.0}
    assert operator.on_result(SimpleNamespace(), bpy.context, summary) == "good: 1.00 px"
    assert Path(recorded.calibration).name == "cameras-by-walking.toml" and len(load_rig(recorded.calibration)) == 2
    recorded.right_device = -1  # none
    assert operator.missing_input(bpy.context).startswith("Needs two cameras")
    assert step.operator(recorded) == "calibrate_board"


@pytest.mark.long
@pytest.mark.usefixtures("near_worker")
def test_two_films_of_a_man_on_a_beam_calibrate(part: Any, chosen: Any, shared_dir: Path) -> None:
    if not body_network_file().is_file():
        pytest.skip("the body network is not here: perfanim network get")
    films = shared_dir / "people" / "walk-on-beam"
    chosen.source, chosen.follow, chosen.subject_height = "VIDEOS", "PERSON", 1.72
    chosen.left_video, chosen.right_video = str(films / "cam01.mp4"), str(films / "cam04.mp4")
    text = run_job(part, part("operators.camera_operators").PERFANIM_OT_calibrate_walking, SimpleNamespace())
    assert text.startswith("redo: ") and "the recording shows 2 s of motion: 20 s or more are better" in text
    assert len(load_rig(chosen.calibration)) == 2 and part("settings.readiness").cameras(chosen).ready
