"""Vectors and quaternions as tuples of components: numbers, or arrays (F,) over frames.

For the legs of a live character, which are computed in every update, plain numbers are ten times as fast as NumPy calls
on arrays of three or four elements. With arrays, the same formulas process all frames of a motion at once.
"""

from typing import Any

import numpy as np

from .arrays import Array

Part = Any  # float or (F,) array
Vector = tuple[Part, Part, Part]
Quaternion = tuple[Part, Part, Part, Part]


def components(array: Array) -> Any:
    """Split an array (n,) into n numbers, or (F, n) into n arrays (F,)."""
    return tuple(array.tolist()) if array.ndim == 1 else tuple(np.moveaxis(array, -1, 0))


def stacked(parts: tuple[Part, ...]) -> Array:
    """Return components as one array, (n,) or (F, n)."""
    return np.array(parts) if isinstance(parts[0], float) else np.stack(np.broadcast_arrays(*parts), axis=-1)


def plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def times(factor: Part, a: Vector) -> Vector:
    return factor * a[0], factor * a[1], factor * a[2]


def dot(a: Vector, b: Vector) -> Part:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def length(a: Vector) -> Part:
    return dot(a, a) ** 0.5


def unit(a: Vector) -> Vector:
    """Return the vector scaled to length one; a zero vector stays zero."""
    return times((dot(a, a) + 1e-18) ** -0.5, a)


def maximum(a: Part, b: Part) -> Part:
    return 0.5 * (a + b + abs(a - b))


def minimum(a: Part, b: Part) -> Part:
    return 0.5 * (a + b - abs(a - b))


def rotate(q: Quaternion, v: Vector) -> Vector:
    u = (q[1], q[2], q[3])
    t = times(2.0, cross(u, v))
    return plus(v, plus(times(q[0], t), cross(u, t)))


def conjugate(q: Quaternion) -> Quaternion:
    """Return the conjugate, which is the inverse rotation of a unit quaternion."""
    return q[0], -q[1], -q[2], -q[3]


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


def unit_quaternion(q: Quaternion) -> Quaternion:
    """Return the quaternion scaled to length one."""
    factor = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] + 1e-18) ** -0.5
    return factor * q[0], factor * q[1], factor * q[2], factor * q[3]


def shortest_turn(a: Vector, b: Vector) -> Quaternion:
    """Return the shortest rotation from one unit vector to another that is not opposite."""
    x, y, z = cross(a, b)
    return unit_quaternion((1.0 + dot(a, b), x, y, z))
