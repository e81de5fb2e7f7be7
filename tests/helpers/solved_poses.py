"""Solved poses, and takes of them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.scene_pose import PerformerPose, ScenePose
from perfanim.core.formats.take_file.pose_codec import TimedPose
from perfanim.core.formats.take_file.take_setup import TakeNotes, TakeSetup
from perfanim.core.formats.take_file.whole_take import write_whole_take
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.prop import Prop
from perfanim.core.markers.subject import Subject
from perfanim.core.simulate.studio.studio_rig import default_rig


def performer_pose(
    number: int,
    rotations: np.ndarray | None = None,
    root_m: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    confidence: float = 0.9,
    fps: float = 60.0,
    markers: int = 9,
) -> PerformerPose:
    """Return a pose without seen markers, by default the rest pose of the standard skeleton."""
    rotations = rot.identity((29,)) if rotations is None else rotations
    unseen = np.full((markers, 3), np.nan)
    root = np.asarray(root_m, dtype=float)
    return PerformerPose(number, number / fps, rotations, root, confidence, unseen, unseen, np.full(markers, -1), 0.0)


def scene_pose(number: int, *given: Any, **fields: Any) -> ScenePose:
    """Return the same as the pose of one performer."""
    return ScenePose((performer_pose(number, *given, **fields),))


def write_poses(
    folder: Path,
    name: str,
    performers: Sequence[Subject],
    poses: Sequence[ScenePose],
    props: Sequence[Prop] = (),
    **notes: Any,
) -> Path:
    """Write a take of poses with empty marker frames."""
    setup = TakeSetup.of(default_rig(), performers, {"method": "lwr"}, {"path": "C:/data/walks.pfdb"}, {}, props)
    frames = [(0.0, MarkerFrame(pose.number, pose.time_s)) for pose in poses]
    path = folder / f"{name}.perftake"
    write_whole_take(path, setup, TakeNotes(name, **notes), frames, [TimedPose(pose, 0.0) for pose in poses])
    return path
