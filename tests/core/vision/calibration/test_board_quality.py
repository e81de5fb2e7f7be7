import cv2
import numpy as np
import pytest
from perfanim.core.vision.calibration.board_quality import coverage, edge_widths
from perfanim.core.vision.calibration.calibration_board import Board, BoardView, find_board

BOARD = Board("chessboard", 7, 5, 0.03)
SQUARE = 40


@pytest.fixture(scope="module")
def sharp() -> np.ndarray:
    """A chessboard of 40-pixel squares with a white rim, as a lens of half a pixel's blur shows it."""
    rows, columns = np.indices(((BOARD.rows + 1) * SQUARE, (BOARD.columns + 1) * SQUARE))
    squares = np.where((rows // SQUARE + columns // SQUARE) % 2 == 0, 30, 210).astype(np.uint8)
    picture = cv2.copyMakeBorder(squares, SQUARE, SQUARE, SQUARE, SQUARE, cv2.BORDER_CONSTANT, value=(210,))
    return cv2.GaussianBlur(picture, (0, 0), 0.5)


def widths(picture: np.ndarray, sharp: np.ndarray) -> tuple[float, float]:
    view = find_board(sharp, BOARD)
    assert view is not None
    return edge_widths(picture, BOARD, view)


def test_sharp_edges_are_two_pixels_wide(sharp):
    assert max(widths(sharp, sharp)) < 2.5


def test_blur_widens_all_edges(sharp):
    # contrast over steepest slope of a step blurred by sigma: sqrt(2 pi) sigma
    blurred = cv2.GaussianBlur(sharp, (0, 0), 3.0)
    assert widths(blurred, sharp) == pytest.approx((7.5, 7.5), rel=0.15)


def test_motion_widens_the_edges_across_it(sharp):
    smeared = cv2.blur(sharp, (9, 1))
    across_rows, across_columns = widths(smeared, sharp)
    assert across_rows < 2.5
    assert across_columns == pytest.approx(9.0, abs=1.0)


def test_views_without_contrast_have_no_edge_widths(sharp):
    view = BoardView(np.array([0]), np.array([[80.0, 80.0]]))
    assert np.isnan(edge_widths(sharp, BOARD, view)).all()
    flat = np.full_like(sharp, 90)
    assert np.isnan(widths(flat, sharp)).all()


def square(x: float, y: float, side: float) -> BoardView:
    return BoardView(np.arange(4), np.array([[x, y], [x + side, y], [x + side, y + side], [x, y + side]]))


def test_coverage_is_the_share_of_the_image_where_the_board_was():
    middle = coverage([square(260.0, 180.0, 120.0)], (640, 480))
    assert middle.in_the_middle and middle.fraction == pytest.approx(120**2 / (640 * 480), rel=0.25)
    corners = [square(x, y, 200.0) for x in (0.0, 439.0) for y in (0.0, 279.0)]
    spread = coverage(corners, (640, 480))
    assert not spread.in_the_middle and spread.fraction == pytest.approx(4 * 200**2 / (640 * 480), rel=0.1)
    assert coverage([], (640, 480)).fraction == 0.0
