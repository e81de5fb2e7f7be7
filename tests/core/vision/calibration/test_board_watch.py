from collections.abc import Iterator, Sequence

import cv2
import numpy as np
import pytest
from perfanim.core.vision.calibration.board_watch import BoardWatch, placement_of
from perfanim.core.vision.calibration.calibration_board import Board, BoardView, parse_board

BOARD = parse_board("chessboard:9x6:24mm")
CORNERS = BOARD.points_m[:, :2] * 5000.0 + 40.0  # pixels
RATE_HZ = 10.0


def view(shift_px: Sequence[float] = (0.0, 0.0), turned: bool = False) -> BoardView:
    seen = BoardView(np.arange(len(CORNERS)), CORNERS + np.array(shift_px))
    return seen.reverse() if turned else seen


def stills(moments: Sequence[Sequence[BoardView | None]], width: int = 640, unusable: int = -1) -> list[bool]:
    """For each moment, with one view per camera: whether the board is held to be still."""
    rows: Iterator[BoardView | None] = iter([found for moment in moments for found in moment])
    watch = BoardWatch(BOARD, lambda _image, _board: next(rows))
    images = [np.zeros((width * 3 // 4, width, 3), np.uint8)] * len(moments[0])
    return [
        watch.see(number / RATE_HZ, images, [number != unusable] * len(images)).still for number in range(len(moments))
    ]


def test_board_is_still_after_half_a_second() -> None:
    noise = np.random.default_rng(0).normal(scale=0.3, size=(9, 2, 2))  # of corners found in a reduced image
    found = stills([[view(a), view(b)] for a, b in noise])
    assert found == [False] * 5 + [True] * 4


def test_a_board_that_moves_before_one_camera_is_not_still() -> None:
    assert not any(stills([[view(), view((1.5 * number, 0.0))] for number in range(9)]))
    stopped = [[view(), view((max(0.0, 30.0 - 10.0 * number), 0.0))] for number in range(10)]
    assert stills(stopped) == [False] * 8 + [True] * 2  # it stops at the fourth


def test_limit_of_motion_scales_with_the_image_width() -> None:
    swaying = [[view((3.0 * (number % 2), 0.0))] for number in range(9)]
    assert not any(stills(swaying, 640))
    assert stills(swaying, 1280)[-1]


def test_a_board_numbered_from_the_other_end_has_not_moved() -> None:
    assert stills([[view(turned=number % 2 == 1)] for number in range(9)])[-1]


def test_lost_board_must_be_still_again() -> None:
    assert stills([[view()]] * 6 + [[None]] + [[view()]] * 6) == [False] * 5 + [True] + [False] * 6 + [True]
    seen = stills([[view()]] * 13, unusable=6)
    assert seen == [False] * 5 + [True] + [False] * 6 + [True]


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0, -45.0])
def test_place_size_and_tilt_of_a_view(tilt_deg: float) -> None:
    board = Board("chessboard", 9, 6, 0.03)
    size = (640, 480)
    matrix = np.array([[0.9 * 640, 0.0, 319.5], [0.0, 0.9 * 640, 239.5], [0.0, 0.0, 1.0]])
    turn = cv2.Rodrigues(np.radians([0.0, tilt_deg, 0.0]))[0]
    centre = board.points_m.mean(axis=0)
    middle = np.array([0.1, -0.05, 0.8])
    local = (board.points_m - centre) @ turn.T + middle
    pixels = (local / local[:, 2:]) @ matrix[:2].T
    place = placement_of(BoardView(np.arange(54), pixels), board, size)
    np.testing.assert_allclose(place.centre, pixels.mean(axis=0) / 640 - np.array([319.5, 239.5]) / 640, atol=1e-9)
    np.testing.assert_allclose(place.normal, turn[:, 2], atol=1e-6)
    guidance = middle / np.linalg.norm(middle)  # the corners' mean is not quite the middle's image
    assert place.tilt_rad == pytest.approx(np.arccos(abs(turn[:, 2] @ guidance)), abs=0.02)
    facing = 0.9 * np.sqrt(0.24 * 0.15) / 0.8
    assert place.size == pytest.approx(facing * np.sqrt(np.cos(np.radians(tilt_deg))), rel=0.15)
