"""Advice to the person with the board: the next place to hold it in, and how."""

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any

import numpy as np

from ...geometry.arrays import Image
from .board_coverage import ENOUGH_COVERED, CameraCoverage, least_covered
from .board_watch import BoardObservation, BoardPlacement
from .calibration_board import Board

Region = tuple[int, int]
Target = tuple[int, Region]
Start = Callable[..., "Future[Any]"]
Grid = tuple[int, int]

_REGION_NAMES = (
    ("upper left", "top", "upper right"),
    ("left", "middle", "right"),
    ("lower left", "bottom", "lower right"),
)
_NEW_PLACE = 0.1  # of the image width
_NEW_SIZE = 1.2
_NEW_TILT_RAD = np.radians(12.0)
_TILTED_RAD = np.radians(20.0)
_TILTED_VIEWS = 0.5
_LARGE = 0.25  # of the image width: the root of the board's area
_ASKED_BEFORE = 0.3  # coverage that a region is taken to have for each time that it was the target in vain
_UNSEEN_S = 4.0  # without the board, then boards with other numbers of corners are searched for


class TargetRegions:
    """Choice of the image region for the next view."""

    def __init__(self) -> None:
        self._asked: Counter[Target] = Counter()

    def next(self, cameras: Sequence[CameraCoverage]) -> Target | None:
        """Return the least covered camera and region; None when enough is covered."""
        if not cameras or not cameras[0].views or least_covered(cameras) >= ENOUGH_COVERED:
            return None
        rows = [
            (covered + _ASKED_BEFORE * self._asked[index, region], index, region)
            for index, camera in enumerate(cameras)
            for region, covered in np.ndenumerate(camera.region_fractions())
            if np.isfinite(covered) and len(region) == 2
        ]
        if not rows:  # next to nothing is seen by all cameras
            return None
        _, index, region = min(rows)
        return index, (int(region[0]), int(region[1]))

    def note_view(self, target: Target | None) -> None:
        """Count a view that was taken while a target was set."""
        if target is not None:
            self._asked[target] += 1


class OtherBoardProbe:
    """Search for a chessboard of another size while the right one is out of sight.

    Args:
        find_grid: finds the grid of any board in an image.
        start: begins a computation in the background, as `Executor.submit` does.
    """

    def __init__(self, board: Board, find_grid: Callable[[Image, Grid], Grid | None], start: Start) -> None:
        self._board = board
        self._find_grid = find_grid
        self._start = start
        self._seen_s: float | None = None
        self._running: Future[Grid | None] | None = None
        self._last: Grid | None = None
        self._other: Grid | None = None

    def update(self, time_s: float, image: Image, seen: BoardObservation) -> None:
        """Take the next image of the first camera."""
        if self._seen_s is None or any(view is not None for view in seen.views):
            self._seen_s, self._last, self._other = time_s, None, None
        if self._running is not None and self._running.done():
            found, self._running = self._running.result(), None
            self._other = found if found == self._last else None  # once may be the pattern of a curtain
            self._last = found
        if self._board.kind == "chessboard" and self._running is None and time_s - self._seen_s > _UNSEEN_S:
            self._seen_s = time_s
            self._running = self._start(self._find_grid, image, self._board.corner_grid)

    @property
    def advice(self) -> str:
        """Advice to choose the board in view; "" when no other is."""
        asked = self._board.corner_grid
        if self._other is None or self._other == (max(asked), min(asked)):
            return ""
        seen = f"{self._other[0]}x{self._other[1]}"
        return f"this board has {seen} inner corners, not {asked[0]}x{asked[1]}: set that, then start again"


def visibility_advice(cameras: Sequence[CameraCoverage], seen: BoardObservation) -> str:
    """Return advice that brings the board into the images of all cameras."""
    blind = [camera.title for camera, view in zip(cameras, seen.views, strict=True) if view is None]
    if len(blind) == len(cameras):
        return "show the whole board to all cameras" if len(blind) > 1 else "show the whole board to the camera"
    return f"hold it so that {' and '.join(blind)} {'sees' if len(blind) == 1 else 'see'} all of it too"


def move_advice(cameras: Sequence[CameraCoverage], target: Target | None, calibration_advice: Sequence[str]) -> str:
    """Return advice for the next view."""
    if not cameras[0].views:
        return "hold it still"
    placements = cameras[0].placements
    tilted = sum(placement.tilt_rad > _TILTED_RAD for placement in placements) / len(placements)
    tilt = "tilt it another way" if tilted < _TILTED_VIEWS else ""
    if target is None:
        return next(iter(calibration_advice), tilt or "hold it nearer or farther, tilted another way")
    camera, region = target
    move = f"move it to the {_REGION_NAMES[region[0]][region[1]]} of {cameras[camera].title}'s picture"
    if max(placement.size for placement in cameras[camera].placements) < _LARGE:
        move += ", nearer"
    return f"{move} and {tilt}" if tilt else move


def is_alike(placement: BoardPlacement, other: BoardPlacement) -> bool:
    """Return whether two placements agree in place, size and tilt."""
    return (
        float(np.linalg.norm(placement.centre - other.centre)) < _NEW_PLACE
        and max(placement.size / other.size, other.size / placement.size) < _NEW_SIZE
        and float(np.arccos(np.clip(placement.normal @ other.normal, -1.0, 1.0))) < _NEW_TILT_RAD
    )
