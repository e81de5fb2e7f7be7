"""Observation of a board in live images: its placement, and whether it is held still."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...geometry.arrays import Array, Image
from .calibration_board import Board, BoardView


@dataclass(frozen=True)
class GuidanceSettings:
    """Settings for guiding a person through a live calibration; image lengths are fractions of the image's width."""

    look_every_s: float = 0.12  # time between searches for the board
    still_s: float = 0.5  # time without motion after which a board counts as still
    still: float = 2.0 / 640.0  # largest motion of a still board: hand tremor, which does not smear corners
    least_looks: int = 3  # fewest observations in that time
    focal: float = 0.9  # focal length of a typical lens, accurate enough for tilts
    new_place: float = 0.1  # difference in position that makes a new view
    new_size: float = 1.2  # ratio of sizes that makes a new view
    new_tilt_deg: float = 12.0  # difference in tilt that makes a new view
    tilted_deg: float = 20.0  # tilt above which a view is clearly tilted
    tilted_views: float = 0.5  # desired share of clearly tilted views
    large: float = 0.25  # square root of the board's area above which it is near enough
    asked_before: float = 0.3  # coverage added to a region for each view taken while it was requested
    reachable_share: float = 0.3  # smallest share of a region's cells that must be reachable for guidance to request it
    enough_covered: float = 0.45  # desired coverage of the image part that all cameras can see together
    enough_views: int = 10
    calibrate_every: int = 2  # new views between calibrations
    unseen_s: float = 4.0  # time without the board after which boards of other sizes are searched for


GUIDANCE = GuidanceSettings()


@dataclass(frozen=True)
class BoardPlacement:
    """Placement of the board in an image, in image widths, assuming a typical lens."""

    centre: Array  # (2,) relative to the image's centre
    size: float  # square root of the board's area
    normal: Array  # (3,) unit normal in the camera's frame, away from the camera

    @property
    def tilt_rad(self) -> float:
        """Angle between the board's normal and the line of sight to its centre."""
        sight = np.array([*self.centre / GUIDANCE.focal, 1.0])
        return float(np.arccos(min(1.0, abs(float(self.normal @ sight)) / float(np.linalg.norm(sight)))))

    def is_like(self, other: "BoardPlacement") -> bool:
        """Return whether position, size and tilt are nearly the same."""
        return (
            float(np.linalg.norm(self.centre - other.centre)) < GUIDANCE.new_place
            and max(self.size / other.size, other.size / self.size) < GUIDANCE.new_size
            and float(self.normal @ other.normal) > np.cos(np.radians(GUIDANCE.new_tilt_deg))
        )


@dataclass(frozen=True)
class BoardObservation:
    """Views of the board in one set of images, None where it is not visible, and whether it is held still."""

    views: tuple[BoardView | None, ...]
    still: bool

    @property
    def together(self) -> bool:
        """Whether every camera sees the board."""
        return None not in self.views


class BoardWatch:
    """Search for a board in live images until it is held still.

    Args:
        find: Finds the board in one image, like `glimpse_board` or `find_board`.
    """

    def __init__(self, board: Board, find: Callable[[Image, Board], BoardView | None]) -> None:
        self._board = board
        self._find = find
        self._past: deque[tuple[float, tuple[BoardView | None, ...]]] = deque()

    def see(self, time_s: float, images: Sequence[Image], usable: Sequence[bool]) -> BoardObservation:
        """Process the images of the next moment, one per camera; unusable ones are skipped."""
        views = tuple(
            self._find(image, self._board) if use else None for image, use in zip(images, usable, strict=True)
        )
        if None in views:
            self._past.clear()
            return BoardObservation(views, False)
        while len(self._past) > 1 and time_s - self._past[1][0] >= GUIDANCE.still_s:
            self._past.popleft()
        limits = [GUIDANCE.still * image.shape[1] for image in images]
        still = (
            len(self._past) + 1 >= GUIDANCE.least_looks
            and time_s - self._past[0][0] >= GUIDANCE.still_s
            and all(_motion_px(then, now) <= limit
                    for _, past in self._past
                    for then, now, limit in zip(past, views, limits, strict=True))
        )  # fmt: skip
        self._past.append((time_s, views))
        return BoardObservation(views, still)


def _motion_px(then: BoardView | None, now: BoardView | None) -> float:
    """Return the median motion in pixels between two views, with the corners numbered from the end that fits better."""
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
    """Return the placement of a view in an image of this size (w, h)."""
    width = float(image_size[0])
    hull = cv2.convexHull(view.pixels.astype(np.float32))
    size = float(np.sqrt(max(cv2.contourArea(hull), 1e-9))) / width
    middle = 0.5 * np.array([image_size[0] - 1, image_size[1] - 1])
    points = (view.pixels - middle) / (GUIDANCE.focal * width)
    homography, _ = cv2.findHomography(board.points_m[view.ids, :2], points)
    # columns of the homography: the board's axes in the camera, up to a common scale (Zhang 2000, section 2.2)
    normal = np.array([0.0, 0.0, 1.0])
    if homography is not None:
        normal = np.cross(homography[:, 0], homography[:, 1])
        normal /= max(float(np.linalg.norm(normal)), 1e-12)
    return BoardPlacement((view.pixels.mean(axis=0) - middle) / width, size, -normal if normal[2] < 0.0 else normal)
