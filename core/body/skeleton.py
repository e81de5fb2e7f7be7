"""Skeletons, forward kinematics and the marker Jacobian.

In the rest pose the axes of every joint are aligned with the world's (x to the performer's left, y up, z forward),
so a skeleton is its joints' names, parents and offsets, and a pose is one rotation per joint relative to rest.
"""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SkeletonError, counted
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray, Mask

MOST_JOINTS = 2000  # largest number of joints in a file
_LONGEST_BONE_M = 10.0  # a longer bone means that the file is in the wrong unit
_UNIT = np.eye(3)


@dataclass(frozen=True)
class Skeleton:
    """Joints of a body, parents before children; joint 0 is the root.

    Args:
        names: Unique joint names (J).
        parents: Index (J,) of the parent joint, -1 for the root.
        offsets_m: Joint origin (J, 3) relative to its parent's origin in the rest pose, metres (zero for the root).
        tips_m: End of the bone (J, 3) relative to the joint's origin in the rest pose, metres.
        angle_axes: Rest-from-angle-frame quaternions (J, 4): joint angles are measured in these frames (ASF "axis").
        angle_orders: Axes (J) of the joint angles in `rotations.from_euler` order, e.g. "ZYX"; axes about which a joint
            cannot turn are left out, e.g. "X" for a knee, "" for a fixed joint.
    """

    names: tuple[str, ...]
    parents: IntArray
    offsets_m: Array
    tips_m: Array
    angle_axes: Array = field(default_factory=lambda: np.empty((0, 4)))
    angle_orders: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        count = len(self.names)
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "parents", np.asarray(self.parents, dtype=np.int64))
        object.__setattr__(self, "offsets_m", np.asarray(self.offsets_m, dtype=np.float64))
        object.__setattr__(self, "tips_m", np.asarray(self.tips_m, dtype=np.float64))
        if len(self.angle_orders) == 0:
            object.__setattr__(self, "angle_orders", ("ZYX",) * count)
        if len(self.angle_axes) == 0:
            object.__setattr__(self, "angle_axes", rot.identity((count,)))
        self._check(count)

    def _check(self, count: int) -> None:
        if count == 0 or len(set(self.names)) != count:
            raise SkeletonError(
                "a skeleton needs joints with unique names",
                where=", ".join(self.names[:5]),
                advice="give each joint a name of its own",
            )
        shapes = (self.parents.shape, self.offsets_m.shape, self.tips_m.shape, self.angle_axes.shape)
        if shapes != ((count,), (count, 3), (count, 3), (count, 4)) or len(self.angle_orders) != count:
            raise SkeletonError(
                f"parents, offsets, tips and angle axes have shapes {shapes}, and there are "
                f"{counted(len(self.angle_orders), 'angle order')}, which do not fit {counted(count, 'joint')}",
                where="skeleton",
                advice="give one row per joint",
            )
        if self.parents[0] != -1 or np.any(self.parents[1:] < 0) or np.any(self.parents >= np.arange(count)):
            raise SkeletonError(
                "joint 0 is not the only root, or a parent comes after its child",
                where="skeleton",
                advice="sort the joints so that parents come first",
            )
        if not (np.all(np.isfinite(self.offsets_m)) and np.all(np.isfinite(self.tips_m))):
            raise SkeletonError(
                "an offset or a tip of a joint is not finite", where="skeleton", advice="give finite numbers in metres"
            )
        if np.any(np.linalg.norm(self.offsets_m[1:], axis=1) > _LONGEST_BONE_M):
            raise SkeletonError(
                f"a bone is longer than {_LONGEST_BONE_M:g} m", where="skeleton", advice="check the unit of length"
            )
        if not np.all(np.abs(np.linalg.norm(self.angle_axes, axis=1) - 1.0) < 1e-3):
            raise SkeletonError(
                "the angle axes of a joint are not a unit quaternion",
                where="skeleton",
                advice="normalise the quaternion",
            )

    def __len__(self) -> int:
        return len(self.names)

    def index(self, name: str) -> int:
        """Return the index of a joint; for an unknown name, raise a SkeletonError that lists all joints."""
        try:
            return self.names.index(name)
        except ValueError:
            raise SkeletonError(f"there is no joint {name!r}", advice="choose from " + ", ".join(self.names)) from None

    @cached_property
    def levels(self) -> tuple[IntArray, ...]:
        """Joint indices grouped by depth, without the root, for computation level by level."""
        return joint_levels(tuple(self.parents.tolist()))[1:]

    @cached_property
    def leaps(self) -> tuple[tuple[IntArray | slice, IntArray], ...]:
        """Joints and their ancestors, see `joint_leaps`."""
        return joint_leaps(tuple(self.parents.tolist()))

    @cached_property
    def is_ancestor(self) -> Mask:
        """Mask (J, J), true at (i, j) if joint j is joint i or one of its ancestors."""
        result = np.eye(len(self), dtype=bool)
        for joint in range(1, len(self)):
            result[joint] |= result[self.parents[joint]]
        return result

    def carrying(self, joints: IntArray) -> tuple["Skeleton", IntArray]:
        """Return the skeleton of some joints and their ancestors, in order of depth, and their indices in this one."""
        kept = self.is_ancestor[joints].any(axis=0)
        order = np.concatenate([level[kept[level]] for level in joint_levels(tuple(self.parents.tolist()))])
        place = np.full(len(self) + 1, -1)  # the root's parent stays -1
        place[order] = np.arange(len(order))
        names = tuple(self.names[joint] for joint in order)
        return Skeleton(names, place[self.parents[order]], self.offsets_m[order], self.tips_m[order]), order

    @cached_property
    def rest_positions_m(self) -> Array:
        """Joint origins (J, 3) in the rest pose, with the root at the origin."""
        return zero_pose_positions(self.parents, self.offsets_m)


@lru_cache(maxsize=64)
def joint_levels(parents: tuple[int, ...]) -> tuple[IntArray, ...]:
    """Return the joint indices grouped by depth, the root first, for computation level by level."""
    depth: list[int] = []
    for parent in parents:
        depth.append(depth[parent] + 1 if parent >= 0 else 0)
    return tuple(np.flatnonzero(np.array(depth) == level) for level in range(max(depth) + 1))


@lru_cache(maxsize=64)
def joint_leaps(parents: tuple[int, ...]) -> tuple[tuple[IntArray | slice, IntArray], ...]:
    """Return pairs: the joints that have an ancestor 1, 2, 4, ... bones above, and those ancestors.

    One product per pair turns transforms relative to parents into world transforms: each doubles the distance to the
    ancestor to which a joint's transform is relative.
    """
    result: list[tuple[IntArray | slice, IntArray]] = []
    above = np.array(parents)
    while np.any(above >= 0):
        joints = np.flatnonzero(above >= 0)
        # if joints are in order of depth, those this deep come last, so a slice can replace their indices
        result.append((slice(joints[0], None) if len(joints) == len(above) - joints[0] else joints, above[joints]))
        above[joints] = above[above[joints]]
    return tuple(result)


def zero_pose_positions(parents: IntArray, offsets_m: Array) -> Array:
    """Return joint positions (J, 3) in the zero pose, with the root at the origin."""
    positions = np.zeros((len(parents), 3))
    for joint, parent in enumerate(parents):
        if parent >= 0:
            positions[joint] = positions[parent] + offsets_m[joint]
    return positions


def forward_kinematics(skeleton: Skeleton, rotations: ArrayLike, root_position_m: ArrayLike) -> tuple[Array, Array]:
    """Return joint origins and orientations in the world.

    Args:
        rotations: Parent-from-joint quaternions (..., J, 4) relative to rest; the root's is world-from-root.
        root_position_m: World position (..., 3) of the root.

    Returns:
        positions_m (..., J, 3) and world-from-joint quaternions (..., J, 4).
    """
    local = np.asarray(rotations, dtype=np.float64)
    world = np.empty_like(local)
    positions = np.empty((*local.shape[:-1], 3))
    world[..., 0, :] = local[..., 0, :]
    positions[..., 0, :] = root_position_m
    for level in skeleton.levels:
        parents = skeleton.parents[level]
        world[..., level, :] = rot.multiply(world[..., parents, :], local[..., level, :])
        positions[..., level, :] = positions[..., parents, :] + rot.rotate(
            world[..., parents, :], skeleton.offsets_m[level]
        )
    return positions, world


def forward_kinematics_matrices(skeleton: Skeleton, matrices: Array, root_position_m: ArrayLike) -> tuple[Array, Array]:
    """Return joint origins (..., J, 3) and world matrices from local matrices.

    Equivalent to `forward_kinematics`, but cheaper if matrices are available (the solver's inner loop).
    """
    frames = np.zeros((*matrices.shape[:-2], 4, 4))
    frames[..., :3, :3] = matrices
    frames[..., :3, 3] = skeleton.offsets_m
    frames[..., 0, :3, 3] = root_position_m
    frames[..., 3, 3] = 1.0
    for joints, ancestors in skeleton.leaps:
        frames[..., joints, :, :] = frames.take(ancestors, axis=-3) @ frames[..., joints, :, :]
    return frames[..., :3, 3], frames[..., :3, :3]


def marker_positions(
    skeleton: Skeleton, joints: ArrayLike, offsets_m: ArrayLike, rotations: ArrayLike, root_position_m: ArrayLike
) -> Array:
    """Return world positions (..., M, 3) of markers (Chai and Hodgins 2005, Eq. 1).

    Args:
        joints: Index (M,) of the joint that carries each marker.
        offsets_m: Vectors (M, 3) from joint origin to marker in the joint's own axes.
    """
    positions, world = forward_kinematics(skeleton, rotations, root_position_m)
    carriers = np.asarray(joints, dtype=np.int64)
    return positions[..., carriers, :] + rot.rotate(world[..., carriers, :], np.asarray(offsets_m, dtype=np.float64))


def marker_jacobian(skeleton: Skeleton, joints: IntArray, markers_m: Array, positions_m: Array, axes: Array) -> Array:
    """Return d marker / d (root, joint coordinates), shape (..., M, 3, 3 + 3 J).

    A coordinate of joint k turns the markers m below the joint about an axis a through its origin p_k, by a x (m -
    p_k). Other markers do not move.

    Args:
        joints: Joints (M,) that carry the markers.
        markers_m: Marker positions (..., M, 3) of this pose.
        positions_m: Positions (..., J, 3) from `forward_kinematics_matrices`.
        axes: World directions (..., J, 3, 3) of the axes as columns; for rotations varied on the right, R_k exp(d_k),
            these are the world matrices of `forward_kinematics_matrices`.
    """
    # all pairs are computed, because selecting those of a marker and its joints takes longer
    arms = positions_m[..., None, :, :] - markers_m[..., :, None, :]
    arms *= skeleton.is_ancestor[joints][..., None]
    jacobian = np.empty((*markers_m.shape, 1 + len(skeleton), 3))
    jacobian[..., 0, :] = _UNIT
    jacobian[..., 1:, :] = (rot.cross_matrices(arms) @ axes[..., None, :, :, :]).swapaxes(-3, -2)
    return jacobian.reshape(*markers_m.shape, 3 + 3 * len(skeleton))


def joint_angles(skeleton: Skeleton, rotations: ArrayLike) -> list[Array]:
    """Return each joint's angles (..., n), radians, in its `angle_orders`.

    A joint with fewer than three axes is decomposed about all three; only its own axes are returned.
    """
    local = np.asarray(rotations, dtype=np.float64)
    framed = rot.multiply(rot.multiply(rot.conjugate(skeleton.angle_axes), local), skeleton.angle_axes)
    result = []
    for joint, order in enumerate(skeleton.angle_orders):
        full = _completed(order)
        angles = rot.to_euler(framed[..., joint, :], full)
        result.append(angles[..., [full.index(axis) for axis in order]])
    return result


def _completed(order: str) -> str:
    """Return a three-axis order that keeps the given axes in their sequence."""
    for full in ("ZYX", "XYZ", "ZXY", "XZY", "YXZ", "YZX"):
        rest = iter(full)
        if all(axis in rest for axis in order):
            return full
    raise SkeletonError(f"{order!r} is not an Euler order", advice='give each axis at most once, as in "ZYX"')
