"""Advice for the person holding the board: where to hold it next, and how."""

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any

import numpy as np

from ...geometry.arrays import Image
from .board_coverage import CameraCoverage, least_covered
from .board_watch import GUIDANCE, BoardObservation
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


def next_target(cameras: Sequence[CameraCoverage], asked: Counter[Target]) -> Target | None:
    """Return the camera and region in which the board should appear; None if enough is covered.

    Args:
        asked: Number of views taken while each target was requested.
    """
    if not cameras or not cameras[0].views or least_covered(cameras) >= GUIDANCE.enough_covered:
        return None
    rows = [
        (float(covered) + GUIDANCE.asked_before * asked[index, (row, column)], index, (row, column))
        for index, camera in enumerate(cameras)
        for row, fractions in enumerate(camera.region_fractions())
        for column, covered in enumerate(fractions)
        if np.isfinite(covered)
    ]
    return min(rows)[1:] if rows else None  # empty if the cameras share hardly any region


class OtherBoardProbe:
    """Search for a chessboard of another size while the expected one is not visible.

    Args:
        find_grid: Finds the grid of any board in an image.
        start: Starts a computation in the background, like `Executor.submit`.
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
        """Process the next image of the first camera."""
        if self._seen_s is None or any(view is not None for view in seen.views):
            self._seen_s, self._last, self._other = time_s, None, None
        if self._running is not None and self._running.done():
            found, self._running = self._running.result(), None
            self._other = found if found == self._last else None  # a single detection may be the pattern of a curtain
            self._last = found
        if self._board.kind == "chessboard" and self._running is None and time_s - self._seen_s > GUIDANCE.unseen_s:
            self._seen_s = time_s
            self._running = self._start(self._find_grid, image, self._board.corner_grid)

    @property
    def advice(self) -> str:
        """Advice to enter the size of the board in view; "" if no other board is seen."""
        asked = self._board.corner_grid
        if self._other is None or self._other == (max(asked), min(asked)):
            return ""
        seen = f"{self._other[0]}x{self._other[1]}"
        return f"this board has {seen} inner corners, not {asked[0]}x{asked[1]}: set these numbers, then start again"


def visibility_advice(cameras: Sequence[CameraCoverage], seen: BoardObservation) -> str:
    """Return advice that brings the board into the images of all cameras."""
    blind = [camera.title for camera, view in zip(cameras, seen.views, strict=True) if view is None]
    if len(blind) == len(cameras):
        return "show the whole board to all cameras" if len(blind) > 1 else "show the whole board to the camera"
    return f"hold it so that {' and '.join(blind)} {'sees' if len(blind) == 1 else 'see'} all of it too"


def move_advice(cameras: Sequence[CameraCoverage], target: Target | None, calibration_advice: Sequence[str]) -> str:
    """Return advice for the next view."""
    placements = cameras[0].placements
    if not placements:
        return "hold it still"
    tilted = np.mean([placement.tilt_rad > np.radians(GUIDANCE.tilted_deg) for placement in placements])
    tilt = "tilt it another way" if tilted < GUIDANCE.tilted_views else ""
    if target is None:
        return next(iter(calibration_advice), tilt or "hold it nearer or farther, tilted another way")
    camera, region = target
    move = f"move it to the {_REGION_NAMES[region[0]][region[1]]} of {cameras[camera].title}'s picture"
    if max(placement.size for placement in cameras[camera].placements) < GUIDANCE.large:
        move += ", nearer"
    return f"{move} and {tilt}" if tilt else move
