"""Changes of a body: the sizes of its parts, and its markers' offsets.

With fixed joint rotations, marker positions are linear in both (cf. O'Brien et al. 2000, where joint centres are linear
in the same way).
"""

from dataclasses import dataclass, replace

import numpy as np

from ..body.skeleton import Skeleton, forward_kinematics
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray
from ..markers.marker_set import MarkerSet
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject


@dataclass(frozen=True)
class ChangeSigmas:
    """Usual standard deviations of a body's changes."""

    size: float = 0.08  # relative size of the whole body
    part: float = 0.04  # additional relative size of a part
    offset_m: float = 0.02  # marker relative to its usual offset
    placed_m: float = 0.05  # the same for a marker that was placed from the motion


SIGMAS = ChangeSigmas()

PARTS: dict[str, tuple[str, ...]] = {
    "hips": ("femur",),
    "trunk": ("lowerback", "upperback", "thorax", "lowerneck", "upperneck", "head", "clavicle", "humerus"),
    "thighs": ("tibia",),
    "shanks": ("foot",),
    "feet": ("toes",),
    "arms": ("radius", "wrist", "hand", "fingers", "thumb"),
}


def part_covariance(parts: int) -> Array:
    """Return the usual covariance (P, P) of the sizes of parts: common to the whole body, plus each part's own."""
    return np.full((parts, parts), SIGMAS.size**2) + SIGMAS.part**2 * np.eye(parts)


def observed_positions(take: MarkerTake, marker_set: MarkerSet) -> Array:
    """Return positions (F, M, 3) in the set's order, NaN for markers that the take lacks."""
    result = np.full((take.frames, len(marker_set), 3), np.nan)
    for column, name in enumerate(marker_set.names):
        if name in take.names:
            result[:, column] = take.positions_m[:, take.names.index(name)]
    return result


def linear_model(rotations: Array, subject: Subject) -> tuple[Array, Array, Array]:
    """Return the markers' derivatives (F, M, 3, ...) with respect to part sizes and to marker offsets, and the markers.

    The markers are (F, M, 3).
    """
    skeleton, joints = subject.skeleton, subject.marker_set.joint_indices(subject.skeleton)
    positions, world = forward_kinematics(skeleton, rotations, np.zeros(3))
    parts = _part_of_joint(skeleton)
    by_part = np.empty((*rotations.shape[:1], len(joints), 3, len(PARTS)))
    for part in range(len(PARTS)):
        only = np.where((parts == part)[:, None], skeleton.offsets_m, 0.0)
        kept = replace(skeleton, offsets_m=only)
        by_part[..., part] = forward_kinematics(kept, rotations, np.zeros(3))[0][:, joints]
    turns = rot.to_matrix(world[:, joints])
    by_offset = np.zeros((len(rotations), len(joints), 3, 3 * len(joints)))
    for marker in range(len(joints)):
        by_offset[:, marker, :, 3 * marker : 3 * marker + 3] = turns[:, marker]
    offsets = subject.marker_set.offsets_m
    markers = positions[:, joints] + np.einsum("fmij,mj->fmi", turns, offsets)
    return by_part, by_offset, markers


def _part_of_joint(skeleton: Skeleton) -> IntArray:
    """Return the part (J,) of the bone that leads to each joint, or -1 for the root."""
    result = np.full(len(skeleton), -1, dtype=np.int64)
    for number, members in enumerate(PARTS.values()):
        for joint, name in enumerate(skeleton.names):
            if name in members or (name[:1] in "lr" and name[1:] in members):
                result[joint] = number
    return result


def part_lengths_m(skeleton: Skeleton) -> Array:
    """Return the total length of each part's bones."""
    part, lengths = _part_of_joint(skeleton), np.linalg.norm(skeleton.offsets_m, axis=1)
    return np.array([lengths[part == number].sum() for number in range(len(PARTS))])


def sized(skeleton: Skeleton, parts: Array) -> Skeleton:
    """Return the skeleton with the bones of each part lengthened by a relative change."""
    part = _part_of_joint(skeleton)
    factors = np.where(part >= 0, 1.0 + parts[part], 1.0)
    offsets = skeleton.offsets_m * factors[:, None]
    tips = skeleton.tips_m.copy()
    for joint in range(len(skeleton)):
        followers = [
            child
            for child in np.flatnonzero(skeleton.parents == joint)
            if np.allclose(skeleton.offsets_m[child], skeleton.tips_m[joint], atol=1e-6)
        ]
        tips[joint] = offsets[followers[0]] if followers else skeleton.tips_m[joint] * factors[joint]
    return replace(skeleton, offsets_m=offsets, tips_m=tips)
