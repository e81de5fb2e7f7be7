"""Marker positions for many poses at once (Eq. 1 of Chai and Hodgins 2005)."""

import numpy as np

from ..body.skeleton import Skeleton
from ..geometry.arrays import Array, FloatArray, IntArray
from ..geometry.quaternion_components import Quaternion, Vector, multiply
from ..kernel.library import address, checked, contiguous, function, stage

_CHUNK = 8192  # poses per chunk: few enough for the CPU's cache, many enough to keep NumPy's overhead small
_SMALLEST_RAD = 1e-12
_ORIGIN = (np.zeros(()), np.zeros(()), np.zeros(()))


_AT_REST = function("markers_at_rest", "ppppp")


def _compiled(
    skeleton: Skeleton, joints: IntArray, offsets_m: Array, mean_rotations: Array, poses: FloatArray
) -> FloatArray:
    carrying = _carrying(skeleton, joints)
    place = np.full(len(skeleton), -1)  # the root is none of them
    place[carrying] = np.arange(len(carrying))
    sizes = np.array([len(poses), 3 * (len(skeleton) - 1), len(carrying), len(joints)])
    indices = np.concatenate((place[skeleton.parents[carrying]], 3 * (carrying - 1), place[joints]))
    lengths = (mean_rotations[carrying], skeleton.offsets_m[carrying], offsets_m)
    result = np.empty((len(poses), len(joints), 3), dtype=np.float32)
    given = address(sizes), address(indices), address(np.concatenate([each.ravel() for each in lengths]))
    checked(_AT_REST(*given, contiguous(poses, np.float32), address(result)))
    return result


def _carrying(skeleton: Skeleton, joints: IntArray) -> IntArray:
    """Return the joints, parents first, that can move what these joints carry, without the root."""
    return np.flatnonzero(skeleton.is_ancestor[joints].any(axis=0))[1:]


@stage(_compiled)
def markers_at_rest(
    skeleton: Skeleton, joints: IntArray, offsets_m: Array, mean_rotations: Array, poses: FloatArray
) -> FloatArray:
    """Return the markers (F, M, 3), metres, of poses with the root at rest.

    Equivalent to `rotations_from_pose` and `skeleton.marker_positions` in a seventh of the time: each component of a
    rotation is an array over all poses, and joints without markers on or below them are skipped.

    Args:
        joints: Joint (M,) of each marker.
        offsets_m: Vectors (M, 3) from joint origin to marker in the joint's axes.
        mean_rotations: Rotations (J, 4) that the poses are relative to.
        poses: Rotation vectors (F, J - 1, 3).
    """
    carrying = _carrying(skeleton, joints).tolist()
    result = np.empty((len(poses), len(joints), 3), dtype=np.float32)
    for start in range(0, len(poses), _CHUNK):
        part = slice(start, start + _CHUNK)
        vectors = np.ascontiguousarray(poses[part].transpose(1, 2, 0), dtype=np.float64)
        world: dict[int, Quaternion] = {}
        origins: dict[int, Vector] = {0: _ORIGIN}
        for joint in carrying:
            parent = int(skeleton.parents[joint])
            turn = multiply(tuple(mean_rotations[joint]), _exponential(vectors[joint - 1]))
            world[joint] = multiply(world[parent], turn) if parent else turn
            origins[joint] = _moved(origins[parent], world.get(parent), skeleton.offsets_m[joint])
        for marker, joint in enumerate(joints.tolist()):
            place = _moved(origins[joint], world.get(joint), offsets_m[marker])
            for axis, values in enumerate(place):
                result[part, marker, axis] = values
    return result


def _exponential(vectors: Array) -> Quaternion:
    """Return the rotations (3, F) by |v| about v."""
    x, y, z = vectors
    angle = np.sqrt(x * x + y * y + z * z)
    factor = np.sin(0.5 * angle) / np.maximum(angle, _SMALLEST_RAD)
    return np.cos(0.5 * angle), x * factor, y * factor, z * factor


def _moved(origin: Vector, turn: Quaternion | None, offset_m: Array) -> Vector:
    """Return an origin (3, F) plus a rotated offset (3,); if the rotation is None, the offset is not rotated."""
    a, b, c = offset_m
    ox, oy, oz = origin
    if turn is None:
        return ox + a, oy + b, oz + c
    w, x, y, z = turn
    u, v, t = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return ox + (a + w * u + (y * t - z * v)), oy + (b + w * v + (z * u - x * t)), oz + (c + w * t + (x * v - y * u))
