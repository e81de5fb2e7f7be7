"""Calibration of a subject from an unlabelled recording of held poses."""

from collections.abc import Sequence

from ..body.skeleton import Skeleton
from ..labelling.trajectory_linking import track_markers
from ..labelling.trajectory_naming import name_trajectories
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_set import MarkerSet
from .pose_calibration import SubjectCalibration, calibrate_subject, pose_points


def subject_from_recording(
    frames: Sequence[MarkerFrame],
    fps: float,
    marker_set: MarkerSet,
    prototypes: Sequence[Skeleton],
    name: str,
    poses: Sequence[str],
) -> SubjectCalibration:
    """Return the subject measured in frames with held calibration poses.

    Args:
        frames: Marker frames with points at a steady rate.
        marker_set: Markers that were worn, with their usual offsets.
        poses: Names from `POSES`, with an upright pose first.

    Raises:
        SubjectError: A pose is unknown or not held.
        TakeError: The markers were not recognised.
    """
    take = name_trajectories(track_markers(frames, name, fps, len(marker_set)).take, marker_set)
    return calibrate_subject(pose_points(take, marker_set, poses), marker_set, prototypes, name, *poses)
