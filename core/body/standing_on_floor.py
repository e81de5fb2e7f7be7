"""Placing of a motion on the floor: the height of its floor, and feet that stand exactly on it.

Standing feet of a recorded motion are one or two centimetres above or below the floor, because soles are soft and
skeletons are not exact. A foot stands in frames in which its sole is low and its ball is slow. There its sole is
brought to the floor: the hips follow the slow part of the correction, and the legs bend for the rest. On a treadmill
feet are never slow; the whole motion is only moved to the height of the floor, and soles are kept above it.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from ..geometry import quaternion_components as c
from ..geometry import rotations as rot
from ..geometry.arrays import Array, Mask
from ..geometry.two_bone_ik import two_bone_directions
from .motion import Motion
from .skeleton import forward_kinematics
from .soles import sole_heights_m


@dataclass(frozen=True)
class FloorSettings:
    """Limits of standing feet."""

    percentile: float = 10.0  # percentile of the lower sole's heights that is the floor; jumps and outliers differ
    planted_m: float = 0.04  # largest height of a standing foot's sole above or below the floor
    planted_m_s: float = 0.3  # largest speed of its ball
    fade_s: float = 0.15  # time in which the correction of a foot begins and ends
    hips_s: float = 0.1  # standard deviation in time of the smoothing of the hips' correction


_SETTINGS = FloorSettings()


def floor_height_m(motion: Motion) -> float:
    """Return the height of the floor on which a motion's feet stand."""
    return float(np.percentile(_heights(motion).min(axis=1), _SETTINGS.percentile))


def on_floor(motion: Motion, floor_m: float | None = None) -> Motion:
    """Return a motion whose floor is at y = 0, with standing feet exactly on it and no foot below it.

    Args:
        floor_m: Height of the motion's floor; None to estimate it.
    """
    floor_m = floor_height_m(motion) if floor_m is None else floor_m
    moved = replace(motion, root_positions_m=motion.root_positions_m - [0.0, floor_m, 0.0])
    wanted = _corrections(moved)
    hips = gaussian_filter1d(_supported(wanted, _planted(moved)), _SETTINGS.hips_s * motion.fps, mode="nearest")
    roots = moved.root_positions_m.copy()
    roots[:, 1] += hips
    lowered = replace(moved, root_positions_m=roots)
    held, missed = _with_feet_moved(lowered, wanted - hips[:, None])
    if missed.max() < 1e-4:
        return held
    # legs too short for the floor: the hips are lowered by what is missing, eased in and out
    frames = max(1, round(_SETTINGS.fade_s * motion.fps))
    more = gaussian_filter1d(maximum_filter1d(missed, 2 * frames + 1), 0.5 * frames, mode="nearest")
    roots[:, 1] -= more
    return _with_feet_moved(replace(moved, root_positions_m=roots), wanted - (hips - more)[:, None])[0]


def _heights(motion: Motion) -> Array:
    positions, world = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    return sole_heights_m(motion.skeleton, positions, world)


def _planted(motion: Motion) -> Mask:
    """Return a mask (F, 2) of the frames in which each foot stands on the floor y = 0."""
    positions, world = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    balls = positions[:, [motion.skeleton.index(side + "toes") for side in "lr"]]
    speed = np.linalg.norm(np.gradient(balls, axis=0), axis=-1) * motion.fps if len(balls) > 1 else np.zeros((1, 2))
    heights = sole_heights_m(motion.skeleton, positions, world)
    return (speed < _SETTINGS.planted_m_s) & (np.abs(heights) < _SETTINGS.planted_m)


def _corrections(motion: Motion) -> Array:
    """Return the heights (F, 2) by which the feet are raised, with eased beginnings and ends."""
    heights, planted = _heights(motion), _planted(motion)
    frames, found = np.arange(motion.frames), np.zeros((motion.frames, 2))
    for foot in range(2):
        stands = np.flatnonzero(planted[:, foot])
        if len(stands):
            away = np.abs(frames - stands[np.argmin(np.abs(frames[:, None] - stands), axis=1)])
            fade = np.clip(1.0 - away / max(_SETTINGS.fade_s * motion.fps, 1.0), 0.0, 1.0)
            held = np.interp(frames, stands, -heights[stands, foot])
            found[:, foot] = held * fade * fade * (3.0 - 2.0 * fade)
    return np.maximum(found, -heights)


def _supported(wanted: Array, planted: Mask) -> Array:
    """Return the mean correction (F,) of the standing feet, interpolated where none stands."""
    count = planted.sum(axis=1)
    if not count.any():
        return np.zeros(len(wanted))
    frames, known = np.arange(len(wanted)), count > 0
    return np.interp(frames, frames[known], ((wanted * planted).sum(axis=1)[known] / count[known]))


def _with_feet_moved(motion: Motion, raised_m: Array) -> tuple[Motion, Array]:
    """Return a motion with its feet raised (F, 2), and by how much (F,) the worst leg misses its place, metres."""
    skeleton, rotations = motion.skeleton, motion.rotations.copy()
    positions, world = forward_kinematics(skeleton, motion.rotations, motion.root_positions_m)
    missed = np.zeros(motion.frames)
    for column, side in enumerate("lr"):
        femur, tibia, foot = (skeleton.index(side + name) for name in ("femur", "tibia", "foot"))
        thigh, shank = positions[:, tibia] - positions[:, femur], positions[:, foot] - positions[:, tibia]
        reach = thigh + shank
        target = reach + raised_m[:, [column]] * [0.0, 1.0, 0.0]
        hinge = rot.rotate(world[:, tibia], np.array([0.05, 0.0, 0.0]))
        normal = np.cross(_unit(thigh), _unit(shank)) + hinge
        lengths = (float(np.linalg.norm(skeleton.offsets_m[joint])) for joint in (tibia, foot))
        first_m, second_m = lengths
        ways = two_bone_directions(
            c.components(target), c.components(normal), first_m, second_m, c.components(reach), straightest=0.9999
        )
        upper = rot.multiply(rot.between(thigh, c.stacked(ways[0])), world[:, femur])
        lower = rot.multiply(rot.between(shank, c.stacked(ways[1])), world[:, tibia])
        reached = first_m * c.stacked(ways[0]) + second_m * c.stacked(ways[1])
        missed = np.maximum(missed, (reached - target)[:, 1])
        above = world[:, skeleton.parents[femur]]
        rotations[:, femur] = rot.multiply(rot.conjugate(above), upper)
        rotations[:, tibia] = rot.multiply(rot.conjugate(upper), lower)
        rotations[:, foot] = rot.multiply(rot.conjugate(lower), world[:, foot])
    return replace(motion, rotations=rotations), missed


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
