"""Preview for calibration: corners, covered cells and the wanted region."""

from collections.abc import Sequence

import cv2
import numpy as np

from ...geometry.arrays import Image, Mask
from .board_coverage import REGIONS
from .calibration_board import BoardView

Colour = tuple[int, int, int]

_COVERED: Colour = (80, 190, 80)  # BGR, as all here
_COVERED_SHARE = 0.35
_CORNER: Colour = (60, 220, 255)
_WANTED: Colour = (255, 170, 60)
_TAKEN: Colour = (80, 255, 80)


def draw_coverage(picture: Image, covered: Mask) -> None:
    """Tint the covered cells (rows, columns) of a picture (BGR), in place."""
    height, width = picture.shape[:2]
    mask = cv2.resize(covered.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST).astype(bool)
    tinted = (1.0 - _COVERED_SHARE) * picture[mask] + _COVERED_SHARE * np.array(_COVERED)
    picture[mask] = np.rint(tinted).astype(np.uint8)


def draw_corners(picture: Image, view: BoardView, image_width: int) -> None:
    """Mark the board's corners of a wide image in a picture of it (BGR), in place."""
    scale = picture.shape[1] / image_width
    for x, y in np.rint((view.pixels + 0.5) * scale - 0.5).astype(int).tolist():
        cv2.circle(picture, (x, y), 2, _CORNER, -1, cv2.LINE_AA)


def draw_wanted(picture: Image, region: Sequence[int]) -> None:
    """Frame the wanted region (row, column) of a picture (BGR), in place."""
    height, width = picture.shape[:2]
    (top, left), (bottom, right) = (
        ((region[0] + i) * height // REGIONS, (region[1] + i) * width // REGIONS) for i in (0, 1)
    )
    cv2.rectangle(picture, (left + 1, top + 1), (right - 2, bottom - 2), _WANTED, 2)


def draw_taken(picture: Image) -> None:
    """Frame a picture (BGR) in place: this view was taken."""
    cv2.rectangle(picture, (0, 0), (picture.shape[1] - 1, picture.shape[0] - 1), _TAKEN, 6)
