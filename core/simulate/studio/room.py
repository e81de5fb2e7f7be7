"""Room behind the performer, seen exactly through each camera's lens."""

from dataclasses import dataclass
from itertools import product
from typing import Any

import cv2
import numpy as np

from ...geometry.arrays import Array, Image, IntArray
from ...geometry.camera import Camera
from .lens import undistorted_grid
from .studio_settings import TABLES


@dataclass(frozen=True)
class Box:
    """Box with edges along the axes: corners in metres, BGR colour, shining or not."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    colour: tuple[float, float, float]
    lamp: bool = False


_ROOM_LOW, _ROOM_HIGH = (-3.4, 0.0, -2.6), (3.4, 2.8, 6.0)
_LIGHT = np.array([-0.35, 0.8, 0.49])

_BOOKS = ((60, 60, 140), (120, 90, 50), (60, 110, 70), (110, 120, 130), (40, 60, 100), (130, 80, 90), (70, 130, 150))


def _books(height: float, width: float, count: int) -> tuple[Box, ...]:
    """Books that stand on a board of the shelf at a height, metres."""
    return tuple(
        Box(
            (1.85 + width * i, height, -2.5),
            (1.85 + width * (i + 0.85), height + 0.22 + 0.035 * (i * 5 % 4), -2.25),
            _BOOKS[i * 3 % len(_BOOKS)],
        )
        for i in range(count)
    )


def _furniture(row: dict[str, Any]) -> tuple[Box, ...]:
    if "books" in row:
        return _books(*row["books"])
    low, high, colour = (tuple(row[key]) for key in ("low", "high", "colour"))
    return (Box(low, high, colour, "lamp" in row),)


FURNITURE = tuple(box for row in TABLES["furniture"] for box in _furniture(row))
MOVED_OBJECT = Box((-1.95, 0.0, -1.9), (-1.5, 0.62, -1.5), (96, 70, 130))


@dataclass(frozen=True)
class RoomView:
    """Room in one camera: lit and shining parts, (height, width, 3) grey levels."""

    lit: Array
    shine: Array

    def image(self, light: float) -> Image:
        """Return the picture without noise, uint8 BGR, under a share of the full light."""
        picture: Image = np.clip(np.rint(light * self.lit + self.shine), 0, 255).astype(np.uint8)
        return picture


def view_room(camera: Camera, boxes: tuple[Box, ...]) -> RoomView:
    """Return the empty room as the camera sees it.

    Every pixel's ray is bent by the lens, so straight walls look as curved as the camera makes them.
    """
    width, height = camera.image_size
    grid = undistorted_grid(camera, np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    rays = camera.rays(grid).reshape(-1, 3)
    origin = camera.centre_m
    distance, axis = _exit(origin, rays)
    colour = _shell(origin + distance[:, None] * rays, axis)
    glow = np.zeros_like(colour)
    pixels = np.arange(width * height).reshape(height, width)
    for box in boxes:
        part = pixels[_window(camera, box)].ravel()
        near, side = _entry(origin, rays[part], box)
        hit = near < distance[part]
        part, near, side = part[hit], near[hit], side[hit]
        distance[part] = near
        colour[part] = 0.0 if box.lamp else _box_colour(box, origin + near[:, None] * rays[part], side)
        glow[part] = np.array(box.colour) if box.lamp else 0.0
    lit, shine = (layer.reshape(height, width, 3) for layer in (colour, glow))
    bloom = 0.45 * cv2.GaussianBlur(shine.astype(np.float32), (0, 0), 9.0)
    soft_lit, soft_shine = (
        np.asarray(cv2.GaussianBlur(layer, (0, 0), 0.7), dtype=np.float64) for layer in (lit, shine)
    )
    return RoomView(soft_lit, soft_shine + bloom)


def _window(camera: Camera, box: Box) -> tuple[slice, slice]:
    """Rows and columns of the image that can show a box."""
    corners = np.array(list(product(*zip(box.low, box.high, strict=True))))
    if np.any(camera.to_camera(corners)[:, 2] < 0.3):
        return slice(None), slice(None)
    # lens distortion bends the edges between the corners by a few pixels
    low, high = camera.project(corners).min(axis=0) - 12.0, camera.project(corners).max(axis=0) + 12.0
    (left, top), (right, bottom) = np.maximum(low, 0.0).astype(int), np.maximum(high, 0.0).astype(int)
    return slice(int(top), int(bottom) + 1), slice(int(left), int(right) + 1)


def _exit(origin: Array, rays: Array) -> tuple[Array, IntArray]:
    """Return the rays' distance to the room's walls from inside, and the wall's axis."""
    safe = np.where(np.abs(rays) < 1e-12, 1e-12, rays)
    wall = np.where(safe > 0.0, np.array(_ROOM_HIGH), np.array(_ROOM_LOW))
    distances = (wall - origin) / safe
    axis = np.argmin(distances, axis=1)
    return np.take_along_axis(distances, axis[:, None], axis=1)[:, 0], axis


def _entry(origin: Array, rays: Array, box: Box) -> tuple[Array, IntArray]:
    """Return the rays' distance to a box (infinity: missed), and the face's axis."""
    safe = np.where(np.abs(rays) < 1e-12, 1e-12, rays)
    a, b = (np.array(box.low) - origin) / safe, (np.array(box.high) - origin) / safe
    near, far = np.minimum(a, b), np.maximum(a, b)
    axis = np.argmax(near, axis=1)
    entry = near.max(axis=1)
    return np.where((entry <= far.min(axis=1)) & (entry > 0.0), entry, np.inf), axis


def _shell(points: Array, axis: IntArray) -> Array:
    """Colour (N, 3) of walls, floor and ceiling at points on them."""
    level = axis == 1
    low, high = level & (points[:, 1] < 1.0), level & (points[:, 1] >= 1.0)
    colour = np.empty_like(points)
    colour[~level] = _wall(*points[~level].T)
    colour[low] = _floor(points[low, 0], points[low, 2])
    colour[high] = 150.0
    # corners are darker: less of the room's light reaches them
    x, y, z = points.T
    corner = np.minimum(np.minimum(x - _ROOM_LOW[0], _ROOM_HIGH[0] - x), z - _ROOM_LOW[2])
    edge = np.where(level, corner, np.minimum(y, _ROOM_HIGH[1] - y) + 0.15)
    shaded: Array = colour * (0.74 + 0.26 * np.clip(edge / 0.9, 0.0, 1.0))[:, None]
    return shaded


def _wall(x: Array, y: Array, z: Array) -> Array:
    grain = 1.2 * np.sin(2.3 * x + 1.7 * z + 2.0 * np.sin(1.9 * y)) + 0.8 * np.sin(5.1 * y + 3.3 * x)
    wall = np.array([112.0, 116.0, 114.0]) * (0.72 + 0.12 * y / _ROOM_HIGH[1])[:, None] + grain[:, None]
    return np.where((y < 0.11)[:, None], np.array([132.0, 138.0, 140.0]) * 0.7, wall)  # the skirting board


def _floor(x: Array, z: Array) -> Array:
    plank = np.floor(x / 0.16)
    along = z / 1.6 + 0.37 * plank
    tone = 0.78 + 0.10 * _scatter(plank, np.floor(along)) + 0.03 * np.sin(60.0 * x + 4.0 * np.sin(5.0 * z))
    seam = (np.abs(x / 0.16 - plank - 0.5) > 0.475) | (np.abs(along - np.floor(along) - 0.5) > 0.495)
    return np.asarray(np.array([64.0, 84.0, 104.0]) * np.where(seam, 0.62, tone)[:, None])


def _box_colour(box: Box, points: Array, side: IntArray) -> Array:
    light = 0.45 + 0.55 * np.abs(_LIGHT)[side]
    grain = 1.0 + 0.02 * np.sin(90.0 * points[:, 1] + 2.0 * np.sin(9.0 * points[:, 0]))
    return np.asarray(np.array(box.colour) * (light * grain)[:, None])


def _scatter(a: Array, b: Array) -> Array:
    """Return a number in [0, 1) that looks random for each pair of whole numbers."""
    value = np.sin(a * 12.9898 + b * 78.233) * 43758.5453
    return np.asarray(value - np.floor(value))
