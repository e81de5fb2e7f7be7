"""Feet of a motion moved to other places: the legs bend, and the hips are lowered where a leg is too short."""

from dataclasses import dataclass, replace

import numpy as np

from ..geometry import quaternion_components as c
from ..geometry import rotations as rot
from ..geometry.arrays import Array, Mask, runs
from ..geometry.two_bone_ik import two_bone_directions
from .motion import Motion
from .skeleton import Skeleton, forward_kinematics
from .soles import sole_heights_m
from .standing_feet import balls_m, planted_feet
from .window_filters import frames_to, gaussian, largest


@dataclass(frozen=True)
class FeetSettings:
    """Limits of moved feet, and times of transitions."""

    glide_m: float = 0.05  # a ball farther than this from the middle of its stand is not held
    fade_s: float = 0.15  # time in which a correction begins and ends
    # longest reach, as a fraction of the leg's length, unless it is straighter already; beyond it, a millimetre turns
    # the knee by degrees
    straightest: float = 0.995
    hinge: float = 0.05  # weight of the knee's hinge axis in the normal of the leg's plane, for straight legs
    floor_percentile: float = 10.0  # percentile of the lower sole's heights that is the floor


FEET_SETTINGS = FeetSettings()


def sole_heights(motion: Motion) -> Array:
    """Return the heights (F, 2) of the lowest points of both soles."""
    positions, world = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    return sole_heights_m(motion.skeleton, positions, world)


def floor_height_m(motion: Motion) -> float:
    """Return the height of the floor on which a motion's feet stand."""
    return float(np.percentile(sole_heights(motion).min(axis=1), FEET_SETTINGS.floor_percentile))


def eased_around(values: Array, known: Mask, fps: float) -> Array:
    """Return corrections (F, ...) that are `values` in the known frames, and begin and end smoothly around them."""
    at, frames = np.flatnonzero(known), np.arange(len(values))
    if len(at) == 0:
        return np.zeros_like(values)
    flat = values.reshape(len(values), -1)
    held = np.stack([np.interp(frames, at, column[at]) for column in flat.T], axis=1).reshape(values.shape)
    fade = smooth_step(1.0 - frames_to(known) / max(FEET_SETTINGS.fade_s * fps, 1.0))
    return held * fade.reshape(-1, *(1,) * (values.ndim - 1))


def smooth_step(share: Array) -> Array:
    """Return a smooth transition from 0 to 1 of a share that is cut to 0 to 1."""
    cut = np.clip(share, 0.0, 1.0)
    return np.asarray(cut * cut * (3.0 - 2.0 * cut))


def hold_planted(motion: Motion, planted: Mask | None = None) -> Motion:
    """Return a motion whose standing feet do not slide.

    Args:
        planted: Mask (F, 2) of the frames in which each foot stands; None to find them.
    """
    planted = planted_feet(motion, floor_height_m(motion)) if planted is None else planted
    balls, offsets = balls_m(motion), np.zeros((motion.frames, 2, 3))
    for foot in range(2):
        held = np.zeros((motion.frames, 3))
        kept = planted[:, foot].copy()
        for start, stop in runs(planted[:, foot]):
            middle = np.median(balls[start:stop, foot], axis=0)
            held[start:stop] = (middle - balls[start:stop, foot]) * [1.0, 0.0, 1.0]
            kept[start:stop] &= np.linalg.norm(held[start:stop], axis=1) < FEET_SETTINGS.glide_m
        offsets[:, foot] = eased_around(held, kept, motion.fps)
    return with_moved_feet(motion, offsets)


def with_moved_feet(motion: Motion, offsets_m: Array) -> Motion:
    """Return a motion with its feet moved by offsets (F, 2, 3); they keep their orientation in the world."""
    moved, missed = _bent(motion, offsets_m)
    if missed.max() < 1e-4:
        return moved
    frames = max(1, round(FEET_SETTINGS.fade_s * motion.fps))
    lower = gaussian(largest(missed, frames), 0.5 * frames)
    down = lower[:, None] * [0.0, 1.0, 0.0]
    return _bent(replace(motion, root_positions_m=motion.root_positions_m - down), offsets_m + down[:, None])[0]


def _bent(motion: Motion, offsets_m: Array) -> tuple[Motion, Array]:
    """Return a motion with its feet moved, and how far (F,) the hips are too high for it, metres."""
    posed = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    rotations, missed = bent_legs(motion.skeleton, motion.rotations, *posed, offsets_m)
    return replace(motion, rotations=rotations), missed


def bent_legs(
    skeleton: Skeleton, rotations: Array, positions: Array, world: Array, offsets_m: Array
) -> tuple[Array, Array]:
    """Return rotations (F, J, 4) with the feet moved, and how far (F,) the hips are too high for it, metres.

    Thighs and shanks turn in the planes of the legs, and the feet keep their orientation in the world.

    Args:
        positions, world: Positions (F, J, 3) and world rotations (F, J, 4) of the joints.
        offsets_m: Offsets (F, 2, 3) of the left and the right foot.
    """
    rotations, missed = rotations.copy(), np.zeros(len(rotations))
    for column, side in enumerate("lr"):
        if not np.any(offsets_m[:, column]):
            continue
        femur, tibia, foot = (skeleton.index(side + name) for name in ("femur", "tibia", "foot"))
        thigh, shank = positions[:, tibia] - positions[:, femur], positions[:, foot] - positions[:, tibia]
        reach = np.asarray(thigh + shank, dtype=np.float64)
        target: Array = reach + offsets_m[:, column]
        hinge = rot.rotate(world[:, tibia], np.array([FEET_SETTINGS.hinge, 0.0, 0.0]))
        normal: Array = rot.cross(_unit(thigh), _unit(shank)) + hinge
        first_m, second_m = (float(np.linalg.norm(skeleton.offsets_m[joint])) for joint in (tibia, foot))
        stretched = np.linalg.norm(reach, axis=1) / (first_m + second_m)
        straightest = np.clip(stretched, FEET_SETTINGS.straightest, 0.9999)
        ways = two_bone_directions(
            c.components(target), c.components(normal), first_m, second_m, c.components(reach), straightest
        )
        upper = rot.multiply(rot.between(thigh, c.stacked(ways[0])), world[:, femur])
        lower = rot.multiply(rot.between(shank, c.stacked(ways[1])), world[:, tibia])
        longest_m = straightest * (first_m + second_m)
        across = np.sum(target[:, [0, 2]] ** 2, axis=1)
        missed = np.maximum(missed, -target[:, 1] - np.sqrt(np.maximum(longest_m**2 - across, 0.0)))
        above = world[:, skeleton.parents[femur]]
        rotations[:, femur] = rot.multiply(rot.conjugate(above), upper)
        rotations[:, tibia] = rot.multiply(rot.conjugate(upper), lower)
        rotations[:, foot] = rot.multiply(rot.conjugate(lower), world[:, foot])
    return rotations, missed


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
