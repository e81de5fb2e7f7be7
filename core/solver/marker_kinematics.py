"""Markers of a body and their Jacobian (Eq. 1): the solver's inner loop."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..body.skeleton import Skeleton, forward_kinematics_matrices, marker_jacobian
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray
from ..kernel.library import Packed, address, checked, contiguous, function, stage

_UNIT = np.eye(3)
_SMALLEST_RAD = 1e-5  # replaces smaller angles in the divisions below, which changes the results by less than 1e-11


@dataclass(frozen=True)
class MarkerBody:
    """The part of a body that moves its markers: joints in order of depth, the root first."""

    skeleton: Skeleton  # of these B joints
    joints: IntArray  # (B,) their indices in the whole skeleton
    joint_count: int  # number J of its joints
    means: Array  # (B, 3, 3) reference pose
    carriers: IntArray  # (M,) the joint, of these, that carries each marker
    offsets_m: Array  # (M, 3) of the markers from their joints, in the joints' axes

    @classmethod
    def of(cls, skeleton: Skeleton, carriers: IntArray, offsets_m: Array, mean_rotations: Array) -> "MarkerBody":
        """Return the part of a skeleton for markers on joints (M,), with reference rotations (J, 4)."""
        body, joints = skeleton.carrying(carriers)  # other joints do not move markers
        places = np.argmax(joints == carriers[:, None], axis=1)
        return cls(body, joints, len(skeleton), rot.to_matrix(mean_rotations)[joints], places, offsets_m)

    @cached_property
    def indices(self) -> IntArray:
        """Parents, joints and carriers in one array, as the kernel takes them."""
        return np.concatenate((self.skeleton.parents, self.joints, self.carriers))

    @cached_property
    def lengths(self) -> Array:
        """Offsets of the joints, reference pose and offsets of the markers in one array."""
        return np.concatenate([each.ravel() for each in (self.skeleton.offsets_m, self.means, self.offsets_m)])

    def packed(self) -> Packed:
        """This body as the kernel takes it."""
        return Packed(self.joint_count, len(self.joints), self.indices, self.lengths)


_MARKERS = function("markers", "nnnnppppppp")


def _compiled(body: MarkerBody, pose: Array, root_matrix: Array, root_position_m: Array) -> tuple[Array, Array]:
    leading = pose.shape[:-2]
    found_m = np.empty((*leading, len(body.carriers), 3))
    jacobian = np.empty((*found_m.shape, 3 + 3 * body.joint_count))
    _run(body, pose, root_matrix, root_position_m, found_m, address(jacobian))
    return found_m, jacobian


def _compiled_markers(body: MarkerBody, pose: Array, root_matrix: Array, root_position_m: Array) -> Array:
    found_m = np.empty((*pose.shape[:-2], len(body.carriers), 3))
    _run(body, pose, root_matrix, root_position_m, found_m, None)
    return found_m


def _run(
    body: MarkerBody, pose: Array, root_matrix: Array, root_position_m: Array, found_m: Array, jacobian: Any
) -> None:
    if pose.ndim > 2:
        leading, matrix, position_m = pose.shape[:-2], root_matrix, root_position_m
        root_matrix, root_position_m = np.empty((*leading, 3, 3)), np.empty((*leading, 3))
        root_matrix[...], root_position_m[...] = matrix, position_m  # np.broadcast_to takes several times as long
    poses, matrices, positions_m = (contiguous(each) for each in (pose, root_matrix, root_position_m))
    sizes = pose.size // (3 * body.joint_count - 3), body.joint_count, len(body.joints), len(body.carriers)
    tables = address(body.indices), address(body.lengths)
    checked(_MARKERS(*sizes, *tables, poses, matrices, positions_m, address(found_m), jacobian))


@stage(_compiled_markers)
def posed_markers(body: MarkerBody, pose: Array, root_matrix: Array, root_position_m: Array) -> Array:
    """Return markers (..., M, 3) of poses (..., J - 1, 3) with roots (..., 3, 3) and (..., 3)."""
    turns = exponential_and_right_jacobian(pose.take(body.joints[1:] - 1, axis=-2))[0]
    return _posed(body, turns, root_matrix, root_position_m)[0]


@stage(_compiled)
def posed_markers_and_jacobian(
    body: MarkerBody, pose: Array, root_matrix: Array, root_position_m: Array
) -> tuple[Array, Array]:
    """Return the same markers and their Jacobian (..., M, 3, 6 + 3 (J - 1)), see `SubjectModel`."""
    turns, right_jacobians = exponential_and_right_jacobian(pose.take(body.joints[1:] - 1, axis=-2))
    markers, positions, axes = _posed(body, turns, root_matrix, root_position_m)
    axes[..., 1:, :, :] = axes[..., 1:, :, :] @ right_jacobians
    moved = marker_jacobian(body.skeleton, body.carriers, markers, positions, axes)
    jacobian = np.zeros((*markers.shape, 1 + body.joint_count, 3))
    jacobian[..., np.concatenate(([0], 1 + body.joints)), :] = moved.reshape(*markers.shape, 1 + len(body.joints), 3)
    return markers, jacobian.reshape(*markers.shape, 3 + 3 * body.joint_count)


def _posed(body: MarkerBody, turns: Array, root_matrix: Array, root_position_m: Array) -> tuple[Array, Array, Array]:
    """Return markers, and the positions and world matrices of the joints that move them."""
    local = np.empty((*turns.shape[:-3], len(body.joints), 3, 3))
    local[..., 0, :, :] = root_matrix
    local[..., 1:, :, :] = body.means[1:] @ turns
    positions, world = forward_kinematics_matrices(body.skeleton, local, root_position_m)
    turned = world.take(body.carriers, axis=-3) @ body.offsets_m[:, :, None]
    return positions.take(body.carriers, axis=-2) + turned[..., 0], positions, world


def exponential_and_right_jacobian(vectors: Array) -> tuple[Array, Array]:
    """Return exp(v) (..., 3, 3) and its right Jacobian (Sola 2018, Eq. 143).

    Both are linear combinations of the identity, the cross-product matrix of v, and v v^T.
    """
    angle2 = np.add.reduce(vectors * vectors, axis=-1)[..., None, None]
    angle = np.maximum(np.sqrt(angle2), _SMALLEST_RAD)
    sine = np.sin(angle) / angle
    versine = (1.0 - np.cos(angle)) / (angle * angle)
    cross, square = rot.cross_matrices(vectors), vectors[..., :, None] * vectors[..., None, :]
    turn = sine * cross
    turn += versine * square
    turn += (1.0 - versine * angle2) * _UNIT
    jacobian = ((1.0 - sine) / (angle * angle)) * square
    jacobian -= versine * cross
    jacobian += sine * _UNIT
    return turn, jacobian
