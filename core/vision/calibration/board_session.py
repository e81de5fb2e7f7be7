"""Live calibration: takes views of the board, guides its holder, judges results.

No clock and no threads of its own: images come with their times, and computations go to a function that starts them.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from ...errors import CalibrationError
from ...geometry.arrays import Image, Mask
from .board_coverage import ENOUGH_COVERED, CameraCoverage, least_covered, update_reachable
from .board_guidance import OtherBoardProbe, Target, TargetRegions, is_alike, move_advice, visibility_advice
from .board_watch import BoardObservation, BoardWatch, placement_of
from .calibrate import CalibrationResult, are_sides_exchanged, calibrate_from_points
from .calibration_board import Board, BoardView, find_board, glimpse_board, seen_grid
from .rig_fit import MINIMUM_VIEWS, CameraViews

Start = Callable[..., "Future[Any]"]

ENOUGH_VIEWS = 10
_EVERY_VIEWS = 2
_LOOK_EVERY_S = 0.12


@dataclass(frozen=True)
class Guidance:
    """Answer to one set of images.

    Args:
        seen: the board in each image; None when these images were left out.
        advice: next step for the person with the board.
        target: camera and region (row, column of `REGIONS` each) in which the board is wanted.
    """

    seen: BoardObservation | None
    advice: str
    target: Target | None
    taken: bool = False


class BackgroundCalibration:
    """Calibration from the views so far, computed in the background.

    Args:
        start: begins a computation that must not hold up the images, as `Executor.submit` does.
    """

    def __init__(self, board: Board, start: Start) -> None:
        self.result: CalibrationResult | None = None
        self._board = board
        self._start = start
        self._running: Future[CalibrationResult] | None = None
        self._views = 0  # of the last calibration that was started

    def start(self, cameras: Sequence[CameraCoverage]) -> None:
        """Start a calibration, unless one runs or hardly any view is new."""
        views = len(cameras[0].views)
        if self._running is None and views >= max(MINIMUM_VIEWS, self._views + _EVERY_VIEWS):
            self._views = views
            self._running = self._start(_calibrate, *self._content(cameras))

    def collect(self, cameras: Sequence[CameraCoverage]) -> None:
        """Take the result of a calibration that ended; errors of few views are ignored.

        Raises:
            CalibrationError: the left and the right camera are exchanged.
        """
        if self._running is None or not self._running.done():
            return
        running, self._running = self._running, None
        error = running.exception()
        if error is None:
            self.result = _check_sides(running.result())
            update_reachable(cameras, self.result.rig, self._board)
        elif not isinstance(error, CalibrationError):
            raise error

    def wait(self, cameras: Sequence[CameraCoverage]) -> None:
        """Wait for the calibration that runs, if any. Errors as in `collect`."""
        if self._running is not None:
            self._running.exception()
            self.collect(cameras)

    def finish(self, cameras: Sequence[CameraCoverage], is_good: bool) -> CalibrationResult:
        """Return the calibration from all views, or the present one if it is good.

        Raises:
            CalibrationError: too few views, or as in `collect`.
        """
        views = len(cameras[0].views) if cameras else 0
        if self.result is None or (not is_good and self._views < views):
            if views < MINIMUM_VIEWS:
                raise CalibrationError(
                    f"the board was seen whole and still in {views} places, {MINIMUM_VIEWS} are needed",
                    advice="check its numbers of corners, hold it so that every camera sees it, and give it light",
                )
            self.result = _check_sides(_calibrate(*self._content(cameras)))
        return self.result

    def _content(
        self, cameras: Sequence[CameraCoverage]
    ) -> tuple[Board, list[CameraViews], dict[str, list[tuple[float, float]]]]:
        views = [CameraViews(camera.name, camera.size, dict(camera.views)) for camera in cameras]
        return self._board, views, {camera.name: list(camera.widths_px) for camera in cameras}


class BoardSession:
    """Views of a board taken from images as they come, and the calibration from them.

    Args:
        names: of the cameras, for the calibration; the first two are the left and the right one.
        titles: their names in sentences, "the left camera".
        start: begins a computation that must not hold up the images, as `Executor.submit` does.
        limit: views at which it ends even if the result is not good.
        every_s: None to take a view whenever the board is held still somewhere new; else seconds between two views.
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
        self._board = board
        self._names, self._titles = tuple(names), tuple(titles)
        self._limit = max(limit, MINIMUM_VIEWS)
        self._every_s = every_s
        self._watch = BoardWatch(board, glimpse_board)
        self._cameras: list[CameraCoverage] = []
        self._calibration = BackgroundCalibration(board, start)
        self._targets = TargetRegions()
        self._probe = OtherBoardProbe(board, seen_grid, start)
        self._looked_s = -np.inf
        self._due_s: float | None = None
        self._last = Guidance(None, "", None)

    @property
    def result(self) -> CalibrationResult | None:
        """Calibration so far."""
        return self._calibration.result

    @property
    def views(self) -> int:
        """Number of views taken."""
        return len(self._cameras[0].views) if self._cameras else 0

    @property
    def coverage(self) -> tuple[Mask, ...]:
        """Per camera the cells of its image that the board has covered."""
        return tuple(camera.covered for camera in self._cameras)

    @property
    def board_views(self) -> dict[str, list[BoardView]]:
        """The board in each camera's views, by the camera's name in sentences."""
        return {camera.title: list(camera.views.values()) for camera in self._cameras}

    @property
    def fraction(self) -> float:
        """Estimated share of the work that is done."""
        covered = least_covered(self._cameras)
        return min(1.0, 0.5 * min(self.views / ENOUGH_VIEWS, 1.0) + 0.5 * min(covered / ENOUGH_COVERED, 1.0))

    @property
    def good(self) -> bool:
        """Whether the calibration so far is good and needs no view of another place."""
        return (
            self.result is not None
            and self.result.verdict == "good"
            and len(self.result.used) >= ENOUGH_VIEWS
            and least_covered(self._cameras) >= ENOUGH_COVERED
        )

    @property
    def done(self) -> bool:
        """Whether it is good, or no more views are taken."""
        return self.good or self.views >= self._limit

    def see(self, time_s: float, images: Sequence[Image], usable: Sequence[bool]) -> Guidance:
        """Take the images of the next moment, one per camera (uint8 BGR).

        Raises:
            CalibrationError: the left and the right camera are exchanged.
        """
        self._calibration.collect(self._cameras)
        if time_s - self._looked_s < _LOOK_EVERY_S:
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
        """Return the calibration from all views, or the one that is good already.

        Raises:
            CalibrationError: they do not suffice.
        """
        self._calibration.wait(self._cameras)
        return self._calibration.finish(self._cameras, self.good)

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
        return Guidance(seen, advice, self._targets.next(self._cameras), taken)

    def _show_it(self, seen: BoardObservation) -> str:
        return self._probe.advice or visibility_advice(self._cameras, seen)

    def _move_it(self) -> str:
        advice = self.result.advice if self.result is not None else ()
        return move_advice(self._cameras, self._targets.next(self._cameras), advice)

    def _is_new(self, seen: BoardObservation) -> bool:
        """Return whether place, size or tilt of the board differ from every view taken."""
        known = np.zeros(self.views, dtype=bool)
        for index, (camera, view) in enumerate(zip(self._cameras, seen.views, strict=True)):
            if view is None:
                return False
            placement = placement_of(view, self._board, camera.size)
            alike = np.array([is_alike(placement, other) for other in camera.placements], dtype=bool)
            known = alike if index == 0 else known & alike
        return not known.any()

    def _take(self, images: Sequence[Image], seen: BoardObservation) -> Guidance:
        """Take the view if the corners are found closely, too."""
        views = [view for image in images if (view := find_board(image, self._board)) is not None]
        if len(views) < len(images):
            return self._guide(seen, "hold it still, in more light: its corners are not clear")
        target = self._targets.next(self._cameras)
        key = f"{self.views:06d}"
        for camera, image, view in zip(self._cameras, images, views, strict=True):
            camera.add(key, image, self._board, view)
        self._targets.note_view(target)
        self._calibration.start(self._cameras)
        return self._guide(seen, f"taken, {self._move_it()}", taken=True)


def _check_sides(result: CalibrationResult) -> CalibrationResult:
    cameras = result.rig.cameras
    if len(cameras) > 1 and are_sides_exchanged(cameras[0].to_camera(cameras[1].centre_m)):
        raise CalibrationError(
            "the left camera stands on the right", advice="exchange the two cameras, then calibrate again"
        )
    return result


def _calibrate(
    board: Board, cameras: Sequence[CameraViews], widths_px: dict[str, list[tuple[float, float]]]
) -> CalibrationResult:
    return calibrate_from_points(
        board.points_m, cameras, left_right=False, ambiguous=board.is_ambiguous, edge_widths_px=widths_px
    )
