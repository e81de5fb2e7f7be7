"""Calibration on chessboard pictures taken by others."""

import shutil

import numpy as np
import pytest
from perfanim.core.errors import CalibrationError
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.vision.calibration.calibrate_images import calibrate_images
from perfanim.core.vision.calibration.calibrate_videos import calibrate_videos
from perfanim.core.vision.calibration.calibration_board import parse_board


def silent(fraction: float, text: str) -> None:
    assert 0.0 <= fraction <= 1.0 and text


@pytest.mark.long
def test_opencv_sample_set(shared_dir):
    folder = shared_dir / "stereo" / "opencv-9x6"
    patterns = {"left": f"{folder}/left*.jpg", "right": f"{folder}/right*.jpg"}
    result = calibrate_images(patterns, parse_board("chessboard:9x6:1"), silent)
    assert len(result.used) >= 13
    assert result.stereo_rms_px <= 0.27
    assert result.baseline_m * 1000 == pytest.approx(3.33, abs=0.02)  # in squares
    assert result.rig.cameras[0].matrix[0, 0] == pytest.approx(532.8, abs=2.0)
    assert result.verdict == "good"


@pytest.mark.long
def test_charuco_set_of_four_cameras(shared_dir):
    folder = shared_dir / "stereo" / "charuco-4-cameras"
    videos = {f"cam_{i}": str(folder / "calibration" / "extrinsic" / f"cam_{i}.mp4") for i in range(4)}
    board = parse_board("charuco:4x5:54mm:40.5mm:DICT_4X4_1000:inverted")
    result = calibrate_videos(videos, board, silent, left_right=False)
    # one board pose for all cameras explains each picture as well as the worst camera explains its own
    assert result.stereo_rms_px <= max(result.rms_px.values())
    assert result.late_s["cam_1"] < -0.05  # its frames show the board a good half of a frame before the others' do
    assert result.verdict == "usable" and any("at the same time" in line for line in result.advice)
    solved = load_rig(folder / "camera_array.toml")
    ratios = [result.rig.baseline_m(i, j) / solved.baseline_m(i, j) for i in range(4) for j in range(i)]
    # The solved reference takes frames of one number for one time, and corners from windows that reach into the
    # markers. Either moves its own distances by up to 2 %: nothing closer is to be told from it.
    np.testing.assert_allclose(ratios, 1.0, atol=0.02)


@pytest.mark.long
def test_sourishg_set(shared_dir):
    folder = shared_dir / "stereo" / "sourishg-9x6" / "calib_imgs" / "1"
    patterns = {"left": f"{folder}/left*.jpg", "right": f"{folder}/right*.jpg"}
    result = calibrate_images(patterns, parse_board("chessboard:9x6:24.23mm"), silent)
    assert result.baseline_m * 1000 == pytest.approx(94.0, abs=1.0)
    assert result.stereo_rms_px < 0.3
    assert len(result.used) >= 25


def copied(shared_dir, folder, numbers):
    """Copy pairs of the OpenCV set to a folder that may be written to, and return it."""
    for number in numbers:
        for side in ("left", "right"):
            shutil.copy(shared_dir / "stereo" / "opencv-9x6" / f"{side}{number:02d}.jpg", folder)
    return folder


@pytest.fixture
def few(shared_dir, tmp_path):
    """Three pairs, as many as a calibration needs."""
    return copied(shared_dir, tmp_path, (1, 6, 8))


def patterns_in(folder) -> dict[str, str]:
    return {"left": f"{folder}/left*.jpg", "right": f"{folder}/right*.jpg"}


@pytest.mark.parametrize("wrong", ["8x6", *(pytest.param(size, marks=pytest.mark.long) for size in ("10x7", "6x5"))])
def test_error_of_a_wrong_board_size_names_the_right_one(few, wrong):
    with pytest.raises(CalibrationError, match=f"9x6 inner corners, not {wrong}"):
        calibrate_images(patterns_in(few), parse_board(f"chessboard:{wrong}:24mm"), silent)


@pytest.mark.long
def test_unreadable_and_unpaired_pictures_are_rejected_with_reasons(few, shared_dir):
    copied(shared_dir, few, (4, 13))
    (few / "left04.jpg").write_bytes(b"no picture")
    (few / "right13.jpg").unlink()
    result = calibrate_images(patterns_in(few), parse_board("chessboard:9x6:24mm"), silent)
    reasons = {row.picture: row.reason for row in result.rejected}
    assert reasons == {
        "left04.jpg": "is not a readable image (not a picture)",
        "left13.jpg": "no picture of the other camera has its number",
    }
    assert len(result.used) == 3


def test_all_pictures_unreadable_is_an_error(few):
    for path in few.glob("left*.jpg"):
        path.write_bytes(b"")
    with pytest.raises(CalibrationError, match=r"camera left.*none of the pictures can be read"):
        calibrate_images(patterns_in(few), parse_board("chessboard:9x6:24mm"), silent)


@pytest.mark.long
def test_exchanged_folders_and_missing_files_are_errors(few):
    swapped = {"left": f"{few}/right*.jpg", "right": f"{few}/left*.jpg"}
    with pytest.raises(CalibrationError, match="exchange"):
        calibrate_images(swapped, parse_board("chessboard:9x6:24mm"), silent)
    with pytest.raises(CalibrationError, match="no image files"):
        calibrate_images(
            {"left": f"{few}/x*.jpg", "right": f"{few}/y*.jpg"}, parse_board("chessboard:9x6:24mm"), silent
        )
