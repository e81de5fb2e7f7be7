"""Body as a smooth shaded solid: rays cut with round cones that melt together."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...geometry.arrays import Array, FloatArray, Image, IntArray
from ...geometry.camera import Camera
from .cones import RoundCones
from .lens import undistorted_grid

_SAMPLES = 2  # rays to a pixel each way
_MELT_M = 0.018  # depth over which surfaces blend where cones meet
_KEY = np.array([0.48, 0.72, 0.50], dtype=np.float32)  # directions to the lights in the world
_FILL = np.array([-0.80, 0.25, 0.55], dtype=np.float32)
_KEY_COLOUR = np.array([0.92, 0.98, 1.0], dtype=np.float32)  # BGR: a warm lamp
_FILL_COLOUR = np.array([1.0, 0.93, 0.86], dtype=np.float32)
_SKY = np.array([0.34, 0.32, 0.31], dtype=np.float32)
_GROUND = np.array([0.15, 0.17, 0.19], dtype=np.float32)


@dataclass(frozen=True)
class _Hit:
    """Hits of one cone: places in the ray grid (n,), distances, normals, colour."""

    places: IntArray
    distance: FloatArray
    normals: FloatArray
    colour: FloatArray


class FigurePainter:
    """Draws bodies into images of one camera."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        width, height = camera.image_size
        xs, ys = (-0.5 + (np.arange(n * _SAMPLES) + 0.5) / _SAMPLES for n in (width, height))
        self._rays = camera.rays(undistorted_grid(camera, xs, ys)).astype(np.float32)
        self._origin = camera.centre_m

    def draw(self, image: Image, cones: RoundCones, colours: Array, opacity: float = 1.0) -> None:
        """Draw a body into the image, in place.

        Args:
            colours: (P, 3) BGR of each cone, 0-255.
            opacity: 1 solid; less lets the image through, for a ghost.
        """
        windows = self._windows(cones)
        if not windows:
            return
        rows = _hull([rows for _, rows, _ in windows])
        columns = _hull([columns for _, _, columns in windows])
        rays = np.ascontiguousarray(self._rays[rows, columns])
        shape = rays.shape[:2]
        hits = []
        for i, own_rows, own_columns in windows:
            inner = _moved(own_rows, -rows.start), _moved(own_columns, -columns.start)
            hits.append(self._hit(cones, i, rays, inner, colours[i].astype(np.float32)))
        layer = np.zeros((shape[0] * shape[1], 4), dtype=np.float32)
        covered, normals, base = _melted(hits, len(layer))
        layer[covered, :3] = _shaded(normals, base, rays.reshape(-1, 3)[covered])
        layer[covered, 3] = 1.0
        half = (shape[1] // _SAMPLES, shape[0] // _SAMPLES)
        shown = cv2.resize(layer.reshape(*shape, 4), half, interpolation=cv2.INTER_AREA)
        top, left = rows.start // _SAMPLES, columns.start // _SAMPLES
        patch = image[top : top + half[1], left : left + half[0]]
        mixed = patch * (1.0 - np.float32(opacity) * shown[..., 3:]) + np.float32(opacity) * shown[..., :3]
        patch[:] = (mixed + np.float32(0.5)).astype(np.uint8)

    def _hit(
        self, cones: RoundCones, index: int, all_rays: FloatArray, window: tuple[slice, slice], colour: FloatArray
    ) -> _Hit:
        rays = all_rays[window]
        start, r0 = cones.starts[index] - self._origin, float(cones.start_radii[index])
        axis, growth = cones.ends[index] - cones.starts[index], float(cones.end_radii[index]) - r0
        distance, along = _cut(rays, -start, axis, r0, growth)
        mask = np.isfinite(distance)
        down, across = np.nonzero(mask)
        places = (down + window[0].start) * all_rays.shape[1] + across + window[1].start
        distance, along = distance[mask], along[mask]
        centres = start.astype(np.float32) + along[:, None] * axis.astype(np.float32)
        normals = distance[:, None] * rays[mask] - centres
        normals /= (np.float32(r0) + np.float32(growth) * along)[:, None]
        return _Hit(places, distance, normals, colour)

    def _windows(self, cones: RoundCones) -> list[tuple[int, slice, slice]]:
        """Return the cones before the camera with the grid's rows and columns they cover."""
        ends = np.stack((cones.starts, cones.ends), axis=1)
        radii = np.stack((cones.start_radii, cones.end_radii), axis=1)
        depth = self.camera.to_camera(ends)[..., 2]
        seen = np.all(depth > 2.0 * radii + 0.05, axis=1)
        reach = 1.15 * self.camera.focal_px * radii / np.maximum(depth - radii, 0.05) + 2.0
        pixels = np.nan_to_num(self.camera.project(ends))
        size = np.array(self.camera.image_size)
        low = np.clip(np.floor((pixels - reach[..., None]).min(axis=1)), 0, size).astype(int) * _SAMPLES
        high = np.clip(np.ceil((pixels + reach[..., None]).max(axis=1)) + 1, 0, size).astype(int) * _SAMPLES
        seen &= np.all(low < high, axis=1)
        return [(int(i), slice(low[i, 1], high[i, 1]), slice(low[i, 0], high[i, 0])) for i in np.flatnonzero(seen)]


def _cut(rays: FloatArray, q: Array, w: Array, r0: float, growth: float) -> tuple[FloatArray, FloatArray]:
    """Return distances to one cone's first hits and places along its axis (0..1).

    See `cones.first_hits`.
    """
    dw, dq = rays @ w.astype(np.float32), rays @ q.astype(np.float32)
    spread = max(float(w @ w) - growth * growth, 1e-9)
    k, qq, qw = float(q @ w) + growth * r0, float(q @ q), float(q @ w)
    a = 1.0 - dw * dw / spread
    b = dq - k * dw / spread
    root = b * b - a * (qq - r0 * r0 - k * k / spread)
    side = np.where((root > 0.0) & (a > 1e-6), (-b - np.sqrt(np.maximum(root, 0.0))) / np.maximum(a, 1e-6), np.inf)
    along = (k + np.where(np.isfinite(side), side, 0.0) * dw) / spread
    side = np.where((along >= 0.0) & (along <= 1.0) & (side > 0.0), side, np.inf)
    first = _ball(dq, qq - r0 * r0)
    last = _ball(dq - dw, qq - 2.0 * qw + float(w @ w) - (r0 + growth) ** 2)
    caps = np.minimum(first, last)
    place = np.where(side <= caps, np.clip(along, 0.0, 1.0), np.where(first <= last, 0.0, 1.0))
    return np.minimum(side, caps).astype(np.float32), place.astype(np.float32)


def _ball(dq: FloatArray, c: float) -> FloatArray:
    root = dq * dq - c
    distance = -dq - np.sqrt(np.maximum(root, 0.0))
    return np.where((root > 0.0) & (distance > 0.0), distance, np.inf).astype(np.float32)


def _melted(hits: list[_Hit], places: int) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return covered places (n,), normals and colours (n, 3) of the nearest surfaces.

    Surfaces close behind are blended in.
    """
    nearest = np.full(places, np.inf, dtype=np.float32)
    for hit in hits:
        nearest[hit.places] = np.minimum(nearest[hit.places], hit.distance)
    covered = np.flatnonzero(np.isfinite(nearest))
    order = np.zeros(places, dtype=np.int64)
    order[covered] = np.arange(len(covered))
    normals = np.zeros((len(covered), 3), dtype=np.float32)
    base, weights = np.zeros_like(normals), np.zeros((len(covered), 1), dtype=np.float32)
    for hit in hits:
        behind = nearest[hit.places] - hit.distance
        close = behind > -4.0 * _MELT_M
        weight = np.exp(behind[close] / np.float32(_MELT_M))[:, None]
        rows = order[hit.places[close]]
        normals[rows] += weight * hit.normals[close]
        base[rows] += weight * hit.colour
        weights[rows] += weight
    normals /= np.maximum(np.sqrt(np.einsum("ij,ij->i", normals, normals)), 1e-9)[:, None]
    return covered, normals, base / weights


def _shaded(normals: FloatArray, base: FloatArray, rays: FloatArray) -> FloatArray:
    """Return the colour of a matt surface under a key light, a fill light and the sky."""
    key = np.clip((normals @ _KEY + 0.12) / 1.12, 0.0, 1.0)[..., None]
    fill = np.clip(normals @ _FILL, 0.0, 1.0)[..., None]
    up = (0.5 + 0.5 * normals[..., 1])[..., None]
    facing = np.clip(-np.sum(normals * rays, axis=-1), 0.0, 1.0)[..., None]
    light = 0.78 * key * _KEY_COLOUR + 0.24 * fill * _FILL_COLOUR + up * _SKY + (1.0 - up) * _GROUND
    half = _KEY - rays
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    gloss = np.clip(np.sum(normals * half, axis=-1), 0.0, 1.0)[..., None] ** 28
    # surfaces that turn away get darker at first and catch the sky at the very edge
    edge = 0.80 + 0.20 * np.minimum(facing / 0.45, 1.0)
    rim = (1.0 - facing) ** 4 * up * 46.0
    colour: FloatArray = (base * light * edge + 26.0 * gloss + rim).astype(np.float32)
    return np.minimum(colour, np.float32(255.0))


def _hull(spans: list[slice]) -> slice:
    return slice(min(span.start for span in spans), max(span.stop for span in spans))


def _moved(span: slice, by: int) -> slice:
    return slice(span.start + by, span.stop + by)
