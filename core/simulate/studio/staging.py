"""A recorded motion brought before the simulated cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ... import rotations as rot
from ...calibration_pose import t_pose
from ...motion import Motion
from .body import make_body

Array = NDArray[np.float64]

_ARRIVAL_S = 1.0  # time from the T pose to the motion's first pose


def on_stage(motion: Motion) -> Motion:
    """Return the motion turned to face the cameras (+z) on the whole, its path centred, its lowest sole on y = 0."""
    forward = rot.rotate(motion.rotations[:, 0], np.array([0.0, 0.0, 1.0])).mean(axis=0)
    turn = rot.from_rotation_vector(np.array([0.0, -np.arctan2(forward[0], forward[2]), 0.0]))
    rotations = motion.rotations.copy()
    rotations[:, 0] = rot.multiply(turn, rotations[:, 0])
    path = rot.rotate(turn, motion.root_positions_m)
    middle = 0.5 * (path.min(axis=0) + path.max(axis=0))
    lowest = lowest_point_m(motion)
    return replace(motion, rotations=rotations, root_positions_m=path - np.array([middle[0], lowest, middle[2]]))


def on_treadmill(motion: Motion) -> Motion:
    """Return the motion without its mean horizontal speed, as on a treadmill: the path stays before the cameras."""
    drift = motion.root_positions_m[-1] - motion.root_positions_m[0]
    drift[1] = 0.0
    passed = np.linspace(0.0, 1.0, motion.frames)[:, None]
    return replace(motion, root_positions_m=motion.root_positions_m - passed * drift)


def with_t_pose(motion: Motion, seconds: float) -> Motion:
    """Return the motion with a T pose of the given length before it, and a second to get from it into the motion."""
    if seconds <= 0.0:
        return motion
    pose = t_pose(motion.skeleton)
    first = motion.rotations[0]
    heading = rot.swing_twist(first[0], np.array([0.0, 1.0, 0.0]))[1]
    pose[0] = rot.multiply(heading, pose[0])
    still = np.broadcast_to(pose, (max(round(seconds * motion.fps), 1), *pose.shape))
    steps = max(round(_ARRIVAL_S * motion.fps), 1)
    f = np.arange(1, steps) / steps
    ease = f * f * (3.0 - 2.0 * f)
    shape = (len(ease), *pose.shape)
    arriving = rot.slerp(
        np.broadcast_to(pose, shape), np.broadcast_to(first, shape), np.broadcast_to(ease[:, None], shape[:2])
    )
    root = motion.root_positions_m[0].copy()
    standing = replace(motion, rotations=pose[None], root_positions_m=np.zeros((1, 3)))
    root[1] = -lowest_point_m(standing)
    path = root + ease[:, None] * (motion.root_positions_m[0] - root)
    return replace(
        motion,
        rotations=np.concatenate((still, arriving, motion.rotations)),
        root_positions_m=np.concatenate((np.broadcast_to(root, (len(still), 3)), path, motion.root_positions_m)),
    )


def lowest_point_m(motion: Motion) -> float:
    """Return the height of the lowest point of the body in all frames: the floor, if the feet ever touch it."""
    body = make_body(motion.skeleton)
    starts, ends = body.posed(motion.rotations, motion.root_positions_m)
    return float(min((starts[..., 1] - body.start_radii_m).min(), (ends[..., 1] - body.end_radii_m).min()))
