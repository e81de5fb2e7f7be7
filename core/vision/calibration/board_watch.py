"""Observation of a board in live images: its placement, and whether it is still."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...geometry.arrays import Array, Image
from .calibration_board import Board, BoardView

STILL_S = 0.5
_STILL = 2.0 / 640.0  # of the image width: what a hand trembles within that time; less smears no corner
_LEAST_LOOKS = 3
_FOCAL = 0.9  # of the image width: an ordinary lens, near enough to tell how a board is tilted


@dataclass(frozen=True)
class BoardPlacement:
    """Placement of the board in an image.

    Args:
        centre: (2,) from the image's middle, image widths.
        size: root of the board's area, image widths.
        normal: (3,) unit normal in the camera's frame, away from the camera, for a usual lens.
    """

    centre: Array
    size: float
    normal: Array

    @property
    def tilt_rad(self) -> float:
        """Angle between the board's normal and the line of sight to its middle."""
        sight = np.array([*self.centre / _FOCAL, 1.0])
        return float(np.arccos(min(1.0, abs(float(self.normal @ sight)) / float(np.linalg.norm(sight)))))


@dataclass(frozen=True)
class BoardObservation:
    """Views of the board in one set of images, None where unseen, and its stillness."""

    views: tuple[BoardView | None, ...]
    still: bool

    @property
    def together(self) -> bool:
        """Whether every camera sees the board."""
        return None not in self.views


class BoardWatch:
    """Finder of the board in live images, and of half a second without motion.

    Args:
        find: finds it in one image, as `board.glimpse_board` or `board.find_board` do.
    """

    def __init__(self, board: Board, find: Callable[[Image, Board], BoardView | None]) -> None:
        self._board = board
        self._find = find
        self._past: deque[tuple[float, tuple[BoardView | None, ...]]] = deque()

    def see(self, time_s: float, images: Sequence[Image], usable: Sequence[bool]) -> BoardObservation:
        """Take the images of the next moment, one per camera; unusable ones are skipped."""
        views = tuple(
            self._find(image, self._board) if use else None for image, use in zip(images, usable, strict=True)
        )
        if None in views:
            self._past.clear()
            return BoardObservation(views, False)
        while len(self._past) > 1 and time_s - self._past[1][0] >= STILL_S:  # the oldest is at least so old
            self._past.popleft()
        limits = [_STILL * image.shape[1] for image in images]
        still = (
            len(self._past) + 1 >= _LEAST_LOOKS
            and time_s - self._past[0][0] >= STILL_S
            and all(_motion_px(then, now) <= limit
                    for _, past in self._past
                    for then, now, limit in zip(past, views, limits, strict=True))
        )  # fmt: skip
        self._past.append((time_s, views))
        return BoardObservation(views, still)


def _motion_px(then: BoardView | None, now: BoardView | None) -> float:
    """Return the median motion in pixels between two views, in either numbering."""
    if then is None or now is None:
        return float("inf")
    _, first, second = np.intersect1d(then.ids, now.ids, return_indices=True)
    if not len(first):
        return float("inf")
    pairs = [(then.pixels[first], now.pixels[second])]
    if len(then.ids) == len(now.ids):
        pairs.append((then.pixels[::-1], now.pixels))
    return min(float(np.median(np.linalg.norm(a - b, axis=1))) for a, b in pairs)


def placement_of(view: BoardView, board: Board, image_size: tuple[int, int]) -> BoardPlacement:
    """Return where a view has the board, in an image of this size (w, h)."""
    width = float(image_size[0])
    hull = cv2.convexHull(view.pixels.astype(np.float32))
    size = float(np.sqrt(max(cv2.contourArea(hull), 1e-9))) / width
    middle = 0.5 * np.array([image_size[0] - 1, image_size[1] - 1])
    homography, _ = cv2.findHomography(board.points_m[view.ids, :2], (view.pixels - middle) / (_FOCAL * width))
    # columns of the homography: the board's axes in the camera, up to one scale (Zhang 2000, section 2.2)
    normal = np.array([0.0, 0.0, 1.0])
    if homography is not None:
        normal = np.cross(homography[:, 0], homography[:, 1])
        normal /= max(float(np.linalg.norm(normal)), 1e-12)
    return BoardPlacement((view.pixels.mean(axis=0) - middle) / width, size, -normal if normal[2] < 0.0 else normal)
