"""Live calibration: takes views of the board, guides the person holding it, and judges the results.

It has no clock and no threads of its own: images come with their times, and computations are passed to a function.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from ...errors import CalibrationError, counted
from ...geometry.arrays import Image, Mask
from .board_coverage import CameraCoverage, least_covered, update_reachable
from .board_guidance import OtherBoardProbe, Target, move_advice, next_target, visibility_advice
from .board_watch import GUIDANCE, BoardObservation, BoardWatch, placement_of
from .calibrate import CalibrationResult, ExchangedCamerasError, calibrate_from_points
from .calibration_board import Board, BoardView, find_board, glimpse_board, seen_grid
from .rig_fit import MINIMUM_VIEWS, CameraViews

Start = Callable[..., "Future[Any]"]


@dataclass(frozen=True)
class Guidance:
    """Response to one set of images."""

    seen: BoardObservation | None  # None if these images were skipped
    advice: str  # next step for the person holding the board
    target: Target | None  # camera and region in which the board should appear
    taken: bool = False


class BoardSession:
    """Views of a board taken from arriving images, and the calibration from them.

    Args:
        names: The cameras' names in the calibration; the first two are the left and the right one.
        titles: Their names in messages, such as "the left camera".
        start: Starts a computation that must not delay the images, like `Executor.submit`.
        limit: Number of views after which the session ends even if the result is not good.
        every_s: Time between two views; None to take one whenever the board is held still in a new position.

    Attributes:
        result: Calibration so far.
    """

    def __init__(
        self,
        board: Board,
        names: Sequence[str],
        titles: Sequence[str],
        start: Start,
        limit: int,
        every_s: float | None = None,
    ) -> None:
        self.result: CalibrationResult | None = None
        self._board = board
        self._names, self._titles = tuple(names), tuple(titles)
        self._start = start
        self._limit = max(limit, MINIMUM_VIEWS)
        self._every_s = every_s
        self._watch = BoardWatch(board, glimpse_board)
        self._cameras: list[CameraCoverage] = []
        self._running: Future[CalibrationResult] | None = None
        self._calibrated_views = 0  # number of views in the last calibration that was started
        self._asked: Counter[Target] = Counter()
        self._probe = OtherBoardProbe(board, seen_grid, start)
        self._looked_s = -np.inf
        self._due_s: float | None = None
        self._last = Guidance(None, "", None)

    @property
    def views(self) -> int:
        """Number of views taken."""
        return len(self._cameras[0].views) if self._cameras else 0

    @property
    def coverage(self) -> tuple[Mask, ...]:
        """Cells of each camera's image that the board has covered."""
        return tuple(camera.covered for camera in self._cameras)

    @property
    def board_views(self) -> dict[str, list[BoardView]]:
        """Each camera's views of the board, by the camera's title."""
        return {camera.title: list(camera.views.values()) for camera in self._cameras}

    @property
    def fraction(self) -> float:
        """Estimated fraction of the work that is done."""
        views, covered = self.views / GUIDANCE.enough_views, least_covered(self._cameras) / GUIDANCE.enough_covered
        return 0.5 * min(views, 1.0) + 0.5 * min(covered, 1.0)

    @property
    def good(self) -> bool:
        """Whether the calibration so far is good and needs no further views."""
        return (
            self.result is not None
            and self.result.verdict == "good"
            and len(self.result.used) >= GUIDANCE.enough_views
            and least_covered(self._cameras) >= GUIDANCE.enough_covered
        )

    @property
    def done(self) -> bool:
        """Whether the calibration is good or the largest number of views has been taken."""
        return self.good or self.views >= self._limit

    def see(self, time_s: float, images: Sequence[Image], usable: Sequence[bool]) -> Guidance:
        """Process the images of the next moment, one per camera (uint8 BGR).

        Raises:
            CalibrationError: The left and the right camera are exchanged.
        """
        self._collect()
        if time_s - self._looked_s < GUIDANCE.look_every_s:
            return Guidance(None, self._last.advice, self._last.target)
        self._looked_s = time_s
        if not self._cameras:
            rows = zip(self._names, self._titles, images, strict=True)
            self._cameras = [
                CameraCoverage(name, title, (image.shape[1], image.shape[0])) for name, title, image in rows
            ]
        seen = self._watch.see(time_s, images, usable)
        self._probe.update(time_s, images[0], seen)
        self._last = self._see_timed(time_s, images, seen) if self._every_s else self._see_still(images, seen)
        return self._last

    def finish(self) -> CalibrationResult:
        """Return the calibration from all views, or an earlier one that is already good.

        Raises:
            CalibrationError: There are too few good views, or the left and the right camera are exchanged.
        """
        if self._running is not None:
            wait([self._running])
            self._collect()
        if self.result is None or (not self.good and self._calibrated_views < self.views):
            if self.views < MINIMUM_VIEWS:
                raise CalibrationError(
                    f"the board was seen whole and still in {counted(self.views, 'place')}, "
                    f"but {MINIMUM_VIEWS} are needed",
                    advice="check the number of corners, hold the board where every camera sees it, and use more light",
                )
            self.result = _calibrate(self._board, self._content())
        return self.result

    def _collect(self) -> None:
        """Take the result of a finished calibration, which may have failed if there were too few views."""
        if self._running is None or not self._running.done():
            return
        running, self._running = self._running, None
        error = running.exception()
        if error is None:
            self.result = running.result()
            update_reachable(self._cameras, self.result.rig, self._board)
        elif isinstance(error, ExchangedCamerasError) or not isinstance(error, CalibrationError):
            raise error

    def _content(self) -> list[CameraViews]:
        return [CameraViews(camera.name, camera.size, dict(camera.views)) for camera in self._cameras]

    def _see_still(self, images: Sequence[Image], seen: BoardObservation) -> Guidance:
        if not seen.together:
            return self._guide(seen, self._show_it(seen))
        if not self._is_new(seen):
            return self._guide(seen, self._move_it())
        return self._take(images, seen) if seen.still else self._guide(seen, "hold it still")

    def _see_timed(self, time_s: float, images: Sequence[Image], seen: BoardObservation) -> Guidance:
        every_s = self._every_s or 0.0
        self._due_s = time_s + every_s if self._due_s is None else self._due_s
        if time_s < self._due_s:
            advice = self._move_it() if seen.together else self._show_it(seen)
            return self._guide(seen, f"{ceil(self._due_s - time_s)}: {advice}")
        self._due_s = time_s + every_s
        return self._take(images, seen) if seen.together else self._guide(seen, self._show_it(seen))

    def _guide(self, seen: BoardObservation, advice: str, taken: bool = False) -> Guidance:
        return Guidance(seen, advice, next_target(self._cameras, self._asked), taken)

    def _show_it(self, seen: BoardObservation) -> str:
        return self._probe.advice or visibility_advice(self._cameras, seen)

    def _move_it(self) -> str:
        advice = self.result.advice if self.result is not None else ()
        return move_advice(self._cameras, next_target(self._cameras, self._asked), advice)

    def _is_new(self, seen: BoardObservation) -> bool:
        """Return whether position, size or tilt of the board differ from every view taken."""
        known = np.ones(self.views, dtype=bool)
        for camera, view in zip(self._cameras, seen.views, strict=True):
            if view is not None:
                placement = placement_of(view, self._board, camera.size)
                known &= np.array([placement.is_like(other) for other in camera.placements], dtype=bool)
        return not known.any()

    def _take(self, images: Sequence[Image], seen: BoardObservation) -> Guidance:
        """Take the view if the exact search also finds the corners."""
        views = [view for image in images if (view := find_board(image, self._board)) is not None]
        if len(views) < len(images):
            return self._guide(seen, "hold it still, in more light: its corners are not clear")
        target = next_target(self._cameras, self._asked)
        key = f"{self.views:06d}"
        for camera, image, view in zip(self._cameras, images, views, strict=True):
            camera.add(key, image, self._board, view)
        if target is not None:
            self._asked[target] += 1
        if self._running is None and self.views >= max(
            MINIMUM_VIEWS, self._calibrated_views + GUIDANCE.calibrate_every
        ):
            self._calibrated_views = self.views
            self._running = self._start(_calibrate, self._board, self._content())
        return self._guide(seen, f"taken, {self._move_it()}", taken=True)


def _calibrate(board: Board, cameras: Sequence[CameraViews]) -> CalibrationResult:
    return calibrate_from_points(board.points_m, cameras, ambiguous=board.is_ambiguous)
