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


@pytest.fixture(scope="module")
def view(sharp: np.ndarray) -> BoardView:
    found = find_board(sharp, BOARD)
    assert found is not None
    return found


def test_blur_widens_all_edges_and_motion_those_across_it(sharp, view):
    assert max(edge_widths(sharp, BOARD, view)) < 2.5
    # contrast over steepest slope of a step blurred by sigma: sqrt(2 pi) sigma
    assert edge_widths(cv2.GaussianBlur(sharp, (0, 0), 3.0), BOARD, view) == pytest.approx((7.5, 7.5), rel=0.15)
    across_rows, across_columns = edge_widths(cv2.blur(sharp, (9, 1)), BOARD, view)
    assert across_rows < 2.5
    assert across_columns == pytest.approx(9.0, abs=1.0)


def test_views_without_contrast_have_no_edge_widths(sharp, view):
    corner = BoardView(np.array([0]), np.array([[80.0, 80.0]]))
    assert np.isnan(edge_widths(sharp, BOARD, corner)).all()
    assert np.isnan(edge_widths(np.full_like(sharp, 90), BOARD, view)).all()


def square(x: float, y: float, side: float) -> BoardView:
    return BoardView(np.arange(4), np.array([[x, y], [x + side, y], [x + side, y + side], [x, y + side]]))


def test_coverage_is_the_share_of_the_image_where_the_board_was():
    middle = coverage([square(260.0, 180.0, 120.0)], (640, 480))
    assert middle.in_the_middle and middle.fraction == pytest.approx(120**2 / (640 * 480), rel=0.25)
    corners = [square(x, y, 200.0) for x in (0.0, 439.0) for y in (0.0, 279.0)]
    spread = coverage(corners, (640, 480))
    assert not spread.in_the_middle and spread.fraction == pytest.approx(4 * 200**2 / (640 * 480), rel=0.1)
    assert coverage([], (640, 480)).fraction == 0.0
