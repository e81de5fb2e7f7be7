"""A subject's markers as a function of the pose, with its Jacobian (Eq. 1)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..body.skeleton import Skeleton, forward_kinematics_matrices, marker_jacobian, marker_positions
from ..body.standard_skeleton import JOINT_NAMES
from ..database.store import Database, rotations_from_pose
from ..errors import SubjectError
from ..geometry import rotations as rot
from ..geometry.arrays import Array, FloatArray
from ..markers.subject import Subject
from .posed_markers import markers_at_rest


@dataclass(frozen=True)
class RootPose:
    """World position (3,) and world-from-root quaternion (4,), z_t in the paper."""

    rotation: Array
    position_m: Array

    def to_root_frame(self, points_m: Array) -> Array:
        """Return world points (..., 3) in the root's frame: T(z_t, z_0) of Eq. 2."""
        return np.asarray((points_m - self.position_m) @ self.matrix)

    def to_world(self, points_m: Array) -> Array:
        """Return points (..., 3) of the root's frame in the world."""
        return np.asarray(points_m @ self.matrix.T + self.position_m)

    @cached_property
    def matrix(self) -> Array:
        """The rotation as a matrix (3, 3)."""
        return rot.to_matrix(self.rotation)


ROOT_AT_REST = RootPose(rot.identity(), np.zeros(3))


class SubjectModel:
    """Markers of a subject from poses (J - 1, 3) relative to a database's mean."""

    def __init__(self, subject: Subject, mean_rotations: Array) -> None:
        if subject.skeleton.names != JOINT_NAMES:
            raise SubjectError(
                "the skeleton lacks the standard skeleton's joints", where=subject.name, advice="calibrate the subject"
            )
        self.subject = subject
        self.skeleton: Skeleton = subject.skeleton
        self.mean_rotations = mean_rotations
        self.joints = subject.marker_set.joint_indices(self.skeleton)
        self.offsets_m = subject.marker_set.offsets_m
        self.torso = subject.marker_set.torso

    @cached_property
    def _mean_matrices(self) -> Array:
        return rot.to_matrix(self.mean_rotations)

    def rotations(self, pose: Array, root: RootPose) -> Array:
        """Return local rotations (J, 4), the root's included."""
        return rotations_from_pose(pose, self.mean_rotations, root.rotation)

    def markers(self, pose: Array, root: RootPose = ROOT_AT_REST) -> Array:
        """Return marker positions (..., M, 3) of poses (..., J - 1, 3)."""
        if pose.ndim == 2:
            return self._posed(exponential_and_right_jacobian(pose)[0], root)[0]
        local = rotations_from_pose(pose, self.mean_rotations, root.rotation)
        return marker_positions(self.skeleton, self.joints, self.offsets_m, local, root.position_m)

    def markers_and_jacobian(self, pose: Array, root: RootPose) -> tuple[Array, Array]:
        """Return markers (..., M, 3) and their Jacobian (..., M, 3, 6 + 3 (J - 1)).

        Of poses (..., J - 1, 3) and as many roots. Columns: root translation, root rotation, pose.

        The root's rotation is varied on its right, R exp(d); the pose is varied as the rotation vectors it is.
        """
        turn, right_jacobian = exponential_and_right_jacobian(pose)
        markers, positions, world = self._posed(turn, root)
        axes = world.copy()
        axes[..., 1:, :, :] = world[..., 1:, :, :] @ right_jacobian
        return markers, marker_jacobian(self.skeleton, self.joints, markers, positions, axes)

    def _posed(self, turns: Array, root: RootPose) -> tuple[Array, Array, Array]:
        """Return markers, joint positions and world matrices of poses (..., J - 1, 3, 3)."""
        local = np.empty((*turns.shape[:-3], len(self.skeleton), 3, 3))
        local[..., 0, :, :] = root.matrix
        local[..., 1:, :, :] = self._mean_matrices[1:] @ turns
        positions, world = forward_kinematics_matrices(self.skeleton, local, root.position_m)
        markers = positions[..., self.joints, :]
        markers = markers + (world[..., self.joints, :, :] @ self.offsets_m[:, :, None])[..., 0]
        return markers, positions, world

    def database_markers(self, database: Database, frames: Any = slice(None)) -> FloatArray:
        """Return c_n (F, M, 3) float32 of Eq. 1, with the root at rest."""
        poses = database.poses[frames]
        return markers_at_rest(self.skeleton, self.joints, self.offsets_m, self.mean_rotations, poses)


def exponential_and_right_jacobian(vectors: Array) -> tuple[Array, Array]:
    """Return exp(v) (..., 3, 3) and its right Jacobian (Sola 2018, Eq. 143)."""
    angle2 = np.sum(vectors**2, axis=-1)
    angle = np.sqrt(angle2)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    sine = np.where(small, 1.0 - angle2 / 6.0, np.sin(safe) / safe)
    versine = np.where(small, 0.5 - angle2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    rest = np.where(small, 1.0 / 6.0 - angle2 / 120.0, (safe - np.sin(safe)) / safe**3)
    cross = np.zeros((*vectors.shape, 3))
    x, y, z = np.moveaxis(vectors, -1, 0)
    cross[..., 0, 1], cross[..., 0, 2], cross[..., 1, 2] = -z, y, -x
    cross[..., 1, 0], cross[..., 2, 0], cross[..., 2, 1] = z, -y, x
    square = cross @ cross
    unit = np.eye(3)
    turn = unit + sine[..., None, None] * cross + versine[..., None, None] * square
    return turn, unit - versine[..., None, None] * cross + rest[..., None, None] * square
