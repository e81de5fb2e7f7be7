"""Frames of a whole take, synchronised and located again from their 2D detections."""

from collections.abc import Sequence
from dataclasses import replace

from ..errors import TakeError
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


def retriangulate(rig: CameraRig, frames: Sequence[MarkerFrame]) -> list[MarkerFrame]:
    """Return the frames with markers located from the detected blobs only.

    Time offsets of the cameras are found from the whole take, where possible, and corrected.

    Raises:
        TakeError: the frames come from another number of cameras.
    """
    for frame in frames:
        if len(frame.detected) != len(rig):
            raise TakeError(
                f"was recorded by {len(frame.detected)} cameras, the calibration has {len(rig)}",
                where=f"frame {frame.number}",
                advice="give a calibration of the same cameras",
            )
    pipeline = MarkerPipeline(rig)
    located = [pipeline.locate(replace(frame, blobs=frame.detected, normalised=())) for frame in frames]
    return synchronise_frames(rig, located)[0]
