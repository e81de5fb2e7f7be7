"""Unit quaternions `[..., 4]`, scalar first (w, x, y, z), and their other forms.

A quaternion `a_from_b` turns vectors: v_a = rotate(a_from_b, v_b). Angles are radians.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from . import quaternion_components as c
from .arrays import Array

_AXES = {"X": 0, "Y": 1, "Z": 2}
_CYCLIC = {"X": (0, 1, 2), "Y": (1, 2, 0), "Z": (2, 0, 1)}
_TINY = np.finfo(np.float64).tiny  # replaces zero lengths in divisions
_FEW = 1 << 11  # array size up to which one product with a constant matrix is faster than one product per entry
_CROSS = np.zeros((3, 9))  # constant matrix that maps vectors to the entries of `cross_matrices`
_CROSS[0, [5, 7]] = _CROSS[1, [6, 2]] = _CROSS[2, [1, 3]] = -1.0, 1.0
_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])
_UNIT = np.eye(3).ravel()


def _table(rows: int, columns: int, text: str) -> Array:
    """Return a matrix of signs; the text of each column lists the rows that it adds or subtracts."""
    result = np.zeros((rows, columns))
    for column, entries in enumerate(text.split()):
        for sign, row in zip(entries[::2], entries[1::2], strict=True):
            result[int(row, 16), column] = 1.0 if sign == "+" else -1.0
    return result


# quaternion @ this gives the flat matrix that multiplies row vectors by the quaternion from the left
_LEFT = _table(4, 16, "+0 +1 +2 +3 -1 +0 +3 -2 -2 -3 +0 +1 -3 +2 -1 +0")
# products (4 i + j) of a quaternion's entries @ this give the flat rotation matrix minus the unit matrix
_MATRIX = 2.0 * _table(16, 9, "-a-f +6-3 +7+2 +6+3 -5-f +b-1 +7-2 +b+1 -5-a")


def identity(shape: Sequence[int] = ()) -> Array:
    """Return identity quaternions with the given leading shape."""
    result = np.zeros((*shape, 4))
    result[..., 0] = 1.0
    return result


def normalize(quaternions: ArrayLike) -> Array:
    """Return quaternions of unit length; a zero quaternion becomes the identity."""
    q = np.asarray(quaternions, dtype=np.float64)
    length = _length(q)
    return np.where(length > 0.0, q / np.where(length > 0.0, length, 1.0), identity())


def _length(vectors: Array) -> Array:
    """Return the lengths (..., 1) of vectors (..., n)."""
    return lengths(vectors)[..., None]


def lengths(vectors: Array) -> Array:
    """Return the lengths (...) of vectors (..., n)."""
    # np.linalg.norm takes several times as long
    return np.asarray(np.sqrt(np.einsum("...i,...i", vectors, vectors)))


def multiply(left: ArrayLike, right: ArrayLike) -> Array:
    """Return the Hamilton product: a_from_c of a_from_b and b_from_c."""
    a = np.asarray(left, dtype=np.float64)
    b = np.asarray(right, dtype=np.float64)
    if max(a.size, b.size) <= _FEW:
        return np.asarray((b[..., None, :] @ (a @ _LEFT).reshape(*a.shape, 4))[..., 0, :])
    result = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for place, values in enumerate(c.multiply(c.components(a), c.components(b))):
        result[..., place] = values
    return result


def left_matrices(quaternions: Array) -> Array:
    """Return the matrices (..., 4, 4) that multiply by quaternions (..., 4) from the left."""
    return np.asarray((quaternions @ _LEFT).reshape(*quaternions.shape, 4).swapaxes(-1, -2))


def conjugate(quaternions: ArrayLike) -> Array:
    """Return the inverse rotations."""
    q = np.asarray(quaternions, dtype=np.float64)
    return q * _CONJUGATE


def rotate(quaternions: ArrayLike, vectors: ArrayLike) -> Array:
    """Return the rotated vectors `[..., 3]`."""
    q = np.asarray(quaternions, dtype=np.float64)
    v = np.asarray(vectors, dtype=np.float64)
    w, u = q[..., :1], q[..., 1:]
    twice = 2.0 * cross(u, v)
    return v + w * twice + cross(u, twice)


def cross(a: Array, b: Array) -> Array:
    """Return the cross products (..., 3)."""
    # several times as fast as np.cross for the few vectors of a forward kinematics step
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    result = np.empty(np.broadcast_shapes(a.shape, b.shape))
    result[..., 0] = ay * bz - az * by
    result[..., 1] = az * bx - ax * bz
    result[..., 2] = ax * by - ay * bx
    return result


def cross_matrices(vectors: Array) -> Array:
    """Return the matrices (..., 3, 3) that take the cross product with vectors (..., 3) from the left."""
    return np.asarray((vectors @ _CROSS).reshape(*vectors.shape, 3))


def from_rotation_vector(vectors: ArrayLike) -> Array:
    """Return the quaternions of rotation vectors (exponential map)."""
    v = np.asarray(vectors, dtype=np.float64)
    half = 0.5 * _length(v)
    safe = np.maximum(half, _TINY)
    result = np.empty((*v.shape[:-1], 4))
    np.cos(half, out=result[..., :1])
    np.multiply(v, 0.5 * np.sin(safe) / safe, out=result[..., 1:])
    return result


def to_rotation_vector(quaternions: ArrayLike) -> Array:
    """Return rotation vectors with angle in [0, pi] (logarithm)."""
    q = np.asarray(quaternions, dtype=np.float64)
    w, vector = q[..., :1], q[..., 1:]
    sine = np.maximum(_length(vector), _TINY)
    factor = 2.0 * np.arctan2(sine, np.abs(w)) / sine
    return np.asarray(vector * np.where(w < 0.0, -factor, factor))


def from_matrix(matrices: ArrayLike) -> Array:
    """Return quaternions of rotation matrices (largest-component method)."""
    m = np.asarray(matrices, dtype=np.float64)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    sx, sy, sz = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    pxy, pxz, pyz = m[..., 0, 1] + m[..., 1, 0], m[..., 0, 2] + m[..., 2, 0], m[..., 1, 2] + m[..., 2, 1]
    # filled in place: np.stack takes longer than the arithmetic
    candidates = np.empty((*m.shape[:-2], 4, 4))
    candidates[..., 0, 0], candidates[..., 1, 1] = 1 + xx + yy + zz, 1 + xx - yy - zz
    candidates[..., 2, 2], candidates[..., 3, 3] = 1 - xx + yy - zz, 1 - xx - yy + zz
    for i, j, value in ((0, 1, sx), (0, 2, sy), (0, 3, sz), (1, 2, pxy), (1, 3, pxz), (2, 3, pyz)):
        candidates[..., i, j] = candidates[..., j, i] = value
    each = candidates.reshape(-1, 4, 4)
    best = np.argmax(np.einsum("nii->ni", each), axis=-1)
    return normalize(each[np.arange(len(each)), best].reshape(*m.shape[:-2], 4))


def to_matrix(quaternions: ArrayLike) -> Array:
    """Return rotation matrices `[..., 3, 3]` of unit quaternions."""
    q = np.asarray(quaternions, dtype=np.float64)
    if q.size <= _FEW:
        products = (q[..., :, None] * q[..., None, :]).reshape(*q.shape[:-1], 16)
        return np.asarray((products @ _MATRIX + _UNIT).reshape(*q.shape[:-1], 3, 3))
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    result = np.empty((*q.shape[:-1], 3, 3))
    result[..., 0, 0] = 1 - 2 * (y * y + z * z)
    result[..., 0, 1] = 2 * (x * y - w * z)
    result[..., 0, 2] = 2 * (x * z + w * y)
    result[..., 1, 0] = 2 * (x * y + w * z)
    result[..., 1, 1] = 1 - 2 * (x * x + z * z)
    result[..., 1, 2] = 2 * (y * z - w * x)
    result[..., 2, 0] = 2 * (x * z - w * y)
    result[..., 2, 1] = 2 * (y * z + w * x)
    result[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return result


def from_euler(angles: ArrayLike, order: str) -> Array:
    """Return rotations from angles `[..., n]`: "ZXY" means Rz @ Rx @ Ry."""
    half = 0.5 * np.asarray(angles, dtype=np.float64)
    result = identity(half.shape[:-1])
    w, parts = result[..., 0], [result[..., 1 + axis] for axis in range(3)]
    for place, name in enumerate(order.upper()):
        sine, cosine = _sine_and_cosine(half[..., place])
        # product with a quaternion that has only two non-zero components
        i, j, k = _CYCLIC[name]
        w, parts[i] = w * cosine - parts[i] * sine, parts[i] * cosine + w * sine
        parts[j], parts[k] = parts[j] * cosine + parts[k] * sine, parts[k] * cosine - parts[j] * sine
    for place, part in enumerate((w, *parts)):
        result[..., place] = part
    return result


def _sine_and_cosine(angles: Array) -> tuple[Array, Array]:
    """Return sines and cosines, several times as fast as NumPy's for many angles."""
    tangents = np.tan(0.5 * angles)
    squares = tangents * tangents
    scales = 1.0 / (1.0 + squares)
    return 2.0 * tangents * scales, (1.0 - squares) * scales


def to_euler(quaternions: ArrayLike, order: str) -> Array:
    """Return the angles `[..., 3]` about three different axes.

    The middle angle lies in [-pi/2, pi/2]; at its ends, in gimbal lock, the last angle is zero.
    """
    m = to_matrix(quaternions)
    i, j, k = (_AXES[axis] for axis in order.upper())
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    middle = np.arcsin(np.clip(sign * m[..., i, k], -1.0, 1.0))
    first = np.arctan2(-sign * m[..., j, k], m[..., k, k])
    last = np.arctan2(-sign * m[..., i, j], m[..., i, i])
    locked = np.abs(m[..., i, k]) > 1.0 - 1e-10
    first = np.where(locked, np.arctan2(sign * m[..., k, j], m[..., j, j]), first)
    return np.stack((first, middle, np.where(locked, 0.0, last)), axis=-1)


def between(sources: ArrayLike, targets: ArrayLike) -> Array:
    """Return the shortest rotations between directions `[..., 3]` of any length."""
    a = np.asarray(sources, dtype=np.float64)
    b = np.asarray(targets, dtype=np.float64)
    a = a / _length(a)
    b = b / _length(b)
    dot = np.sum(a * b, axis=-1, keepdims=True)
    helper = np.where(np.abs(a[..., :1]) < 0.9, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    half_turn = np.concatenate((np.zeros_like(dot), cross(a, helper)), axis=-1)
    return normalize(np.where(dot < -1.0 + 1e-12, half_turn, np.concatenate((1.0 + dot, cross(a, b)), axis=-1)))


def vertical_in(quaternions: ArrayLike) -> Array:
    """Return the world's vertical (..., 3) in the axes of bodies with world-from-body quaternions (..., 4)."""
    q = np.asarray(quaternions, dtype=np.float64)
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    result = np.empty((*q.shape[:-1], 3))
    result[..., 0] = 2.0 * (x * y + w * z)
    result[..., 1] = 1.0 - 2.0 * (x * x + z * z)
    result[..., 2] = 2.0 * (y * z - w * x)
    return result


def angle_between(left: ArrayLike, right: ArrayLike) -> Array:
    """Return the geodesic angles in [0, pi] between rotations."""
    difference = multiply(conjugate(left), right)
    return np.asarray(2.0 * np.arctan2(lengths(difference[..., 1:]), np.abs(difference[..., 0])))


def slerp(start: ArrayLike, end: ArrayLike, fraction: ArrayLike) -> Array:
    """Return rotations on the shortest arc from `start` (0) to `end` (1)."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    t = np.asarray(fraction, dtype=np.float64)
    cosine = np.einsum("...i,...i", a, b)
    angle = np.arccos(np.minimum(np.abs(cosine), 1.0))
    sine, _ = _sine_and_cosine(angle)
    near = sine < 1e-7  # start and end nearly coincide
    safe = np.where(near, 1.0, sine)
    of_start = np.where(near, 1.0 - t, _sine_and_cosine((1.0 - t) * angle)[0] / safe)
    of_end = np.where(near, t, _sine_and_cosine(t * angle)[0] / safe)
    return of_start[..., None] * a + np.where(cosine < 0.0, -of_end, of_end)[..., None] * b


def mean(quaternions: ArrayLike) -> Array:
    """Return the mean rotation over the first axis (Markley 2007)."""
    q = np.asarray(quaternions, dtype=np.float64)
    outer = np.einsum("n...i,n...j->...ij", q, q)
    _, vectors = np.linalg.eigh(outer)
    result: Array = vectors[..., :, -1]
    return np.where(result[..., :1] < 0.0, -result, result)


def continuous(quaternions: ArrayLike) -> Array:
    """Return quaternions `[F, ..., 4]` with signs such that successive frames lie in one hemisphere."""
    q = np.array(quaternions, dtype=np.float64)
    if len(q) > 1:
        flipped = np.einsum("...i,...i", q[1:], q[:-1]) < 0.0
        if flipped.any():
            q[1:] *= np.cumprod(np.where(flipped, -1.0, 1.0), axis=0)[..., None]
    return q


def unwrap_euler(angles: Array) -> Array:
    """Return Euler angles (F, 3) as close as possible to those of the previous frame.

    Angles (a, b, c) about three different axes give the same rotation as (a + pi, pi - b, c + pi).
    """
    other = np.stack((angles[:, 0] + np.pi, np.pi - angles[:, 1], angles[:, 2] + np.pi), axis=1)
    turns = ((form[1:] - angles[:-1] + np.pi) % (2.0 * np.pi) - np.pi for form in (angles, other))
    stay, change = (np.sum(np.abs(turn), axis=1) for turn in turns)
    changed = np.cumsum(change < stay) % 2 == 1
    changed = np.concatenate(([False], changed))
    return np.unwrap(np.where(changed[:, None], other, angles), axis=0)


def swing_twist(quaternions: ArrayLike, axis: ArrayLike) -> tuple[Array, Array]:
    """Split q into (swing, twist) with q = swing * twist, the twist being about the unit vector `axis`."""
    q = np.asarray(quaternions, dtype=np.float64)
    n = np.asarray(axis, dtype=np.float64)
    along = np.sum(q[..., 1:] * n, axis=-1, keepdims=True)
    twist = normalize(np.concatenate((q[..., :1], along * n), axis=-1))
    return multiply(q, conjugate(twist)), twist
