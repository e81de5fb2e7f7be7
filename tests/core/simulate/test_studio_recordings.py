"""Simulated boards, the simulated performer as a source, and recordings on disk."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from perfanim.core.body.calibration_poses import motorcycle, t_pose
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.cli.main import build_parser
from perfanim.core.errors import CaptureError, PerfanimError, SettingsError
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.markers.marker_take import load_take
from perfanim.core.markers.subject import load_subject
from perfanim.core.simulate.studio import export_recording as export
from perfanim.core.simulate.studio.boards import DEFAULT_BOARD, BoardPicture, board_pictures
from perfanim.core.simulate.studio.lens import undistorted_grid
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.simulated_source import open_simulated, simulated_source, with_return
from perfanim.core.simulate.studio.stage_placement import lowest_point_m, on_stage, with_poses
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.simulate.studio.studio_settings import StudioSettings
from perfanim.core.vision.calibration.calibration_board import find_board, parse_board

FPS = 60.0
QUIET = StudioSettings(noise_sigma=0.0, clutter=False)


def test_rig_sees_the_stage() -> None:
    rig = default_rig()
    assert rig.baseline_m() == pytest.approx(1.8)
    left, right = rig.cameras
    assert left.centre_m[0] < 0.0 < right.centre_m[0] and left.centre_m[2] > 3.0
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (0.0, 2.1) for z in (-0.5, 0.5)])
    for camera in (*rig.cameras, *default_rig(4).cameras):
        pixels = camera.project(corners)
        assert np.all((pixels > 0.0) & (pixels < camera.image_size))
    assert left.project([0.3, 1.0, 0.0])[0] > left.project([-0.3, 1.0, 0.0])[0]
    with pytest.raises(SettingsError):
        default_rig(0)


def test_grid_of_undistorted_pixels_is_exact() -> None:
    camera = default_rig().cameras[0]
    xs, ys = np.arange(100.0, 171.5, 0.5), np.arange(0.0, 50.0, 0.5)
    exact = camera.undistort(np.stack(np.meshgrid(xs, ys), -1))
    assert np.abs(undistorted_grid(camera, xs, ys) - exact).max() * camera.focal_px < 1e-4


@pytest.fixture(scope="module")
def pictures() -> list[BoardPicture]:
    return list(board_pictures(Renderer(default_rig()), count=16))


@pytest.mark.long
def test_boards_calibrate_the_cameras(pictures: list[BoardPicture]) -> None:
    rig = default_rig()
    points, found = [], ([], [])
    for picture in pictures:
        corners = []
        for image, truth in zip(picture.images, picture.corners, strict=True):
            grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
            ok, seen = cv2.findChessboardCornersSB(grey, (9, 6), None, cv2.CALIB_CB_ACCURACY)
            if not ok:
                break
            seen = seen[:, 0] if np.linalg.norm(seen[0, 0] - truth[0]) < 30.0 else seen[::-1, 0]
            assert np.sqrt(np.mean((seen - truth) ** 2)) < 0.25
            corners.append(seen.astype(np.float32))
        if len(corners) == 2:
            points.append(DEFAULT_BOARD.points_m.astype(np.float32))
            found[0].append(corners[0])
            found[1].append(corners[1])
    assert len(points) >= 14
    solved = [cv2.calibrateCamera(points, views, (640, 480), None, None)[1:3] for views in found]
    stereo = cv2.stereoCalibrate(points, *found, *solved[0], *solved[1], (640, 480), flags=cv2.CALIB_FIX_INTRINSIC)
    assert stereo[0] < 0.25
    assert np.linalg.norm(stereo[6]) == pytest.approx(rig.baseline_m(), rel=0.01)
    for (matrix, _), camera in zip(solved, rig.cameras, strict=True):
        assert matrix[0, 0] == pytest.approx(camera.matrix[0, 0], rel=0.01)
        assert matrix[:2, 2] == pytest.approx(camera.matrix[:2, 2], abs=10.0)


def test_boards_with_codes_are_found_where_they_are() -> None:
    board = parse_board("charuco:7x5:100mm:75mm:DICT_4X4_50")
    found = []
    for picture in board_pictures(Renderer(default_rig()), board, 4):
        for image, corners in zip(picture.images, picture.corners, strict=True):
            view = find_board(image, board)
            if view is not None:
                found.append(view.pixels - corners[view.ids])
    errors = np.concatenate(found)
    assert len(found) >= 6
    # corners are known to about a tenth of a pixel at two grey levels of noise, and a wrong number is a square off
    assert np.sqrt(np.mean(errors**2)) < 0.15
    assert np.abs(errors).max() < 1.0


def test_boards_cover_both_images(pictures: list[BoardPicture]) -> None:
    corners = np.array([picture.corners for picture in pictures])
    for camera in range(2):
        span = corners[:, camera].reshape(-1, 2)
        assert np.all(span.min(axis=0) > 0.0) and np.all(span.max(axis=0) < [640.0, 480.0])
        assert np.all(np.ptp(span, axis=0) > [450.0, 330.0])


# --- the source


def test_source_gives_every_frame_with_its_truth(scene: Any) -> None:
    source = simulated_source(scene.swinging(12), "boxing", Renderer(default_rig()), fps=FPS)
    frames = list(source)
    assert [frame.number for frame in frames] == list(range(source.frames)) == list(range(12))
    for frame in frames[::5]:
        again = source.frame(frame.number).truth
        np.testing.assert_array_equal(again.pixels, frame.truth.pixels)
        np.testing.assert_array_equal(again.visible, frame.truth.visible)
        np.testing.assert_array_equal(again.markers_m, source.performance.markers_m[frame.number])
        assert frame.times_s == (frame.number / FPS, frame.number / FPS)
    rooms = list(source.background_frames(3))
    assert len(rooms) == 3 and len(rooms[0]) == 2
    difference = np.abs(rooms[0][0].astype(int) - source.renderer._empty[0])
    assert difference.mean() < 3.0


def test_source_between_the_motions_frames_is_smooth(scene: Any) -> None:
    performance = scene.performed(scene.swinging(30))
    at = performance.markers_at(np.arange(0.0, 29.0, 0.25) / FPS)
    jumps = np.linalg.norm(np.diff(at, axis=0), axis=2)
    steps = np.linalg.norm(np.diff(performance.markers_m, axis=0), axis=2).max()
    assert jumps.max() < 0.3 * steps
    np.testing.assert_allclose(performance.markers_at([99.0])[0], performance.markers_m[-1])


def test_late_frames_are_left_out_live(scene: Any) -> None:
    # 20,000 images a second cannot be drawn, so the clock runs ahead
    source = simulated_source(scene.swinging(40), "boxing", Renderer(default_rig(), QUIET), fps=20000.0, loop=True)
    source.live = True
    numbers = []
    for frame in source:
        numbers.append(frame.number)
        if len(numbers) == 5:
            source.close()
    assert numbers == sorted(set(numbers)) and len(numbers) == 5
    assert source.dropped >= numbers[-1] - len(numbers) > 0


def test_performer_starts_again_smoothly(scene: Any) -> None:
    motion = scene.swinging(37)
    again = with_return(motion)
    np.testing.assert_array_equal(again.rotations[:37], motion.rotations)
    whole = np.concatenate((again.rotations, again.rotations[:1]))
    assert rot.angle_between(whole[:-1], whole[1:]).max() < 0.15
    source = simulated_source(motion, "boxing", Renderer(default_rig(), QUIET), loop=True)
    period = source.motion.frames
    np.testing.assert_allclose(source.frame(period).truth.markers_m, source.frame(0).truth.markers_m, atol=1e-9)
    assert source.frame(period).times_s[0] == pytest.approx(period / FPS)


def test_simulated_performer_by_name() -> None:
    source = open_simulated({"kind": "simulated", "behaviour": "walk", "seconds": 3, "studio": {"noise_sigma": 0.0}})
    assert source.renderer.settings.noise_sigma == 0.0
    assert source.motion.duration_s > 3.0
    assert source.frame(0).truth.visible.all(), "the T pose at the start shows all markers"
    assert source.subject.marker_set.names == source.performance.marker_names
    for spec, text in (
        ({"behaviour": "swim"}, "swim"),
        ({"speed": 2}, "speed"),
        ({"behaviour": "run", "style": "x"}, "has an unknown key 'style'"),
    ):
        with pytest.raises(SettingsError, match=text):
            open_simulated(spec)


# --- recordings on disk


def test_motion_is_brought_before_the_cameras(scene: Any) -> None:
    motion = scene.swinging(20, turn=2.0)
    moved = replace(motion, root_positions_m=motion.root_positions_m + np.array([3.0, 0.7, -5.0]))
    staged = on_stage(moved)
    forward = rot.rotate(staged.rotations[0, 0], [0.0, 0.0, 1.0])
    np.testing.assert_allclose(forward, [0.0, 0.0, 1.0], atol=1e-9)
    assert lowest_point_m(staged) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(staged.root_positions_m[:, [0, 2]], 0.0, atol=1e-9)
    whole = with_poses(staged, ("t",), 0.5)
    assert whole.frames == 30 + 59 + 20
    hands = scene.performed(whole).markers_m[0, 5:7]
    assert np.ptp(hands[:, 1]) < 0.01 and np.ptp(hands[:, 0]) > 1.3
    assert rot.angle_between(whole.rotations[:-1], whole.rotations[1:]).max() < 0.2
    assert with_poses(staged, ("t",), 0.0) is staged


def test_poses_are_held_one_after_the_other_on_the_floor(scene: Any) -> None:
    staged = on_stage(scene.swinging(20))
    whole = with_poses(staged, ("t", "motorcycle"), 0.5)
    assert whole.frames == 2 * (30 + 59) + 20
    for start, pose in ((0, t_pose), (89, motorcycle)):
        held = sliced(whole, start, start + 30)
        np.testing.assert_array_equal(held.rotations[:, 1:], np.tile(pose(staged.skeleton)[1:], (30, 1, 1)))
        assert lowest_point_m(held) == pytest.approx(0.0, abs=1e-9)
    assert rot.angle_between(whole.rotations[:-1], whole.rotations[1:]).max() < 0.2
    np.testing.assert_array_equal(whole.rotations[-20:], staged.rotations)


def record(scene: Any, out: Path, tmp_path: Path, *options: str) -> dict[str, Any]:
    """Run the command on a short motion and return its summary."""
    path = tmp_path / "swinging.bvh"
    write_bvh(scene.swinging(9), path)
    fixed = ["--t-pose", "0", "--background", "2", "--board-views", "2", "--exposure-ms", "0"]
    arguments = ["simulate", "cameras", str(path), "--out", str(out), *fixed, *options]
    args = build_parser(("simulate",)).parse_args(arguments)
    shares: list[float] = []
    summary: dict[str, Any] = args.run(args, lambda share, _text: shares.append(share))
    assert shares == sorted(shares) and 0.9 < shares[-1] <= 1.0
    return summary


def test_recording_holds_images_and_truth(scene: Any, tmp_path: Path) -> None:
    out = tmp_path / "recording"
    summary = record(scene, out, tmp_path, "--seed", "5")
    assert summary["frames"] == 9 and summary["cameras"] == ["left", "right"] and summary["board_views"] == 2
    truth = out / "truth"
    rig = load_rig(truth / "cameras.toml")
    for ours, theirs in zip(rig.cameras, default_rig().cameras, strict=True):
        np.testing.assert_allclose(ours.project([0.1, 1.0, 0.2]), theirs.project([0.1, 1.0, 0.2]), atol=1e-6)
    take, subject = load_take(truth / "markers.take.npz"), load_subject(truth / "subject.toml")
    assert take.frames == 9 and take.names == subject.marker_set.names
    motion = read_motion(truth / "motion.bvh")
    again = scene.performed(Motion("again", FPS, subject.skeleton, motion.rotations, motion.root_positions_m))
    np.testing.assert_allclose(again.markers_m, take.positions_m, atol=1e-4)
    with np.load(truth / "image_truth.npz") as arrays:
        np.testing.assert_allclose(arrays["pixels"][:, 1], rig.cameras[1].project(take.positions_m), atol=1e-4)
        assert arrays["visible"].shape == (9, 2, 9)
    assert sorted(p.name for p in (out / "board" / "right").iterdir()) == ["000.png", "001.png"]
    _check_videos(out, rig)


def test_truth_tells_how_late_a_camera_is(scene: Any, tmp_path: Path) -> None:
    out = tmp_path / "recording"
    summary = record(scene, out, tmp_path, "--time-offset-ms", "0", "6")
    assert summary["time_offsets_ms"] == [0.0, 6.0]
    motion = read_motion(out / "truth" / "motion.bvh")
    performed = scene.performed(motion)
    with np.load(out / "truth" / "image_truth.npz") as arrays:
        np.testing.assert_array_equal(arrays["time_offsets_s"], [0.0, 0.006])
        late = (
            load_rig(out / "truth" / "cameras.toml").cameras[1].project(performed.markers_at(arrays["times_s"] + 0.006))
        )
        np.testing.assert_allclose(arrays["pixels"][:, 1], late, atol=1e-3)


def _check_videos(out: Path, rig: CameraRig) -> None:
    """Every grey level that the cameras took must come back from the lossless videos."""
    motion = read_motion(out / "truth" / "motion.bvh")
    source = simulated_source(motion, "boxing", Renderer(rig, StudioSettings(seed=5)))
    room = next(iter(source.background_frames(1)))
    for i, camera in enumerate(rig.cameras):
        reader = cv2.VideoCapture(str(out / f"{camera.name}.mkv"))
        images = [image for ok, image in iter(reader.read, (False, None)) if ok]
        assert len(images) == 9
        exact = (np.abs(images[4].astype(int) - source.frame(4).images[i]) <= 1).mean()
        assert exact > 0.999  # the BVH's last decimals may turn a pixel on the body's rim
        background = cv2.VideoCapture(str(out / "background" / f"{camera.name}.mkv"))
        np.testing.assert_array_equal(background.read()[1], room[i])


def test_bad_recordings_leave_nothing_behind(scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "recording"
    wrong = {"--cameras": "20", "--noise": "-1", "--marker-set": "nothing", "--fps": "0", "--background": "-3"}
    for option, value in wrong.items():
        with pytest.raises(PerfanimError):
            record(scene, out, tmp_path, option, value)

    def full_disk(*_arguments: object) -> None:
        raise CaptureError("no space")

    monkeypatch.setattr(export, "_write_truth", full_disk)
    with pytest.raises(CaptureError, match="no space"):
        record(scene, out, tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["swinging.bvh"]
    out.mkdir()
    (out / "precious").write_text("x")
    with pytest.raises(CaptureError, match="not an empty folder"):
        record(scene, out, tmp_path)
    assert (out / "precious").read_text() == "x"
