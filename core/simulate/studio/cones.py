"""Round cones: spheres swept along segments while their radius changes linearly.

The simulated body consists of them. Points are in world axes, metres.
"""

from dataclasses import dataclass

import numpy as np

from ...geometry.arrays import Array, Mask


@dataclass(frozen=True)
class RoundCones:
    """P round cones: starts and ends (P, 3) of their axes, and their radii (P,) there, metres."""

    starts: Array
    ends: Array
    start_radii: Array
    end_radii: Array

    def __len__(self) -> int:
        return int(self.starts.shape[0])


def first_hits(origin: Array, directions: Array, cones: RoundCones, scale: Array | None = None) -> Array:
    """Return the distance (N, P) along each ray to its first hit on each cone, infinity if it misses.

    The surface is the envelope of the spheres |p - c(s)| = r(s): with F = |p - c(s)|^2 - r(s)^2, the condition
    dF/ds = 0 gives s as a linear function of p, and F = 0 becomes quadratic in the distance.

    Args:
        origin: Start (3,) of the rays; intersections behind it are ignored.
        directions: Unit vectors (N, 3).
        scale: Factors (N, P) for the radii, for each pair of ray and cone.
    """
    scale = np.ones((1, 1)) if scale is None else scale
    r0 = cones.start_radii * scale
    r1 = cones.end_radii * scale
    axis = cones.ends - cones.starts
    to_origin = origin - cones.starts
    dw = directions @ axis.T
    dq = directions @ to_origin.T
    qw = np.sum(to_origin * axis, axis=-1)
    qq = np.sum(to_origin * to_origin, axis=-1)
    growth = r1 - r0
    spread = np.maximum(np.sum(axis * axis, axis=-1) - growth * growth, 1e-12)
    k = qw + growth * r0
    distance, along = _envelope(dw, dq, qq - r0 * r0, k, spread)
    side = np.where((along >= 0.0) & (along <= 1.0) & (distance > 0.0), distance, np.inf)
    start_cap = _sphere(dq, qq - r0 * r0)
    end_q = origin - cones.ends
    end_cap = _sphere(directions @ end_q.T, np.sum(end_q * end_q, axis=-1) - r1 * r1)
    hits: Array = np.minimum(side, np.minimum(start_cap, end_cap))
    return hits


def _envelope(dw: Array, dq: Array, c0: Array, k: Array, spread: Array) -> tuple[Array, Array]:
    """Return the first root of the envelope's quadratic equation, and s there."""
    a = 1.0 - dw * dw / spread
    b = dq - k * dw / spread
    c = c0 - k * k / spread
    root = b * b - a * c
    with np.errstate(invalid="ignore", divide="ignore"):
        distance = (-b - np.sqrt(root)) / a
    distance = np.where((root >= 0.0) & (a > 1e-12), distance, np.inf)
    along = (k + np.where(np.isfinite(distance), distance, 0.0) * dw) / spread
    return distance, along


def _sphere(dq: Array, c: Array) -> Array:
    """Return the first positive distance along rays to spheres: |q|^2 - r^2 = c and d . q = dq."""
    root = dq * dq - c
    with np.errstate(invalid="ignore"):
        distance = -dq - np.sqrt(root)
    return np.where((root >= 0.0) & (distance > 0.0), distance, np.inf)


def axis_distances(points: Array, cones: RoundCones) -> tuple[Array, Array]:
    """Return distances (N, P) of points from the axes, and the cones' radii there."""
    axis = cones.ends - cones.starts
    length2 = np.maximum(np.sum(axis * axis, axis=-1), 1e-12)
    offset = points[:, None, :] - cones.starts
    along = np.clip(np.sum(offset * axis, axis=-1) / length2, 0.0, 1.0)
    nearest = cones.starts + along[..., None] * axis
    distance = np.linalg.norm(points[:, None, :] - nearest, axis=-1)
    radius = cones.start_radii + along * (cones.end_radii - cones.start_radii)
    return distance, radius


def visible(origin: Array, points: Array, cones: RoundCones, margin_m: float) -> Mask:
    """Return a mask (N,) of the points (N, 3) that are visible from `origin` (3,) past the cones.

    A point in or on a cone is a marker worn on that limb, or on a limb that touches it. For this point the cone is made
    thinner until the point is `margin_m` above its surface: the marker is only visible from its own side of the limb.
    """
    distance, radius = axis_distances(points, cones)
    room = np.maximum(distance - margin_m, 0.1 * radius)
    scale = np.minimum(1.0, room / np.maximum(radius, 1e-12))
    ray = points - origin
    length = np.linalg.norm(ray, axis=-1)
    hits = first_hits(origin, ray / length[:, None], cones, scale)
    seen: Mask = np.all(hits >= length[:, None] - margin_m, axis=1)
    return seen
