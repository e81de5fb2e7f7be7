"""Marker frames of a live capture, with monitoring of time offsets and bumped cameras."""

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

from ..geometry.camera import CameraRig
from ..markers.marker_frame import MarkerFrame
from .bump_watch import BumpDetector
from .detection.blob_detector import DetectionSettings
from .matching.time_alignment import TimeAligner
from .matching.time_offset import TimeOffset, estimate_time_offsets
from .pipeline import MarkerPipeline
from .sources.image_set import ImageSet

Start = Callable[..., "Future[tuple[TimeOffset, ...]]"]


@dataclass(frozen=True)
class LiveSettings:
    """Settings for monitoring the cameras of a live capture."""

    whole_every: int = 4  # every nth image is searched completely: up to 50 ms at 60 Hz until a new marker is found
    first_s: float = 4.0  # time until the first estimate of time offsets
    every_s: float = 5.0  # time between estimates
    remembered_s: float = 10.0  # age of the oldest images in an estimate
    least_apart_s: float = 0.012  # shortest interval between these images
    largest_s: float = 0.1  # largest offset; all stamps are from one clock, so offsets are differences in delay
    change_s: float = 0.012  # largest change from the last offsets once one of them is certain


_LIVE = LiveSettings()


def live_settings(threshold: float | None = None) -> DetectionSettings:
    """Return detection settings for a live capture; the default threshold is automatic."""
    return DetectionSettings(None if threshold is None else float(threshold), whole_every=_LIVE.whole_every)


def live_frames(
    images: Iterable[ImageSet], pipeline: MarkerPipeline, warn: Callable[[str], None], *, exact: bool
) -> Iterator[tuple[float, MarkerFrame]]:
    """Yield each image set's time of arrival (`time.perf_counter()`) and its marker frame.

    Args:
        exact: The time stamps are exact and the cameras do not move, so neither needs to be monitored.
    """
    with ThreadPoolExecutor(1) as later:
        offsets = bumps = None
        if not exact:
            pipeline.aligner = TimeAligner(pipeline.rig, [TimeOffset()] * len(pipeline.rig))
            offsets = TimeOffsetWatch(pipeline.rig, pipeline.aligner, later.submit)
            bumps = BumpDetector(pipeline.rig, later.submit)
        for moment in images:
            stamp_s = time.perf_counter()
            seen = pipeline.detect(moment)
            if offsets is not None:
                offsets.update(seen)
            frame = pipeline.locate(seen)
            yield stamp_s, frame
            if bumps is not None and (warning := bumps.update(frame, pipeline.last_errors_px)):
                warn(warning)


class TimeOffsetWatch:
    """Estimation of the cameras' time offsets from the last few seconds.

    Args:
        aligner: Receives offsets once they are certain.
        start: Starts a computation that must not delay the cameras, like `Executor.submit`.
    """

    def __init__(self, rig: CameraRig, aligner: TimeAligner, start: Start) -> None:
        self._rig = rig
        self._aligner = aligner
        self._start = start
        self._frames: deque[MarkerFrame] = deque()
        self._running: Future[tuple[TimeOffset, ...]] | None = None
        self._due_s: float | None = None

    def update(self, frame: MarkerFrame) -> None:
        """Process a frame with the blobs' positions in the images."""
        if not self._frames or frame.time_s - self._frames[-1].time_s >= _LIVE.least_apart_s:
            self._frames.append(frame)
        while frame.time_s - self._frames[0].time_s > _LIVE.remembered_s:
            self._frames.popleft()
        if self._due_s is None:
            self._due_s = frame.time_s + _LIVE.first_s
        if self._running is not None and self._running.done():
            pairs = zip(self._aligner.offsets, self._running.result(), strict=True)
            self._aligner.offsets = tuple(new if new.is_certain else old for old, new in pairs)
            self._running = None
        if self._running is None and frame.time_s >= self._due_s:
            self._due_s = frame.time_s + _LIVE.every_s
            known = self._aligner.offsets
            largest_s = _LIVE.change_s if any(offset.is_certain for offset in known) else _LIVE.largest_s
            self._running = self._start(estimate_time_offsets, self._rig, tuple(self._frames), largest_s, known)
