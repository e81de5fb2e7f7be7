"""Synchronised frames of a whole take."""

from collections.abc import Sequence

from ..geometry.camera import CameraRig
from ..markers.marker_frame import MarkerFrame
from .matching.time_alignment import TimeAligner
from .matching.time_offset import TimeOffset, estimate_time_offsets
from .pipeline import MarkerPipeline

_LARGEST_S = 0.25


def synchronise_frames(
    rig: CameraRig, frames: Sequence[MarkerFrame]
) -> tuple[list[MarkerFrame], tuple[TimeOffset, ...]]:
    """Return frames with blobs at one time, triangulated again, and time offsets.

    Where no offset is known to a millisecond and larger than three times its uncertainty, the frames are as they were.
    """
    offsets = estimate_time_offsets(rig, frames, _LARGEST_S)
    if not any(offset.is_certain for offset in offsets):
        return list(frames), offsets
    pipeline = MarkerPipeline(rig)
    pipeline.aligner = TimeAligner(rig, [offset if offset.is_certain else TimeOffset() for offset in offsets])
    return [pipeline.locate(frame) for frame in frames], offsets
