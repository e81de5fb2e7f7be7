"""Room behind the performer as seen by each camera through its lens."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import cv2
import numpy as np

from ...geometry.arrays import Array, Image, IntArray
from ...geometry.camera import Camera
from .lens import undistorted_grid
from .studio_settings import TABLES


@dataclass(frozen=True)
class Box:
    """Axis-aligned box: corners in metres, BGR colour; a lamp emits light."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    colour: tuple[float, float, float]
    lamp: bool = False


FURNITURE = tuple(
    Box(tuple(row["low"]), tuple(row["high"]), tuple(row["colour"]), row.get("lamp", False))
    for row in TABLES["furniture"]
)
MOVED_OBJECT = Box((-1.95, 0.0, -1.9), (-1.5, 0.62, -1.5), (96, 70, 130))
_ROOM = Box((-3.4, 0.0, -2.6), (3.4, 2.8, 6.0), (81.0, 84.0, 82.0))
_CEILING = (150.0, 150.0, 150.0)
_LIGHT = (0.64, 0.89, 0.72)  # brightness of the faces perpendicular to x, y and z


@dataclass(frozen=True)
class RoomView:
    """Empty room as seen by one camera: reflected and emitted light (height, width, 3), grey levels."""

    lit: Array
    shine: Array

    def image(self, light: float) -> Image:
        """Return the picture without noise, uint8 BGR, at a fraction of the full light."""
        picture: Image = np.clip(np.rint(light * self.lit + self.shine), 0, 255).astype(np.uint8)
        return picture


def view_room(camera: Camera, boxes: tuple[Box, ...]) -> RoomView:
    """Return the empty room as the camera sees it, including lens distortion.

    Views of the last few cameras are kept, because drawing one takes longer than drawing the performer 30 times.
    """
    places = (camera.matrix, camera.distortion, camera.rotation, camera.translation_m)
    return _drawn_room(camera.image_size, tuple(map(_numbers, places)), boxes)


def _numbers(values: Array) -> tuple[float, ...]:
    return tuple(values.ravel().tolist())


@lru_cache(maxsize=4)
def _drawn_room(size: tuple[int, int], places: tuple[tuple[float, ...], ...], boxes: tuple[Box, ...]) -> RoomView:
    matrix, distortion, rotation, translation_m = map(np.array, places)
    camera = Camera("", size, matrix.reshape(3, 3), distortion, rotation.reshape(3, 3), translation_m)
    width, height = size
    grid = undistorted_grid(camera, np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    rays, origin = camera.rays(grid).reshape(-1, 3), camera.centre_m
    distance, axis = _faces(origin, rays, _ROOM)[1]
    colour = _walls(origin + distance[:, None] * rays, axis)
    glow = np.zeros_like(colour)
    pixels = np.arange(width * height).reshape(height, width)
    for box in boxes:
        part = pixels[_window(camera, box)].ravel()
        (near, side), (far, _) = _faces(origin, rays[part], box)
        hit = (near <= far) & (near > 0.0) & (near < distance[part])
        part, side = part[hit], side[hit]
        distance[part] = near[hit]
        shown = np.array(box.colour)
        colour[part] = 0.0 if box.lamp else shown * np.array(_LIGHT)[side][:, None]
        glow[part] = shown if box.lamp else 0.0
    lit, shine = (layer.reshape(height, width, 3) for layer in (colour, glow))
    bloom = 0.45 * cv2.GaussianBlur(shine, (0, 0), 9.0)
    soft_lit, soft_shine = (
        np.asarray(cv2.GaussianBlur(layer, (0, 0), 0.7), dtype=np.float64) for layer in (lit, shine)
    )
    return RoomView(soft_lit, soft_shine + bloom)


def _window(camera: Camera, box: Box) -> tuple[slice, slice]:
    """Return rows and columns of the image that can show a box."""
    corners = np.array(list(product(*zip(box.low, box.high, strict=True))))
    if np.any(camera.to_camera(corners)[:, 2] < 0.3):
        return slice(None), slice(None)
    # lens distortion bends the edges between the corners by a few pixels
    low, high = camera.project(corners).min(axis=0) - 12.0, camera.project(corners).max(axis=0) + 12.0
    (left, top), (right, bottom) = np.maximum(low, 0.0).astype(int), np.maximum(high, 0.0).astype(int)
    return slice(int(top), int(bottom) + 1), slice(int(left), int(right) + 1)


def _faces(origin: Array, rays: Array, box: Box) -> tuple[tuple[Array, IntArray], tuple[Array, IntArray]]:
    """Return distance and axis of the faces through which rays (N, 3) enter and leave a box.

    A ray misses the box if it would leave before it enters.
    """
    near, far = [], []
    for column, start, low, high in zip(rays.T, origin, box.low, box.high, strict=True):  # a loop over the axes is fast
        safe = np.where(np.abs(column) < 1e-12, 1e-12, column)
        a, b = (low - start) / safe, (high - start) / safe
        near.append(np.minimum(a, b))
        far.append(np.maximum(a, b))
    enter, leave = np.maximum(np.maximum(*near[:2]), near[2]), np.minimum(np.minimum(*far[:2]), far[2])
    return (enter, _first(near, enter)), (leave, _first(far, leave))


def _first(columns: Sequence[Array], values: Array) -> IntArray:
    """Return, for each value, the index of the first of three columns (N,) that contains it."""
    return np.where(columns[0] == values, 0, np.where(columns[1] == values, 1, 2))


def _walls(points: Array, axis: IntArray) -> Array:
    """Return colours (N, 3) of points on the walls, the plank floor and the ceiling."""
    x, y, z = points.T
    level, low = axis == 1, y < 1.0
    colour = np.array(_ROOM.colour) * (1.0 + 0.06 * y)[:, None]
    colour[level & ~low] = _CEILING
    colour[level & low] = _floor(x[level & low], z[level & low])
    # corners are darker, because less of the room's light reaches them
    corner = np.minimum(np.minimum(x - _ROOM.low[0], _ROOM.high[0] - x), z - _ROOM.low[2])
    edge = np.where(level, corner, np.minimum(y, _ROOM.high[1] - y) + 0.15)
    shaded: Array = colour * (0.74 + 0.26 * np.clip(edge / 0.9, 0.0, 1.0))[:, None]
    return shaded


def _floor(x: Array, z: Array) -> Array:
    """Return colours (N, 3) of planks with random tones."""
    plank = np.floor(x / 0.16)
    along = z / 1.6 + 0.37 * plank
    noise = np.sin(plank * 12.9898 + np.floor(along) * 78.233) * 43758.5453
    tone = 0.78 + 0.10 * (noise - np.floor(noise)) + 0.03 * np.sin(60.0 * x + 4.0 * np.sin(5.0 * z))
    seam = (np.abs(x / 0.16 - plank - 0.5) > 0.475) | (np.abs(along - np.floor(along) - 0.5) > 0.495)
    return np.asarray(np.array([64.0, 84.0, 104.0]) * np.where(seam, 0.62, tone)[:, None])
