"""Marker takes made from the labelled markers of solved poses."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...body.clock import clock_of
from ...body.scene_pose import PerformerPose
from ...errors import TakeError, counted
from ...geometry.camera import CameraRig
from ...markers.marker_take import MarkerTake, SingleViews
from ..take_file.take_reader import TakeFile, read_take_file


def read_recorded_take(path: Path | str) -> MarkerTake:
    """Return the markers of a recorded take with their live labels; TakeError if no pose was solved."""
    return marker_take(read_take_file(path))


def marker_take(take: TakeFile) -> MarkerTake:
    """Return a recorded take's labelled markers in its world, without those seen by a single camera."""
    poses = take.recorded_poses_of()
    if len(poses) < 2:
        raise TakeError(
            f"has {counted(len(poses), 'solved frame')}, but at least 2 are needed",
            where=str(take.path),
            advice="solve it, which also labels its markers",
        )
    clock = clock_of(np.array([pose.time_s for pose in poses]))
    found = take_of_poses(poses, take.setup.subjects()[0].marker_set.names, take.notes.name, clock.fps)
    return replace(found, times_s=found.times_s - found.times_s[0])


def take_of_poses(
    poses: Sequence[PerformerPose], names: Sequence[str], name: str, fps: float, rig: CameraRig | None = None
) -> MarkerTake:
    """Return the labelled markers of poses; if `rig` is given, also those seen by a single camera."""
    single = None
    if rig is not None:
        cameras = np.array([pose.single_cameras for pose in poses])
        single = SingleViews(rig, cameras, np.array([pose.single_points for pose in poses]))
    return MarkerTake(
        name,
        fps,
        tuple(names),
        np.array([pose.observed_m for pose in poses]),
        np.array([pose.number for pose in poses]),
        np.array([pose.time_s for pose in poses]),
        single,
        is_upright=True,
    )
