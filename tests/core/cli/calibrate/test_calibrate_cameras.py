import json

import cv2
import numpy as np
import pytest
from perfanim.core.cli.main import main
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.vision.calibration.calibration_board import charuco_board, parse_board

CHARUCO = "charuco:5x8:30mm:22mm:DICT_4X4_50"
SQUARE_PX = 80


def board_file(path, noise: float = 0.05, moments: int = 12):
    """Board points as two cameras 0.3 m apart, 700 px focal length, see them."""
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(np.arange(8) * 30.0, np.arange(6) * 30.0), axis=-1).reshape(-1, 2)
    views: list[list] = [[], []]
    for _ in range(moments):
        turn = rot.to_matrix(rot.from_rotation_vector(rng.uniform(-0.5, 0.5, 3)))
        flat = np.column_stack((grid - grid.mean(axis=0), np.zeros(len(grid))))
        points = flat @ turn.T + [rng.uniform(0, 300), rng.uniform(-100, 100), rng.uniform(800, 1200)]
        for view, shift in zip(views, (0.0, 300.0), strict=True):
            moved = points - [shift, 0, 0]
            pixels = moved[:, :2] / moved[:, 2:] * 700.0 + [320.0, 240.0]
            view.append((pixels + rng.normal(0, noise, pixels.shape)).tolist())
    content = {
        "image_size": [640, 480],
        "board_points_mm": grid.tolist(),
        "image_points_cam1": views[0],
        "image_points_cam2": views[1],
    }
    path.write_text(json.dumps(content))
    return path


def test_cameras_are_calibrated_from_board_points(tmp_path, capsys):
    out = tmp_path / "cameras.toml"
    points = board_file(tmp_path / "points.json")
    assert main(["calibrate", "cameras", "--points", str(points), "--out", str(out), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert {"stereo_rms_px", "rms_px", "baseline_mm", "used", "rejected", "verdict", "advice"} <= set(summary)
    assert summary["baseline_mm"] == pytest.approx(300.0, rel=5e-3)
    assert summary["used"] == 12
    rig = load_rig(out)
    assert rig.baseline_m() == pytest.approx(summary["baseline_mm"] / 1000)
    np.testing.assert_allclose(rig.cameras[1].centre_m, [0.3, 0.0, 0.0], atol=0.01)


@pytest.fixture(scope="module", params=["new", "old"])
def charuco_pictures(request, tmp_path_factory):
    """Return a folder of ten pairs of pictures of a ChArUco board, as two cameras 120 mm apart see it."""
    folder, rng = tmp_path_factory.mktemp("board"), np.random.default_rng(0)
    board = parse_board(CHARUCO)
    flat = charuco_board(board, request.param == "old").generateImage((5 * SQUARE_PX, 8 * SQUARE_PX))
    flat = cv2.copyMakeBorder(flat, *[SQUARE_PX] * 4, cv2.BORDER_CONSTANT, value=255)
    size_px = np.array(flat.shape[::-1])
    corners_px = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (size_px - 1)
    corners_m = np.column_stack((board.square_m / SQUARE_PX * (corners_px - 0.5 * (size_px - 1)), np.zeros(4)))
    for side in ("left", "right"):
        (folder / side).mkdir()
    for number in range(10):
        turn = rot.to_matrix(rot.from_rotation_vector(rng.uniform(-0.5, 0.5, 3)))
        points_m = corners_m @ turn.T + [rng.uniform(0.0, 0.12), rng.uniform(-0.05, 0.05), rng.uniform(0.55, 0.75)]
        for side, place_m in (("left", 0.0), ("right", 0.12)):
            seen = points_m - [place_m, 0.0, 0.0]
            pixels = seen[:, :2] / seen[:, 2:] * 700.0 + [319.5, 239.5]
            shown = cv2.getPerspectiveTransform(corners_px.astype(np.float32), pixels.astype(np.float32))
            picture = cv2.warpPerspective(flat, shown, (640, 480), flags=cv2.INTER_AREA, borderValue=90)
            cv2.imwrite(str(folder / side / f"{number}.png"), cv2.GaussianBlur(picture, (0, 0), 0.7))
    return folder


def test_charuco_boards_of_new_and_old_programs_calibrate_alike(charuco_pictures, tmp_path, capsys):
    sides = [text for side in ("left", "right") for text in (f"--{side}", f"{charuco_pictures}/{side}/*.png")]
    line = ["calibrate", "cameras", *sides, "--board", CHARUCO, "--out", str(tmp_path / "cameras.toml"), "--json"]
    assert main(line) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["used"] == 10 and told["baseline_mm"] == pytest.approx(120.0, abs=1.0)


def test_pictures_of_one_camera_twice_are_refused(charuco_pictures, tmp_path, capsys):
    cameras = [text for name in "ab" for text in ("--camera", f"{name}={charuco_pictures}/left/*.png")]
    line = ["calibrate", "cameras", *cameras, "--board", CHARUCO, "--out", str(tmp_path / "cameras.toml")]
    assert main(line) == 1
    assert "cameras a and b have the same pictures" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_videos_and_pictures_are_not_mixed(tmp_path, capsys):
    (tmp_path / "a.mp4").write_bytes(b"")
    arguments = ["--camera", f"a={tmp_path}/a.mp4", "--camera", "b=b/*.png", "--board", "chessboard:9x6:20mm"]
    assert main(["calibrate", "cameras", *arguments, "--out", str(tmp_path / "cameras.toml")]) == 1
    assert "a is a video, but b is not" in capsys.readouterr().err


def test_board_is_written_as_pdf(tmp_path, capsys):
    out = tmp_path / "board.pdf"
    assert main(["calibrate", "board", "--spec", "chessboard:9x6:24mm", "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["paper"] == "A4"
    assert out.read_bytes().startswith(b"%PDF")
