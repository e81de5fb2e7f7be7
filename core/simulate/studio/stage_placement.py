"""Placement of recorded motion in front of the simulated cameras."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...body.calibration_poses import POSES
from ...body.motion import Motion, eased_between
from ...errors import SettingsError, counted
from ...geometry import rotations as rot
from .performer_body import make_body


@dataclass(frozen=True)
class StageSettings:
    """Times and positions of simulated performers."""

    longest_held_s: float = 300.0  # longest time for all calibration poses together
    arrival_s: float = 1.0  # time from a held pose to the next, or to the motion's first pose
    around_s: float = 4.0  # total time before and after a behaviour for T pose, lowering the arms and rest
    spacing_m: float = 1.2  # distance between performers: two fit into the image, and outstretched arms do not touch
    partners: int = 7  # largest number of partners: the room has no space for more, and each takes a second to prepare


STAGE = StageSettings()


def on_stage(motion: Motion) -> Motion:
    """Return the motion facing the cameras (+z), centred, with its lowest point on the floor."""
    forward = rot.rotate(motion.rotations[:, 0], np.array([0.0, 0.0, 1.0])).mean(axis=0)
    turn = rot.from_rotation_vector(np.array([0.0, -np.arctan2(forward[0], forward[2]), 0.0]))
    rotations = motion.rotations.copy()
    rotations[:, 0] = rot.multiply(turn, rotations[:, 0])
    path = rot.rotate(turn, motion.root_positions_m)
    middle = 0.5 * (path.min(axis=0) + path.max(axis=0))
    lowest = lowest_point_m(motion)
    return replace(motion, rotations=rotations, root_positions_m=path - np.array([middle[0], lowest, middle[2]]))


def with_poses(motion: Motion, poses: Sequence[str], seconds: float) -> Motion:
    """Return the motion preceded by poses of `POSES`, each held for `seconds`, with transitions of one second.

    The poses face the cameras (+z) whichever way the motion begins, because a person standing sideways hides a
    shoulder.

    Raises:
        SettingsError: The poses would last more than five minutes.
    """
    if not seconds * len(poses) <= STAGE.longest_held_s:
        advice = f"hold all poses for {STAGE.longest_held_s:.0f} s at most in total"
        raise SettingsError(f"{counted(len(poses), 'pose')} cannot be held for {seconds:.6g} s each", advice=advice)
    if seconds <= 0.0:
        return motion
    rotations, path = motion.rotations, motion.root_positions_m
    for name in reversed(poses):
        pose = POSES[name](motion.skeleton)
        root = motion.root_positions_m[0].copy()
        root[1] = -lowest_point_m(replace(motion, rotations=pose[None], root_positions_m=np.zeros((1, 3))))
        still = max(round(seconds * motion.fps), 1)
        frames = max(round(STAGE.arrival_s * motion.fps), 1)
        between, way = eased_between((pose, root), (rotations[0], path[0]), frames)
        rotations = np.concatenate((np.broadcast_to(pose, (still, *pose.shape)), between, rotations))
        path = np.concatenate((np.broadcast_to(root, (still, 3)), way, path))
    return replace(motion, rotations=rotations, root_positions_m=path)


def lowest_point_m(motion: Motion) -> float:
    """Return the height of the body's lowest point over all frames."""
    body = make_body(motion.skeleton)
    starts, ends = body.posed(motion.rotations, motion.root_positions_m)
    return float(min((starts[..., 1] - body.start_radii_m).min(), (ends[..., 1] - body.end_radii_m).min()))
