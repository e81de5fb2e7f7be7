"""Motions at a steady rate from poses and their times."""

from collections.abc import Sequence

import numpy as np

from ..body.clock import Clock, clock_of
from ..body.motion import Motion
from ..body.scene_pose import PerformerPose, ScenePose
from ..errors import TakeError, counted
from ..geometry.arrays import Array
from ..markers.subject import Subject


def pose_clock(
    poses: Sequence[PerformerPose] | Sequence[ScenePose], where: str, stated_fps: float | None = None
) -> Clock:
    """Return the clock of poses.

    Args:
        stated_fps: Rate stated in the markers' file; None if there is none.

    Raises:
        TakeError: There are no two poses with different times, and no rate is stated.
    """
    try:
        return clock_of(np.array([pose.time_s for pose in poses]), stated_fps)
    except TakeError as error:
        what = f"has {counted(len(poses), 'pose')}, too few for a motion"
        raise TakeError(what, where=where, advice="record a longer take") from error


def steady_motion(poses: Sequence[PerformerPose], subject: Subject, name: str, clock: Clock) -> Motion:
    """Return poses resampled at the steady rate of their clock."""
    return clock.motion(name, subject.skeleton, *_arrays(poses))


def motion_of(poses: Sequence[PerformerPose], subject: Subject, name: str, fps: float) -> Motion:
    """Return a motion that has one frame per pose.

    Times are ignored, so use it for evenly spaced poses, or for comparisons frame by frame.
    """
    return Motion(name, fps, subject.skeleton, *_arrays(poses))


def _arrays(poses: Sequence[PerformerPose]) -> tuple[Array, Array]:
    return np.array([pose.rotations for pose in poses]), np.array([pose.root_position_m for pose in poses])
