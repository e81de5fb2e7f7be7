"""A subject's markers as a function of the pose, with their Jacobian (Eq. 1)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..body.posed_markers import markers_at_rest
from ..body.skeleton import Skeleton, marker_positions
from ..body.standard_skeleton import JOINT_NAMES
from ..database.store import Database, rotations_from_pose
from ..errors import SubjectError
from ..geometry import rotations as rot
from ..geometry.arrays import Array, FloatArray, Mask
from ..markers.subject import Subject
from .marker_kinematics import MarkerBody, posed_markers, posed_markers_and_jacobian

_CARRIED_BY_ROOT = 4.0  # weight of markers on the pelvis relative to those on spine and shoulders


@dataclass(frozen=True)
class RootPose:
    """World-from-root quaternion (4,) and world position (3,), z_t in the paper."""

    rotation: Array
    position_m: Array

    def to_root_frame(self, points_m: Array) -> Array:
        """Return world points (..., 3) in the root's frame: T(z_t, z_0) of Eq. 2."""
        return (points_m - self.position_m) @ self.matrix

    def to_world(self, points_m: Array) -> Array:
        """Return points (..., 3) of the root's frame in world coordinates."""
        return points_m @ self.matrix.T + self.position_m

    @cached_property
    def matrix(self) -> Array:
        """The rotation as a matrix (3, 3)."""
        return rot.to_matrix(self.rotation)


ROOT_AT_REST = RootPose(rot.identity(), np.zeros(3))


class SubjectModel:
    """Model of a subject's markers in poses (J - 1, 3), which are relative to a reference pose."""

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
        # weights (M,) of the markers that locate the root: torso markers, those on the pelvis above all
        self.torso_weights = np.where(self.torso, np.where(self.joints == 0, _CARRIED_BY_ROOT, 1.0), 0.0)
        self._moving = self.skeleton.is_ancestor[self.joints]
        self.body = MarkerBody.of(self.skeleton, self.joints, self.offsets_m, mean_rotations)

    def hidden_joints(self, seen: Mask) -> Mask:
        """Return a mask (J - 1,) of the joints that move no visible marker.

        Args:
            seen: Mask (M,) of markers that are not hidden.
        """
        moving = self._moving
        if seen.all():
            return np.zeros(moving.shape[1] - 1, dtype=bool)
        return np.asarray(moving[~seen].any(axis=0) & ~moving[seen].any(axis=0))[1:]

    def rotations(self, pose: Array, root: RootPose) -> Array:
        """Return local rotations (J, 4), including the root's."""
        return rotations_from_pose(pose, self.mean_rotations, root.rotation)

    def markers(self, pose: Array, root: RootPose = ROOT_AT_REST) -> Array:
        """Return marker positions (..., M, 3) for poses (..., J - 1, 3)."""
        if pose.ndim == 2:
            return posed_markers(self.body, pose, root.matrix, root.position_m)
        local = rotations_from_pose(pose, self.mean_rotations, root.rotation)
        return marker_positions(self.skeleton, self.joints, self.offsets_m, local, root.position_m)

    def markers_and_jacobian(self, pose: Array, root: RootPose) -> tuple[Array, Array]:
        """Return markers (..., M, 3) and their Jacobian (..., M, 3, 6 + 3 (J - 1)).

        Its columns are the root's translation, its rotation (increments on the right, R exp(d)), and the pose's
        rotation vectors.

        Args:
            pose: Poses (..., J - 1, 3).
            root: Root of each pose.
        """
        return posed_markers_and_jacobian(self.body, pose, root.matrix, root.position_m)

    def database_markers(self, database: Database, frames: Any = slice(None)) -> FloatArray:
        """Return the markers c_n (F, M, 3) of Eq. 1, float32, with the root at rest."""
        poses = database.poses[frames]
        return markers_at_rest(self.skeleton, self.joints, self.offsets_m, self.mean_rotations, poses)
