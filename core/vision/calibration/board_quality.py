"""Quality of board pictures: sharpness of edges, and coverage of the image."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ...geometry.arrays import Array, Image
from .calibration_board import Board, BoardView, edge_reach, grey_of


def with_edge_widths(view: BoardView, image: Image, board: Board) -> BoardView:
    """Return a view with the sharpness of its picture."""
    return replace(view, edge_widths_px=edge_widths(image, board, view))


def edge_widths(image: Image, board: Board, view: BoardView) -> tuple[float, float]:
    """Return edge widths in pixels, along the board's rows and along its columns.

    A width is the contrast divided by the steepest slope, halfway between neighbouring corners; NaN if there is no
    contrast. Sharp pictures have widths of about 2 pixels. Defocus increases both widths; motion during the exposure
    increases one more than the other.
    """
    grey = grey_of(image)
    columns = board.corner_grid[0]
    place = {int(number): pixel for number, pixel in zip(view.ids, view.pixels, strict=True)}
    along_rows = [(place[n], place[n + 1]) for n in place if (n + 1) % columns and n + 1 in place]
    along_columns = [(place[n], place[n + columns]) for n in place if n + columns in place]
    reach = edge_reach(board)
    return _width(grey, along_rows, reach), _width(grey, along_columns, reach)


def _width(grey: Image, edges: list[tuple[Array, Array]], reach: float) -> float:
    if not edges:
        return float("nan")
    ends = np.array(edges)
    direction = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(direction, axis=1)
    across = np.stack((-direction[:, 1], direction[:, 0]), axis=1) / length[:, None]
    half = max(reach * float(np.median(length)), 2.0)
    steps = np.arange(-half, half + 0.25, 0.5)  # samples every half pixel
    points = (0.5 * (ends[:, 0] + ends[:, 1])[:, None] + across[:, None] * steps[:, None]).astype(np.float32)
    profiles = cv2.remap(grey, points[..., 0], points[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    levels = profiles.astype(np.float64)
    contrast = np.ptp(levels, axis=1)
    slope = np.abs(levels[:, 2:] - levels[:, :-2]).max(axis=1)  # samples two steps apart are one pixel apart
    clear = contrast > 20.0  # smallest difference between black and white squares, grey levels
    return float(np.median(contrast[clear] / slope[clear])) if clear.any() else float("nan")


def covered_cells(views: Iterable[BoardView], image_size: tuple[int, int], cells: tuple[int, int]) -> Image:
    """Return a mask (rows, columns) of the cells of an image (w, h) that the convex hulls of the corners cover."""
    covered = np.zeros(cells[::-1], dtype=np.uint8)
    scale = np.array(cells) / np.array(image_size)
    for view in views:
        hull = cv2.convexHull(np.round((view.pixels + 0.5) * scale - 0.5).astype(np.int32).reshape(-1, 1, 2))
        cv2.fillConvexPoly(covered, hull, (1.0,))
    return covered


@dataclass(frozen=True)
class Coverage:
    """Covered share of the image, and whether the board never came near any edge of the image."""

    fraction: float
    in_the_middle: bool


def coverage(views: Iterable[BoardView], image_size: tuple[int, int]) -> Coverage:
    """Return the coverage of an image (w, h) by the convex hulls of the corners."""
    cells = covered_cells(views, image_size, (160, 120))
    covered = np.argwhere(cells)
    if len(covered) == 0:
        return Coverage(0.0, True)
    margins = np.concatenate((covered.min(axis=0) / cells.shape, 1.0 - (covered.max(axis=0) + 1) / cells.shape))
    return Coverage(float(cells.mean()), bool(margins.min() > 0.12))
