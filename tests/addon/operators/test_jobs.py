"""Long work behind the buttons: their jobs and what comes of them; the test plays the timer."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import cv2
import numpy as np
import pytest
from clicked import run_job
from motion_synthesis import perform
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.store import open_database
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.geometry.rig_file import load_rig, rig_tables
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject, load_subject, save_subject
from perfanim.core.simulate.studio.boards import DEFAULT_BOARD, board_on_floor, board_pictures
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.studio_rig import default_rig


@pytest.mark.usefixtures("near_worker")
def test_motion_is_imported_and_used(part: Any, tmp_path: Path) -> None:
    operator = part("operators.database_operators").PERFANIM_OT_build_database
    write_bvh(perform("walking", 3.0), tmp_path / "walk.bvh")
    (tmp_path / "broken.bvh").write_text("no motion")
    played = SimpleNamespace(
        files=[SimpleNamespace(name="walk.bvh"), SimpleNamespace(name="broken.bvh")],
        directory=str(tmp_path),
        filepath="",
        mirror=False,
        cull=False,
    )
    text = run_job(part, operator, played)
    chosen = bpy.context.scene.perfanim
    frames = part("settings.readiness").database_frames(chosen.database)
    assert text == f"{frames} frames imported, 1 file skipped"
    assert 170 <= frames <= 190
    assert part("settings.readiness").motion(chosen).text == f"{frames} frames"
    played.mirror = played.cull = True
    run_job(part, operator, played)
    mirrored = open_database(chosen.database)
    assert [clip.mirrored for clip in mirrored.clips][:2] == [False, True]
    assert mirrored.frames + mirrored.culled_frames == 2 * frames


@pytest.mark.usefixtures("near_worker")
def test_files_without_motion_are_an_error_and_leave_nothing(part: Any, errors: Any, tmp_path: Path) -> None:
    operator = part("operators.database_operators").PERFANIM_OT_build_database
    (tmp_path / "broken.bvh").write_text("no motion")
    played = SimpleNamespace(
        files=[SimpleNamespace(name="broken.bvh")], directory=str(tmp_path), filepath="", mirror=False, cull=False
    )
    with pytest.raises(errors.PerfanimError):
        run_job(part, operator, played)
    assert bpy.context.scene.perfanim.database == ""
    assert not list(part("preferences.paths").user_folder("databases").glob("*broken*"))
    played.files = [SimpleNamespace(name="missing.bvh")]
    with pytest.raises(errors.DatabaseError, match=r"missing\.bvh"):
        operator.arguments(played, bpy.context)


@pytest.mark.long
@pytest.mark.usefixtures("near_worker")
def test_cameras_are_calibrated_from_board_pictures(part: Any, errors: Any, tmp_path: Path) -> None:
    operator = part("operators.camera_operators").PERFANIM_OT_calibrate_cameras
    chosen = bpy.context.scene.perfanim
    chosen.source = "VIDEOS"
    assert not bpy.ops.perfanim.calibrate_cameras.poll()
    chosen.board_left, chosen.board_right = str(tmp_path / "left"), str(tmp_path / "right")
    chosen.board_columns, chosen.board_rows = DEFAULT_BOARD.columns, DEFAULT_BOARD.rows
    chosen.board_square_mm = DEFAULT_BOARD.square_m * 1000
    with pytest.raises(errors.CalibrationError, match="is not a folder"):
        operator.arguments(SimpleNamespace(), bpy.context)
    for picture in board_pictures(Renderer(default_rig()), DEFAULT_BOARD, 5):
        for side, image in zip(("left", "right"), picture.images, strict=True):
            (tmp_path / side).mkdir(exist_ok=True)
            assert cv2.imwrite(str(tmp_path / side / f"{picture.number:03d}.png"), image)
    text = run_job(part, operator, SimpleNamespace())
    assert "px" in text
    state = part("settings.readiness").cameras(
        SimpleNamespace(
            source="CAMERAS",
            follow="MARKERS",
            left_device=0,
            right_device=1,
            left_address="",
            right_address="",
            further_devices="",
            practise=False,
            calibration=chosen.calibration,
        )
    )
    assert state.ready
    assert "1.80 m" in state.text


def test_the_board_is_watched_with_all_chosen_cameras(part: Any, errors: Any) -> None:
    operator = part("operators.camera_operators").PERFANIM_OT_calibrate_board
    chosen = bpy.context.scene.perfanim
    chosen.source = "VIDEOS"
    assert not bpy.ops.perfanim.calibrate_board.poll()
    chosen.source = "CAMERAS"
    chosen.board_square_mm = 31.5
    asked = operator.request(SimpleNamespace(), bpy.context)
    assert asked.source.devices == (0, 1)
    assert asked.board == "chessboard:9x6:31.5mm"
    assert asked.every_s is None
    chosen.further_devices = "4, 2"
    assert operator.request(SimpleNamespace(), bpy.context).source.devices == (0, 1, 4, 2)
    for chosen.further_devices, problem in (("two", "not a device number or an address"), ("2 1", "chosen twice")):
        with pytest.raises(errors.CaptureError, match=problem):
            operator.request(SimpleNamespace(), bpy.context)
    chosen.right_device, chosen.board_timed, chosen.board_every_s = -1, True, 4.0
    asked = operator.request(SimpleNamespace(), bpy.context)
    assert asked.source.devices == (0,)
    assert asked.every_s == 4.0
    chosen.board_kind, chosen.board_code_mm, chosen.board_dictionary = "CHARUCO", 22.5, "DICT_5X5_100"
    assert operator.request(SimpleNamespace(), bpy.context).board == "charuco:9x6:31.5mm:22.5mm:DICT_5X5_100"


@pytest.mark.usefixtures("near_worker")
def test_the_board_is_written_to_be_printed(part: Any, tmp_path: Path) -> None:
    operator = part("operators.camera_operators").PERFANIM_OT_save_board
    chosen = bpy.context.scene.perfanim
    chosen.board_columns, chosen.board_square_mm = 10, 22.5
    asks = SimpleNamespace(scene=bpy.context.scene, window_manager=SimpleNamespace(fileselect_add=lambda asked: None))
    clicked = SimpleNamespace(filepath="", filename_ext=".pdf")
    operator.invoke(clicked, asks, None)
    assert clicked.filepath == "chessboard-10x6-22.5mm.pdf"
    for chosen.board_kind in ("CHESSBOARD", "CHARUCO"):
        target = tmp_path / f"{chosen.board_kind}.pdf"
        text = run_job(part, operator, SimpleNamespace(filepath=str(target)))
        assert text.startswith(f"print {target.name} on A4")
        assert target.read_bytes().startswith(b"%PDF")


def test_what_is_found_by_watching_is_used(part: Any, tmp_path: Path) -> None:
    """Each button asks for its job and takes over the result; the jobs themselves are tested where they are."""
    chosen, states = bpy.context.scene.perfanim, part("settings.readiness")
    chosen.practise, chosen.subject_name = True, "Zoë 2"
    assert "calibrate the cameras" in states.first_missing_step(chosen)
    assert not bpy.ops.perfanim.record_t_pose.poll()
    assert not bpy.ops.perfanim.set_floor.poll()
    cameras, subject = part("operators.camera_operators"), part("operators.subject_operators")
    clicked, found = SimpleNamespace(), {"rig": rig_tables(default_rig())}

    def end(operator: Any, board: str | None = None, **summary: Any) -> str:
        asked = operator.request(clicked, bpy.context)
        assert getattr(asked, "board", None) == board
        return str(operator.on_result(clicked, bpy.context, summary))

    pictures, covered = [str(tmp_path / side) for side in ("left", "right")], {"left": 0.8, "right": 0.75}
    measured = {"verdict": "good", "stereo_rms_px": 0.2, "advice": [], "used": 12}
    simulated = "chessboard:9x6:80mm"
    text = end(cameras.PERFANIM_OT_calibrate_board, simulated, **found, **measured, pictures=pictures, coverage=covered)
    assert text.startswith("good: 0.") and text.endswith("12 views, coverage 80 %, 75 %")
    assert [chosen.board_left, chosen.board_right] == pictures
    assert "calibrate the performer" in states.first_missing_step(chosen)
    performer = subject.PERFANIM_OT_calibrate_performer
    asked = performer.request(clicked, bpy.context)
    assert asked.poses == ("t", "hanging", "motorcycle") and Path(asked.subject_out).name == "Zoë-2.toml"
    save_subject(Subject("Zoë 2", default_skeleton(), load_marker_set("boxing"), 0.006), Path(asked.subject_out))
    result = {"out": asked.out, "subject": asked.subject_out, "verdict": "good", "residual_mm": 6.0, "advice": []}
    assert end(performer, **result) == "good: residual 6 mm"
    assert states.first_missing_step(chosen) == "" and chosen.subject_take == asked.out
    labels = [label for _, label, _ in subject._profiles(bpy.context)]
    assert labels == [f"Zoë-2: {states.performer(chosen).text}"]  # the file's name before the performer's
    text = end(cameras.PERFANIM_OT_set_floor, simulated, **found, scale=1.05)
    assert text.startswith("floor set at the board, origin at its centre; the board looks 5 % too large")
    assert Path(chosen.calibration).name == "cameras-on-floor.toml"
    text = end(cameras.PERFANIM_OT_set_floor_markers, **found, scale=1.0, markers=4)
    assert text.startswith("floor set at the 4 markers, origin at their centre")


@pytest.mark.long
def test_a_newcomer_calibrates_everything_in_the_sidebar(part: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Board pictures, cameras, the performer in three poses: with the simulated ones treated like real ones."""
    chosen, states = bpy.context.scene.perfanim, part("settings.readiness")
    chosen.practise = True
    assert "calibrate the cameras" in states.first_missing_step(chosen)
    assert not bpy.ops.perfanim.record_t_pose.poll()
    assert not bpy.ops.perfanim.set_floor.poll()
    cameras, subject = part("operators.camera_operators"), part("operators.subject_operators")
    text = run_job(part, cameras.PERFANIM_OT_calibrate_board, SimpleNamespace())
    assert text.startswith("good: 0.")
    assert "coverage" in text
    assert len(list(Path(chosen.board_left).glob("*.png"))) == len(list(Path(chosen.board_right).glob("*.png"))) >= 10
    assert "calibrate the performer" in states.first_missing_step(chosen)
    assert not bpy.ops.perfanim.use_profile.poll()
    chosen.subject_name = "Zoë 2"
    monkeypatch.setattr(subject, "TUNING", replace(subject.TUNING, held_s=1.25))
    text = run_job(part, subject.PERFANIM_OT_calibrate_performer, SimpleNamespace())
    assert text.startswith(("good: residual ", "usable: residual "))
    assert states.first_missing_step(chosen) == ""
    assert states.performer(chosen).text.startswith("Zoë 2, ")
    labels = [label for _, label, _ in subject._profiles(bpy.context)]
    assert labels == [f"Zoë-2: {states.performer(chosen).text}"]  # the file's name before the performer's
    # upright is where the performer's body points, who leans up to 3 degrees: 0.17 m at the cameras, 3.3 m away
    found, true = load_rig(chosen.calibration), default_rig()
    for camera, other in zip(found.cameras, true.cameras, strict=True):
        assert camera.centre_m[1] == pytest.approx(other.centre_m[1], abs=0.17)
        tilt = camera.rotation @ [0.0, 1.0, 0.0] @ (other.rotation @ [0.0, 1.0, 0.0])
        assert np.degrees(np.arccos(min(tilt, 1.0))) < 3.0
    performer = load_subject(chosen.subject)
    assert performer.name == "Zoë 2"
    lengths = [np.linalg.norm(s.offsets_m[1:], axis=1).sum() for s in (performer.skeleton, default_skeleton(1.75))]
    assert lengths[0] == pytest.approx(lengths[1], rel=0.05)
    assert part("capture.capture_request").cameras(chosen).rig.cameras[1].name == found.cameras[1].name

    text = run_job(part, cameras.PERFANIM_OT_set_floor, SimpleNamespace())
    assert text == "floor set at the board, origin at its centre"
    found = load_rig(chosen.calibration)
    _, before_m = board_on_floor()
    # corners known to 0.1 px are 1 mm off in depth; over 54 of them on 0.64 m x 0.4 m the floor tilts by 1 mrad,
    # which is 3 mm at the cameras; five times that
    for camera, other in zip(found.cameras, true.cameras, strict=True):
        assert camera.centre_m == pytest.approx(other.centre_m - [0.0, 0.0, before_m], abs=0.015)

    text = run_job(part, cameras.PERFANIM_OT_set_floor_markers, SimpleNamespace())
    assert text == "floor set at the 4 markers, origin at their centre"
    # centres known to 0.05 px are 1 mm off in depth; over four on 1 m x 0.6 m that is 6 mm at the cameras; times five
    for camera, other in zip(load_rig(chosen.calibration).cameras, true.cameras, strict=True):
        assert camera.centre_m[1] == pytest.approx(other.centre_m[1], abs=0.03)


def test_the_performer_hears_the_last_seconds_and_the_hold(part: Any) -> None:
    operators = part("operators.subject_operators")
    ready, hold = operators.PoseStage.GET_READY, operators.PoseStage.HOLD
    steps = [(ready, 4), (ready, 3), (ready, 3), (ready, 2), (ready, 1), (hold, 2), (hold, 1), (ready, 5)]
    cues = [None, *(operators.PoseCue(stage, left) for stage, left in steps)]
    heard = [operators.pitch(before, now) for before, now in pairwise(cues)]
    low, high, done = heard[1], heard[5], heard[7]
    assert heard == [None, low, None, low, low, high, None, done]
    assert len({low, high, done, None}) == 4
