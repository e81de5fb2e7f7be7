"""Calibrating cameras while they are watched: which views of the board are taken, what to do next, when it is good.

No clock and no threads of its own: images come with their times, and computations are handed to whoever starts them.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from math import ceil
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...errors import CalibrationError
from ...geometry.camera import Camera, CameraRig
from .board import Board, BoardView, find_board, glimpse_board, seen_grid
from .board_quality import edge_widths
from .board_watch import BoardWatch, Look, Place, place_of
from .calibrate import CalibrationResult, are_sides_exchanged, calibrate_from_points, grid_of
from .rig_fit import MINIMUM_VIEWS, CameraViews

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Region = tuple[int, int]
Start = Callable[..., "Future[Any]"]

REGIONS = 3  # of an image, each way
_REGION_NAMES = (
    ("upper left", "top", "upper right"),
    ("left", "middle", "right"),
    ("lower left", "bottom", "lower right"),
)
ENOUGH_VIEWS = 10
_EVERY_VIEWS = 2
_LOOK_EVERY_S = 0.12
_CELLS = (24, 18)  # of an image, across and down
_COVERED = 0.45  # of what all cameras can see together
_NEW_PLACE = 0.1  # of the image width
_NEW_SIZE = 1.2
_NEW_TILT_RAD = np.radians(12.0)
_TILTED_RAD = np.radians(20.0)
_TILTED_VIEWS = 0.5
_LARGE = 0.25  # of the image width: the root of the board's area
_TOO_FEW_CELLS = 0.3  # of a region that can be reached: it is not asked for
_ASKED_BEFORE = 0.3  # coverage that a region is taken to have for each time it was asked for in vain
_UNSEEN_S = 4.0  # without the board, and it is looked for with other numbers of corners
_WIDEST = 1.2  # normalised coordinates further out are not of this lens


@dataclass(frozen=True)
class Sight:
    """What the session made of one set of images.

    Args:
        look: where the board is seen; None when these images were left out.
        advice: what to do next, in plain words.
        target: camera and region (row, column of `REGIONS` each) in which the board is wanted.
        taken: whether this view was taken.
    """

    look: Look | None
    advice: str
    target: tuple[int, Region] | None
    taken: bool = False


@dataclass
class _Camera:
    """What one camera has seen."""

    name: str
    title: str
    size: tuple[int, int]
    covered: Mask = field(default_factory=lambda: np.zeros(_CELLS[::-1], dtype=bool))
    reachable: Mask = field(default_factory=lambda: np.ones(_CELLS[::-1], dtype=bool))
    views: dict[str, BoardView] = field(default_factory=dict)
    places: list[Place] = field(default_factory=list)
    widths_px: list[tuple[float, float]] = field(default_factory=list)

    def take(self, key: str, image: Image, board: Board, view: BoardView) -> None:
        """Add a view."""
        self.views[key] = view
        self.places.append(place_of(view, board, self.size))
        self.widths_px.append(edge_widths(image, board, view))
        scale = np.array(_CELLS) / np.array(self.size)
        cells = np.zeros(_CELLS[::-1], dtype=np.uint8)
        hull = cv2.convexHull(np.round((view.pixels + 0.5) * scale - 0.5).astype(np.int32).reshape(-1, 1, 2))
        cv2.fillConvexPoly(cells, hull, (1.0,))
        self.covered |= cells > 0

    @property
    def coverage(self) -> float:
        """Fraction of what can be reached that the board has been in."""
        return float((self.covered & self.reachable).sum() / max(self.reachable.sum(), 1))

    def region_coverage(self) -> Array:
        """Return the fraction covered of each region (REGIONS, REGIONS), NaN where little of it can be reached."""
        rows, columns = _CELLS[1] // REGIONS, _CELLS[0] // REGIONS
        shape = (REGIONS, rows, REGIONS, columns)
        reachable = self.reachable.reshape(shape).sum(axis=(1, 3))
        covered = (self.covered & self.reachable).reshape(shape).sum(axis=(1, 3))
        return np.where(reachable < _TOO_FEW_CELLS * rows * columns, np.nan, covered / np.maximum(reachable, 1))


class BoardSession:
    """Takes views of a board from images as they come, and calibrates the cameras from them.

    Args:
        board: the board.
        names: of the cameras, for the calibration; the first two are the left and the right one.
        titles: what they are called in sentences, "the left camera".
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
        self.result: CalibrationResult | None = None
        self._board = board
        self._names, self._titles = tuple(names), tuple(titles)
        self._start = start
        self._limit = max(limit, MINIMUM_VIEWS)
        self._every_s = every_s
        self._watch = BoardWatch(board, glimpse_board)
        self._cameras: list[_Camera] = []
        self._asked: Counter[tuple[int, Region]] = Counter()
        self._running: Future[CalibrationResult] | None = None
        self._calibrated_views = 0
        self._looked_s = -np.inf
        self._due_s: float | None = None
        self._seen_s: float | None = None
        self._probe: Future[tuple[int, int] | None] | None = None
        self._probed: tuple[int, int] | None = None
        self._other_grid: tuple[int, int] | None = None
        self._last = Sight(None, "", None)

    @property
    def views(self) -> int:
        """Views taken."""
        return len(self._cameras[0].places) if self._cameras else 0

    @property
    def coverage(self) -> tuple[Mask, ...]:
        """Per camera the cells of its image in which the board has been."""
        return tuple(camera.covered for camera in self._cameras)

    @property
    def fraction(self) -> float:
        """How much of the work is done, as far as can be told."""
        covered = min((camera.coverage for camera in self._cameras), default=0.0)
        return min(1.0, 0.5 * min(self.views / ENOUGH_VIEWS, 1.0) + 0.5 * min(covered / _COVERED, 1.0))

    @property
    def good(self) -> bool:
        """Whether the calibration so far is good: no picture of any other place is needed."""
        return (
            self.result is not None
            and self.result.verdict == "good"
            and len(self.result.used) >= ENOUGH_VIEWS
            and min(camera.coverage for camera in self._cameras) >= _COVERED
        )

    @property
    def done(self) -> bool:
        """Whether it is good, or no more views are taken."""
        return self.good or self.views >= self._limit

    def see(self, time_s: float, images: Sequence[Image], usable: Sequence[bool]) -> Sight:
        """Take the images of the next moment, one per camera (uint8 BGR).

        Raises:
            CalibrationError: the left and the right camera are exchanged.
        """
        self._collect()
        if time_s - self._looked_s < _LOOK_EVERY_S:
            return Sight(None, self._last.advice, self._last.target)
        self._looked_s = time_s
        if not self._cameras:
            rows = zip(self._names, self._titles, images, strict=True)
            self._cameras = [_Camera(name, title, (image.shape[1], image.shape[0])) for name, title, image in rows]
        look = self._watch.see(time_s, images, usable)
        self._probe_for_another(time_s, images, look)
        self._last = self._see_timed(time_s, images, look) if self._every_s else self._see_still(images, look)
        return self._last

    def finish(self) -> CalibrationResult:
        """Return the calibration from all views, or the one that is good already.

        Raises:
            CalibrationError: they do not suffice.
        """
        while self._running is not None:
            self._running.exception()  # waits
            self._collect()
        if self.result is None or (not self.good and self._calibrated_views < self.views):
            if self.views < MINIMUM_VIEWS:
                raise CalibrationError(
                    f"the board was seen whole and still in {self.views} places, {MINIMUM_VIEWS} are needed",
                    advice="check its numbers of corners, hold it so that every camera sees it, and give it light",
                )
            self.result = self._checked(_calibrate(*self._content()))
        return self.result

    def _see_still(self, images: Sequence[Image], look: Look) -> Sight:
        if not look.together:
            return Sight(look, self._show_it(look), self._target())
        if not self._is_new(look):
            return Sight(look, self._next(), self._target())
        if not look.still:
            return Sight(look, "hold it still", self._target())
        return self._taken(images, look)

    def _see_timed(self, time_s: float, images: Sequence[Image], look: Look) -> Sight:
        every_s = self._every_s or 0.0
        self._due_s = time_s + every_s if self._due_s is None else self._due_s
        if time_s < self._due_s:
            advice = self._next() if look.together else self._show_it(look)
            return Sight(look, f"{ceil(self._due_s - time_s)}: {advice}", self._target())
        self._due_s = time_s + every_s
        return self._taken(images, look) if look.together else Sight(look, self._show_it(look), self._target())

    def _probe_for_another(self, time_s: float, images: Sequence[Image], look: Look) -> None:
        """Find out whether a board of another size is shown, when none is seen for a while."""
        if self._seen_s is None or any(view is not None for view in look.views):
            self._seen_s, self._probed, self._other_grid = time_s, None, None
        if self._probe is not None and self._probe.done():
            found, self._probe = self._probe.result(), None
            self._other_grid = found if found == self._probed else None  # once may be the pattern of a curtain
            self._probed = found
        if self._board.kind == "chessboard" and self._probe is None and time_s - self._seen_s > _UNSEEN_S:
            self._seen_s = time_s
            self._probe = self._start(seen_grid, images[0], self._board.corner_grid)

    def _show_it(self, look: Look) -> str:
        asked = self._board.corner_grid
        if self._other_grid is not None and self._other_grid != (max(asked), min(asked)):
            seen = f"{self._other_grid[0]}x{self._other_grid[1]}"
            return f"this board has {seen} inner corners, not {asked[0]}x{asked[1]}: set that, then start again"
        blind = [camera.title for camera, view in zip(self._cameras, look.views, strict=True) if view is None]
        if len(blind) == len(self._cameras):
            return "show the whole board to all cameras" if len(blind) > 1 else "show the whole board to the camera"
        return f"hold it so that {' and '.join(blind)} {'sees' if len(blind) == 1 else 'see'} all of it too"

    def _is_new(self, look: Look) -> bool:
        """Whether the board is elsewhere, of another size or tilted otherwise than in every view taken."""
        known = np.zeros(self.views, dtype=bool)
        for index, (camera, view) in enumerate(zip(self._cameras, look.views, strict=True)):
            if view is None:
                return False
            place = place_of(view, self._board, camera.size)
            alike = np.array([_is_alike(place, other) for other in camera.places], dtype=bool)
            known = alike if index == 0 else known & alike
        return not known.any()

    def _taken(self, images: Sequence[Image], look: Look) -> Sight:
        """Take the view if the corners are found closely, too."""
        views = [view for image in images if (view := find_board(image, self._board)) is not None]
        if len(views) < len(images):
            return Sight(look, "hold it still, in more light: its corners are not clear", self._target())
        target = self._target()
        key = f"{self.views:06d}"
        for camera, image, view in zip(self._cameras, images, views, strict=True):
            camera.take(key, image, self._board, view)
        if target is not None:
            self._asked[target] += 1
        self._calibrate_later()
        return Sight(look, f"taken, {self._next()}", self._target(), True)

    def _next(self) -> str:
        """What would help most now."""
        if not self.views:
            return "hold it still"
        places = self._cameras[0].places
        tilted = sum(place.tilt_rad > _TILTED_RAD for place in places) / len(places)
        tilt = "tilt it another way" if tilted < _TILTED_VIEWS else ""
        target = self._target()
        if target is None:
            if self.result is not None and self.result.advice:
                return self.result.advice[0]
            return tilt or "hold it nearer or farther, tilted another way"
        camera, region = target
        move = f"move it to the {_region_name(region)} of {self._cameras[camera].title}'s picture"
        if max(place.size for place in self._cameras[camera].places) < _LARGE:
            move += ", nearer"
        return f"{move} and {tilt}" if tilt else move

    def _target(self) -> tuple[int, Region] | None:
        """The region that was covered, and asked for, least; None when enough is covered."""
        if not self.views or min(camera.coverage for camera in self._cameras) >= _COVERED:
            return None
        rows = [
            (covered + _ASKED_BEFORE * self._asked[index, region], index, region)
            for index, camera in enumerate(self._cameras)
            for region, covered in np.ndenumerate(camera.region_coverage())
            if np.isfinite(covered) and len(region) == 2
        ]
        if not rows:  # next to nothing is seen by all cameras
            return None
        _, index, region = min(rows)
        return index, (int(region[0]), int(region[1]))

    def _content(self) -> tuple[Board, list[CameraViews], dict[str, list[tuple[float, float]]]]:
        cameras = [CameraViews(camera.name, camera.size, dict(camera.views)) for camera in self._cameras]
        return self._board, cameras, {camera.name: list(camera.widths_px) for camera in self._cameras}

    def _calibrate_later(self) -> None:
        if self._running is None and self.views >= max(MINIMUM_VIEWS, self._calibrated_views + _EVERY_VIEWS):
            self._calibrated_views = self.views
            self._running = self._start(_calibrate, *self._content())

    def _collect(self) -> None:
        """Take the result of the computation that has ended, if any; with few views it may fail, and is tried again."""
        if self._running is None or not self._running.done():
            return
        running, self._running = self._running, None
        error = running.exception()
        if error is None:
            self.result = self._checked(running.result())
            for camera, reachable in zip(self._cameras, self._reachable(self.result.rig), strict=True):
                camera.reachable = reachable
        elif not isinstance(error, CalibrationError):
            raise error

    def _checked(self, result: CalibrationResult) -> CalibrationResult:
        cameras = result.rig.cameras
        if len(cameras) > 1 and are_sides_exchanged(cameras[0].to_camera(cameras[1].centre_m)):
            raise CalibrationError(
                "the left camera stands on the right", advice="exchange the two cameras, then calibrate again"
            )
        return result

    def _reachable(self, rig: CameraRig) -> list[Mask]:
        """Return per camera the cells where a board, at the distances seen so far, is in all other images as well."""
        columns, rows = self._board.corner_grid
        side_m = float(np.sqrt((columns - 1) * (rows - 1))) * self._board.square_m
        masks = []
        for index, camera in enumerate(rig.cameras):
            width, height = camera.image_size
            x, y = (np.arange(cells) + 0.5 for cells in _CELLS)
            pixels = np.stack(np.meshgrid(x * width / _CELLS[0], y * height / _CELLS[1]), axis=-1) - 0.5
            rays = camera.rays(camera.undistort(pixels))
            sizes = [place.size * width for place in self._cameras[index].places]
            mask = np.zeros(_CELLS[::-1], dtype=bool)
            for distance_m in camera.focal_px * side_m / np.array([min(sizes), float(np.median(sizes)), max(sizes)]):
                points = camera.centre_m + distance_m * rays
                mask |= np.all([_in_image(other, points) for other in rig.cameras if other is not camera], axis=0)
            masks.append(mask)
        return masks


def _calibrate(
    board: Board, cameras: Sequence[CameraViews], widths_px: dict[str, list[tuple[float, float]]]
) -> CalibrationResult:
    return calibrate_from_points(
        board.points_m, cameras, left_right=False, grid=grid_of(board), edge_widths_px=widths_px
    )


def _in_image(camera: Camera, points_m: Array) -> Mask:
    local = camera.to_camera(points_m)
    ahead = (local[..., 2] > 0.0) & (np.abs(local[..., :2]) < _WIDEST * local[..., 2:]).all(axis=-1)
    pixels = camera.project(points_m)
    inside = (pixels > -0.5) & (pixels < np.array(camera.image_size) - 0.5)
    return np.asarray(ahead & inside.all(axis=-1))


def _is_alike(place: Place, other: Place) -> bool:
    return (
        float(np.linalg.norm(place.centre - other.centre)) < _NEW_PLACE
        and max(place.size / other.size, other.size / place.size) < _NEW_SIZE
        and float(np.arccos(np.clip(place.normal @ other.normal, -1.0, 1.0))) < _NEW_TILT_RAD
    )


def _region_name(region: Region) -> str:
    return _REGION_NAMES[region[0]][region[1]]
