"""Changes to a body: to the sizes of its parts and to the offsets of its markers.

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
    """Prior standard deviations of changes to a body."""

    size: float = 0.08  # size of the whole body, relative
    part: float = 0.04  # size of one part in addition, relative
    offset_m: float = 0.02  # offset of a marker from its usual one
    placed_m: float = 0.05  # the same for a `placed` marker, whose offset comes from the motion


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
    """Return the prior covariance (P, P) of part sizes: a variance shared by the whole body, plus one for each part."""
    return np.full((parts, parts), SIGMAS.size**2) + SIGMAS.part**2 * np.eye(parts)


def observed_positions(take: MarkerTake, marker_set: MarkerSet) -> Array:
    """Return positions (F, M, 3) in the set's order, NaN for markers that the take lacks."""
    result = np.full((take.frames, len(marker_set), 3), np.nan)
    for column, name in enumerate(marker_set.names):
        if name in take.names:
            result[:, column] = take.positions_m[:, take.names.index(name)]
    return result


def linear_model(rotations: Array, subject: Subject) -> tuple[Array, Array, Array]:
    """Return the derivatives of the markers with respect to part sizes and to marker offsets, and the markers.

    The derivatives are (F, M, 3, P) and (F, M, 3, 3 M), the markers (F, M, 3), relative to the root.
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
    """Return the index (J,) of the part to which the bone leading to each joint belongs; -1 for the root."""
    result = np.full(len(skeleton), -1, dtype=np.int64)
    for number, members in enumerate(PARTS.values()):
        for joint, name in enumerate(skeleton.names):
            if name in members or (name[:1] in "lr" and name[1:] in members):
                result[joint] = number
    return result


def part_lengths_m(skeleton: Skeleton) -> Array:
    """Return the total length (P,) of the bones of each part."""
    part, lengths = _part_of_joint(skeleton), np.linalg.norm(skeleton.offsets_m, axis=1)
    return np.array([lengths[part == number].sum() for number in range(len(PARTS))])


def sized(skeleton: Skeleton, parts: Array) -> Skeleton:
    """Return the skeleton with the bones of each part lengthened by relative changes (P,)."""
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
