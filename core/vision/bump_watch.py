"""Detection of a bumped camera during a capture."""

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from statistics import median

import numpy as np

from ..errors import CalibrationError
from ..geometry.arrays import Array, FloatArray
from ..geometry.camera import CameraRig
from ..markers.marker_frame import MarkerFrame
from ..system.backoff import Backoff
from .calibration.rig_refinement import Refinement, refine_rig
from .matching.stereo import STEREO

Start = Callable[..., "Future[Refinement | None]"]

_FEWEST_BLOBS = 4
_JUDGED = 30  # moments; their median counts: half a second at 60 Hz
_DOUBTFUL_PX = 0.9  # unsynchronised cameras with rolling shutters are at a third to a half of it
_DOUBTFUL_S = 3.0  # so long without a break, then it is worth a look
_LOOKED_AT = 60  # moments from which the cameras' places are found, spread over the doubtful time
_REMEMBERED_S = 10.0
_AGAIN_S = 4.0  # to the next look, if there was nothing; twice as long each time


class BumpDetector:
    """Search for moved cameras, when rays meet badly for a while.

    Clutter, a lamp or a wrong time make rays meet badly too, but no places of the cameras mend that.

    Args:
        start: begins a computation that must not hold up the cameras, as `Executor.submit` does.
    """

    def __init__(self, rig: CameraRig, start: Start) -> None:
        self._rig = rig
        self._start = start
        self._frames: deque[MarkerFrame] = deque()
        self._misses_px: deque[float] = deque(maxlen=_JUDGED)
        self._running: Future[Refinement | None] | None = None
        self._doubtful_since_s: float | None = None
        self._retry = Backoff(0.5 * _AGAIN_S)
        self._retry.reset(-np.inf)  # the first look need not wait
        self._has_warned = False

    def update(self, frame: MarkerFrame, errors_px: Array) -> str:
        """Take a moment; return a warning when a bump has just been found, else "".

        Args:
            frame: its blobs brought to one time.
            errors_px: (N, C) how far each point's rays are from it, 0 where a camera does not see it.
        """
        if len(self._rig) < 2:
            return ""
        miss_px = meeting_error_px(frame.blobs, errors_px, STEREO.epipolar_px)
        if miss_px is not None:
            self._misses_px.append(miss_px)
        if self._running is not None and self._running.done():
            refinement, self._running = self._running.result(), None
            return self._warning(refinement, frame.time_s)
        self._remember(frame)
        if self._running is None and self._is_worth_a_look(frame.time_s):
            moments = list(self._frames)[:: -(-len(self._frames) // _LOOKED_AT)]
            self._running = self._start(_refine, self._rig, [moment.blobs for moment in moments])
        return ""

    def _remember(self, frame: MarkerFrame) -> None:
        """Keep frames while rays meet badly."""
        if len(self._misses_px) < _JUDGED or median(self._misses_px) < _DOUBTFUL_PX:
            self._doubtful_since_s = None
            self._frames.clear()
            return
        if self._doubtful_since_s is None:
            self._doubtful_since_s = frame.time_s
        self._frames.append(frame)
        while frame.time_s - self._frames[0].time_s > _REMEMBERED_S:
            self._frames.popleft()

    def _is_worth_a_look(self, now_s: float) -> bool:
        since_s = self._doubtful_since_s
        if self._has_warned or not self._retry.is_due(now_s):
            return False
        return since_s is not None and now_s - since_s > _DOUBTFUL_S

    def _warning(self, refinement: Refinement | None, now_s: float) -> str:
        self._retry.attempt(now_s)
        if refinement is None or not (refinement.bumped and refinement.sure):
            return ""
        self._has_warned = True  # once is enough
        most = int(np.argmax(refinement.turned_deg))
        # with two cameras nobody can tell which of them it was
        who = "a camera has" if len(self._rig) == 2 else f"camera {self._rig.cameras[most].name} seems to have"
        return (
            f"{who} been moved since the calibration (about {refinement.turned_deg[most]:.1f} degrees): "
            "calibrate the cameras again"
        )


def meeting_error_px(blobs: Sequence[FloatArray], errors_px: Array, worst_px: float) -> float | None:
    """Return the mean meeting error of blobs, pixels; None with too few blobs.

    One that meets none counts as the worst. As many should meet as the camera sees that sees the second most.
    """
    seen = sorted(map(len, blobs))[-2]
    if seen < _FEWEST_BLOBS:
        return None
    taking_part = np.maximum(np.count_nonzero(errors_px > 0.0, axis=1), 1)
    met = float((errors_px.sum(axis=1) / taking_part).sum())
    return (met + worst_px * max(seen - len(errors_px), 0)) / seen


def _refine(rig: CameraRig, moments: Sequence[Sequence[FloatArray]]) -> Refinement | None:
    """Return where the cameras stand; None when too few markers tell."""
    try:
        return refine_rig(rig, moments)
    except CalibrationError:
        return None
