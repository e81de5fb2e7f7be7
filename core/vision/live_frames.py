"""Marker frames of a live capture, with watches of the cameras."""

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor

from ..markers.marker_frame import MarkerFrame
from .bump_watch import BumpDetector
from .detection.blob_detector import DetectionSettings
from .matching.time_alignment import TimeAligner
from .matching.time_offset import TimeOffset
from .pipeline import MarkerPipeline
from .sources.image_set import ImageSet
from .time_offset_watch import TimeOffsetWatch

_WHOLE_EVERY = 4  # images: 50 ms at 60 Hz until a marker from elsewhere is found


def live_settings(threshold: float | None = None) -> DetectionSettings:
    """Return detection settings of a live capture; `threshold` None: automatic."""
    return DetectionSettings(None if threshold is None else float(threshold), whole_every=_WHOLE_EVERY)


def live_frames(
    images: Iterable[ImageSet], pipeline: MarkerPipeline, warn: Callable[[str], None], *, exact: bool
) -> Iterator[tuple[float, MarkerFrame]]:
    """Yield per image set its `time.perf_counter()` and its markers.

    Args:
        exact: the time stamps are those of the moments shown, and the cameras stand still: nothing is to be learned.
    """
    with ThreadPoolExecutor(1) as later:
        offsets = bumps = None
        if not exact:
            # all blobs are brought to one time, by the images' time stamps until more is known
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
