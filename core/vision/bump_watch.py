"""Detection of a bumped camera during a capture."""

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from statistics import median

import numpy as np

from ..errors import CalibrationError
from ..geometry.arrays import Array, FloatArray
from ..geometry.camera import CameraRig
from ..markers.marker_frame import MarkerFrame
from ..system.backoff import Backoff
from .calibration.rig_refinement import Refinement, refine_rig
from .matching.matching_settings import MATCHING

Start = Callable[..., "Future[Refinement | None]"]


@dataclass(frozen=True)
class BumpSettings:
    """Conditions for suspecting that cameras have moved."""

    fewest_blobs: int = 4  # fewest blobs in a moment for its error to be judged
    judged: int = 30  # number of moments whose median error is judged: half a second at 60 Hz
    suspect_px: float = 0.9  # suspicious median error; unsynchronised rolling shutters cause a third to a half of it
    suspect_s: float = 3.0  # duration of suspicious errors after which the camera poses are estimated
    used: int = 60  # number of moments used in that estimate, spread over the suspect period
    remembered_s: float = 10.0  # age of the oldest moment used
    again_s: float = 4.0  # pause after an unsuccessful estimate; doubled each time


_BUMPS = BumpSettings()


class BumpDetector:
    """Detector of cameras that moved, which estimates the camera poses when reprojection errors stay large.

    Clutter, a lamp or wrong time stamps also cause large errors, but no change of the camera poses reduces those.

    Args:
        start: Starts a computation that must not delay the cameras, like `Executor.submit`.
    """

    def __init__(self, rig: CameraRig, start: Start) -> None:
        self._rig = rig
        self._start = start
        self._frames: deque[MarkerFrame] = deque()
        self._misses_px: deque[float] = deque(maxlen=_BUMPS.judged)
        self._running: Future[Refinement | None] | None = None
        self._suspect_since_s: float | None = None
        self._retry = Backoff(0.5 * _BUMPS.again_s)
        self._retry.reset(-np.inf)  # the first estimate need not wait
        self._has_warned = False

    def update(self, frame: MarkerFrame, errors_px: Array) -> str:
        """Process a moment; return a warning if a bump has just been found, else "".

        Args:
            frame: Frame whose blobs have been moved to one time.
            errors_px: Reprojection errors (N, C) of the points, 0 where a camera does not see one.
        """
        if len(self._rig) < 2:
            return ""
        miss_px = meeting_error_px(frame.blobs, errors_px)
        if miss_px is not None:
            self._misses_px.append(miss_px)
        if self._running is not None and self._running.done():
            refinement, self._running = self._running.result(), None
            return self._warning(refinement, frame.time_s)
        self._remember(frame)
        is_allowed = self._running is None and not self._has_warned and self._retry.is_due(frame.time_s)
        since_s = self._suspect_since_s
        if is_allowed and since_s is not None and frame.time_s - since_s > _BUMPS.suspect_s:
            moments = list(self._frames)[:: -(-len(self._frames) // _BUMPS.used)]
            self._running = self._start(_refine, self._rig, [moment.blobs for moment in moments])
        return ""

    def _remember(self, frame: MarkerFrame) -> None:
        """Keep frames while reprojection errors are large."""
        if len(self._misses_px) < _BUMPS.judged or median(self._misses_px) < _BUMPS.suspect_px:
            self._suspect_since_s = None
            self._frames.clear()
            return
        if self._suspect_since_s is None:
            self._suspect_since_s = frame.time_s
        self._frames.append(frame)
        while frame.time_s - self._frames[0].time_s > _BUMPS.remembered_s:
            self._frames.popleft()

    def _warning(self, refinement: Refinement | None, now_s: float) -> str:
        self._retry.attempt(now_s)
        if refinement is None or not (refinement.bumped and refinement.sure):
            return ""
        self._has_warned = True
        most = int(np.argmax(refinement.turned_deg))
        # with only two cameras, it is unknown which one moved
        who = "a camera has" if len(self._rig) == 2 else f"camera {self._rig.cameras[most].name} seems to have"
        return (
            f"{who} been moved since the calibration (about {refinement.turned_deg[most]:.1f} degrees): "
            "calibrate the cameras again"
        )


def meeting_error_px(blobs: Sequence[FloatArray], errors_px: Array) -> float | None:
    """Return the mean reprojection error of blobs, pixels; None if there are too few blobs.

    The number of blobs that should match is the second-largest number of blobs in a camera's image. Each missing match
    adds the largest possible error.
    """
    seen = sorted(map(len, blobs))[-2]
    if seen < _BUMPS.fewest_blobs:
        return None
    taking_part = np.maximum(np.count_nonzero(errors_px > 0.0, axis=1), 1)
    met = float((errors_px.sum(axis=1) / taking_part).sum())
    return (met + MATCHING.epipolar_px * max(seen - len(errors_px), 0)) / seen


def _refine(rig: CameraRig, moments: Sequence[Sequence[FloatArray]]) -> Refinement | None:
    """Return the refined camera poses; None if there are too few markers."""
    try:
        return refine_rig(rig, moments)
    except CalibrationError:
        return None
