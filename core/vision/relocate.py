"""Marker frames of recorded 2D detections, as another calibration sees them."""

from collections.abc import Sequence
from dataclasses import replace

from ..errors import TakeError
from ..geometry.camera import CameraRig
from ..markers.marker_frame import MarkerFrame
from .pipeline import MarkerPipeline
from .synchronise import synchronise_frames


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
