"""Preview during calibration: corners, covered cells and the requested region."""

from collections.abc import Sequence

import cv2
import numpy as np

from ...geometry.arrays import Image, Mask
from .board_coverage import REGIONS
from .calibration_board import BoardView


def draw_coverage(picture: Image, covered: Mask) -> None:
    """Tint the covered cells (rows, columns) of a picture (BGR), in place."""
    height, width = picture.shape[:2]
    mask = cv2.resize(covered.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST).astype(bool)
    green = np.array([80, 190, 80])
    picture[mask] = np.rint(0.65 * picture[mask] + 0.35 * green).astype(np.uint8)


def draw_corners(picture: Image, view: BoardView, image_width: int) -> None:
    """Mark the board's corners in a reduced picture (BGR) of an image, in place."""
    scale = picture.shape[1] / image_width
    yellow = (60, 220, 255)
    for x, y in np.rint((view.pixels + 0.5) * scale - 0.5).astype(int).tolist():
        cv2.circle(picture, (x, y), 2, yellow, -1, cv2.LINE_AA)


def draw_wanted(picture: Image, region: Sequence[int]) -> None:
    """Draw a frame around the requested region (row, column) of a picture (BGR), in place."""
    height, width = picture.shape[:2]
    (top, left), (bottom, right) = (
        ((region[0] + i) * height // REGIONS, (region[1] + i) * width // REGIONS) for i in (0, 1)
    )
    blue = (255, 170, 60)
    cv2.rectangle(picture, (left + 1, top + 1), (right - 2, bottom - 2), blue, 2)


def draw_taken(picture: Image) -> None:
    """Draw a green frame around a picture (BGR), in place, to show that its view was taken."""
    cv2.rectangle(picture, (0, 0), (picture.shape[1] - 1, picture.shape[0] - 1), (80, 255, 80), 6)
