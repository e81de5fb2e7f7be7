"""Live estimation of the cameras' time offsets."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future

from ..geometry.camera import CameraRig
from ..markers.marker_frame import MarkerFrame
from .matching.time_alignment import TimeAligner
from .matching.time_offset import TimeOffset, estimate_time_offsets

Start = Callable[..., "Future[tuple[TimeOffset, ...]]"]

_REMEMBERED_S = 10.0
_FIRST_S = 4.0
_EVERY_S = 5.0
_LEAST_APART_S = 0.012  # images of fast cameras that tell no more about the motion than some of them
_LARGEST_S = 0.1  # stamps are from one clock: what differs is how long images are on their way
_AGAIN_S = 0.012  # from the last result


class TimeOffsetWatch:
    """Estimate of the offsets from the last ten seconds, for the aligner.

    Args:
        aligner: receives offsets once they are certain.
        start: begins a computation that must not hold up the cameras, as `Executor.submit` does.
    """

    def __init__(self, rig: CameraRig, aligner: TimeAligner, start: Start) -> None:
        self._rig = rig
        self._aligner = aligner
        self._start = start
        self._frames: deque[MarkerFrame] = deque()
        self._running: Future[tuple[TimeOffset, ...]] | None = None
        self._due_s: float | None = None

    def update(self, frame: MarkerFrame) -> None:
        """Take the blobs of the next images, as they are in them; never waits."""
        if not self._frames or frame.time_s - self._frames[-1].time_s >= _LEAST_APART_S:
            self._frames.append(frame)
        while frame.time_s - self._frames[0].time_s > _REMEMBERED_S:
            self._frames.popleft()
        if self._due_s is None:
            self._due_s = frame.time_s + _FIRST_S
        if self._running is not None and self._running.done():
            pairs = zip(self._aligner.offsets, self._running.result(), strict=True)
            self._aligner.offsets = tuple(new if new.is_certain else old for old, new in pairs)
            self._running = None
        if self._running is None and frame.time_s >= self._due_s:
            self._due_s = frame.time_s + _EVERY_S
            known = self._aligner.offsets
            largest_s = _AGAIN_S if any(offset.is_certain for offset in known) else _LARGEST_S
            self._running = self._start(estimate_time_offsets, self._rig, tuple(self._frames), largest_s, known)
