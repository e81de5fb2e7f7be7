"""Feet of a solved sketch lifted to the floor, y = 0: keyed feet by turning about the ankle, others as a whole."""

from dataclasses import dataclass, replace

import numpy as np

from ..body.motion import Motion
from ..body.moved_feet import smooth_step, sole_heights, with_moved_feet
from ..body.skeleton import forward_kinematics
from ..body.soles import performer_sole
from ..body.window_filters import frames_to, gaussian, largest
from ..geometry import rotations as rot
from ..geometry.arrays import Array, Mask


@dataclass(frozen=True)
class AboveFloorSettings:
    """Limits of the correction."""

    smoothing_s: float = 0.06  # standard deviation in time
    fade_s: float = 0.15  # time from a key until a foot may be lifted as far as needed
    most_rad: float = 0.35  # largest angle by which a foot is turned
    rounds: int = 2  # a turn may bring the other end of the sole under the floor


SETTINGS = AboveFloorSettings()


def above_floor(motion: Motion, ankles: Mask, toes: Mask) -> Motion:
    """Return a motion with no sole below y = 0, as far as the keys allow.

    Args:
        ankles: Mask (F, 2) of the frames in which a key binds the left and the right ankle; these feet only turn.
        toes: The same for the toes; these feet stay as they are.
    """
    keyed = ankles | toes
    below_m = np.maximum(-sole_heights(motion), 0.0)
    if not below_m.any():
        return motion
    frames = max(1, round(SETTINGS.smoothing_s * motion.fps))
    lifted_m = gaussian(largest(below_m, frames), frames)
    for foot in np.flatnonzero(keyed.any(axis=0)):
        away = frames_to(keyed[:, foot]) / max(SETTINGS.fade_s * motion.fps, 1.0)
        most_m = lifted_m[:, foot].max() * smooth_step(away)
        lifted_m[:, foot] = np.minimum(lifted_m[:, foot], most_m)
    moved = with_moved_feet(motion, lifted_m[..., None] * np.array([0.0, 1.0, 0.0]))
    for _ in range(SETTINGS.rounds):
        moved = _turned(moved, toes)
    return moved


def _turned(motion: Motion, fixed: Mask) -> Motion:
    """Return a motion in which a foot below the floor is turned about its ankle until its lowest point lies on it.

    A foot whose other end would sink deeper stays as it is.
    """
    skeleton, rotations = motion.skeleton, motion.rotations.copy()
    positions, world = forward_kinematics(skeleton, rotations, motion.root_positions_m)
    for side in "lr":
        foot, toes = skeleton.index(side + "foot"), skeleton.index(side + "toes")
        sole = performer_sole(skeleton, side)
        points = rot.rotate(world[:, foot, None], sole.foot) + rot.rotate(world[:, toes, None], sole.toes)
        lowest = np.take_along_axis(points, points[..., 1].argmin(axis=1)[:, None, None], axis=1)[:, 0]
        below_m = np.maximum(-(positions[:, foot, 1] + lowest[:, 1]), 0.0)
        turn = rot.from_rotation_vector(_axes(lowest) * _angles(lowest, below_m)[:, None])
        above = world[:, skeleton.parents[foot]]
        rotations[:, foot] = rot.multiply(rot.conjugate(above), rot.multiply(turn, world[:, foot]))
    turned = replace(motion, rotations=rotations)
    worse = fixed | (sole_heights(turned) < np.minimum(sole_heights(motion), 0.0))
    for column, side in enumerate("lr"):
        foot, kept = skeleton.index(side + "foot"), worse[:, column]
        rotations[kept, foot] = motion.rotations[kept, foot]
    return turned


def _axes(ways_m: Array) -> Array:
    """Return the horizontal axes (F, 3) about which points (F, 3) rise."""
    across = np.stack((-ways_m[:, 2], np.zeros(len(ways_m)), ways_m[:, 0]), axis=1)
    return np.asarray(across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9))


def _angles(ways_m: Array, rise_m: Array) -> Array:
    """Return the angles (F,) by which points (F, 3) turn about horizontal axes to rise."""
    across_m = np.maximum(np.hypot(ways_m[:, 0], ways_m[:, 2]), 1e-9)
    length_m, angle = np.hypot(across_m, ways_m[:, 1]), np.arctan2(ways_m[:, 1], across_m)
    reached = np.arcsin(np.clip((ways_m[:, 1] + rise_m) / length_m, -1.0, 1.0))
    return np.asarray(np.clip(reached - angle, 0.0, SETTINGS.most_rad))
