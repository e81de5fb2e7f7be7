"""Pictures and videos without Blender: shaded figure, detections on images.

Images are uint8 BGR and are drawn into in place; poses are as in `forward_kinematics`, world metres, floor y = 0.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike

from ..body.skeleton import Skeleton
from ..errors import CaptureError
from ..geometry.arrays import Array, Image
from ..geometry.camera import Camera
from ..vision.sources.image_files import write_image
from .studio.lens import undistorted_grid
from .studio.limb_outlines import Colour, draw_body, outlines
from .studio.performer_body import Body, make_body
from .studio.studio_rig import looking_at
from .studio.studio_settings import TABLES

_LIGHT_SLOPE = np.array([-0.42, -0.40])  # how far a shadow falls in x and z per metre of height
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_LIFT = 0.55  # exponent that lifts dark parts
_RING = (90.0, 230.0, 120.0)


@dataclass(frozen=True)
class CharacterStyle:
    """Colours of a character's trunk, head, left and right; its opacity (0..1)."""

    colours: Mapping[str, Colour]
    opacity: float = 1.0
    shadow: bool = True


SOLVED = CharacterStyle(TABLES["preview_colours"])
TRUTH = CharacterStyle(dict.fromkeys(SOLVED.colours, (120.0, 200.0, 120.0)), 0.35, False)


class CharacterPainter:
    """Draws one skeleton's body as one camera sees it; keep it for many frames."""

    def __init__(self, camera: Camera, skeleton: Skeleton, style: CharacterStyle = SOLVED) -> None:
        self.camera = camera
        self.style = style
        body = make_body(skeleton)
        self.body = replace(body, materials=tuple(_part(skeleton.names[joint]) for joint in body.joints))

    def draw(self, image: Image, rotations: ArrayLike, root_position_m: ArrayLike) -> None:
        """Draw a pose, rotations (J, 4) and root (3,), with its shadow on the floor."""
        cones = self.body.cones(np.asarray(rotations, dtype=np.float64), np.asarray(root_position_m, dtype=np.float64))
        if self.style.shadow:
            _draw_shadow(image, self.camera, self.body, cones.starts, cones.ends)
        drawn = image.copy()
        draw_body(drawn, self.camera, self.body, cones, colours=self.style.colours)
        cv2.addWeighted(drawn, self.style.opacity, image, 1.0 - self.style.opacity, 0.0, dst=image)


def preview_camera(root_positions_m: ArrayLike, size: tuple[int, int] = (640, 480)) -> Camera:
    """Return a virtual camera that sees a whole motion from the front and one side.

    Args:
        root_positions_m: (F, 3) path of the root; the camera frames it with room for a body about it.
    """
    path = np.asarray(root_positions_m, dtype=np.float64).reshape(-1, 3)
    middle = 0.5 * (path.min(axis=0) + path.max(axis=0))
    extent = path.max(axis=0) - path.min(axis=0)
    focal = 1.8 * size[1]
    wide = (0.5 * extent[0] + 0.9) / (0.5 * size[0] / focal)
    high = (0.5 * extent[1] + 1.03) / (0.5 * size[1] / focal)
    distance = max(wide, high) + 0.5 * extent[2] + 0.15
    target = np.array([middle[0], 0.88 + 0.5 * extent[1], middle[2]])
    place = target + distance * np.array([0.40, 0.14, 0.905])
    rotation = looking_at(place, target)
    matrix = np.array([[focal, 0.0, 0.5 * (size[0] - 1)], [0.0, focal, 0.5 * (size[1] - 1)], [0.0, 0.0, 1.0]])
    return Camera("preview", size, matrix, np.zeros(5), rotation, -rotation @ place)


def floor_image(camera: Camera) -> Image:
    """Return an empty stage: a floor y = 0 with lines every half metre."""
    width, height = camera.image_size
    grid = undistorted_grid(camera, np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    rays = camera.rays(grid)
    down = np.minimum(rays[..., 1], -1e-6)
    distance = -camera.centre_m[1] / down
    x, z = (camera.centre_m[i] + distance * rays[..., i] for i in (0, 2))
    fade = np.clip(1.0 - np.hypot(x, z - 0.3) / 6.0, 0.0, 1.0) ** 1.5 * (rays[..., 1] < -1e-6)
    level = np.linspace(0.0, 1.0, height)[:, None, None]
    backdrop = (1.0 - level) * np.array([74.0, 66.0, 60.0]) + level * np.array([112.0, 104.0, 98.0])
    backdrop = np.broadcast_to(backdrop, (height, width, 3))
    floor = np.array([128.0, 121.0, 115.0]) * np.ones_like(backdrop)
    lines = np.maximum(0.55 * _lines(x, z, distance, camera, 0.5), _lines(x, z, distance, camera, 1.0))
    floor = floor - 34.0 * lines[..., None]
    picture = backdrop + fade[..., None] * (floor - backdrop)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def brightened(image: Image) -> Image:
    """Return a camera's image with its dark parts lifted.

    Marker cameras are set to show little besides the markers.
    """
    table = np.rint(255.0 * (np.arange(256) / 255.0) ** _LIFT).astype(np.uint8)
    return np.asarray(cv2.LUT(image, table), dtype=np.uint8)


def draw_detections(image: Image, pixels: ArrayLike) -> None:
    """Ring blobs in an image: centres (N, 2) in pixels."""
    for x, y in np.asarray(pixels, dtype=np.float64).reshape(-1, 2).tolist():
        cv2.circle(image, (round(x * 16), round(y * 16)), 7 * 16, _RING, 1, cv2.LINE_AA, 4)


def draw_caption(image: Image, text: str, detail: str = "") -> None:
    """Write a title into the picture's upper left corner, with a smaller line below."""
    _write(image, text, (12, 24), 0.55, (244.0, 244.0, 244.0))
    if detail:
        _write(image, detail, (12, 44), 0.42, (214.0, 214.0, 214.0))


def side_by_side(*images: Image) -> Image:
    """Return images side by side at the height of the first, with thin gaps."""
    height = images[0].shape[0]
    row: list[Image] = []
    for image in images:
        width = round(image.shape[1] * height / image.shape[0])
        same = image.shape[0] == height
        row.append(image if same else np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)))
        row.append(np.full((height, 4, 3), 24, dtype=np.uint8))
    return np.hstack(row[:-1])


def write_contact_sheet(path: str | Path, frames: Sequence[Image], columns: int = 4, width: int = 1600) -> None:
    """Write pictures in rows as one image file (PNG or JPEG), `width` pixels wide.

    Raises:
        CaptureError: no pictures, or the file cannot be written.
    """
    if not frames:
        raise CaptureError("there are no pictures for the contact sheet", where=str(path))
    columns = min(columns, len(frames))
    gap = 4
    cell = (width - gap * (columns + 1)) // columns
    height = round(frames[0].shape[0] * cell / frames[0].shape[1])
    rows = -(-len(frames) // columns)
    sheet = np.full((gap + rows * (height + gap), width, 3), 24, dtype=np.uint8)
    for i, frame in enumerate(frames):
        top, left = gap + (i // columns) * (height + gap), gap + (i % columns) * (cell + gap)
        sheet[top : top + height, left : left + cell] = cv2.resize(frame, (cell, height), interpolation=cv2.INTER_AREA)
    write_image(path, sheet)


def _part(joint: str) -> str:
    """Return the part of `CharacterStyle.colours` that a joint belongs to."""
    if joint in ("head", "upperneck", "lowerneck"):
        return "head"
    if joint in ("root", "lowerback", "upperback", "thorax", "lclavicle", "rclavicle"):
        return "trunk"
    return {"l": "left", "r": "right"}.get(joint[:1], "trunk")


def _draw_shadow(image: Image, camera: Camera, body: Body, starts: Array, ends: Array) -> None:
    """Darken the floor below the body, most where the body nearly touches it."""
    mask = np.zeros(image.shape[:2], dtype=np.uint8)
    contact = np.zeros_like(mask)
    _fill(mask, _floor_outlines(camera, body, starts, ends, _LIGHT_SLOPE), 150.0)
    near = np.minimum(starts[:, 1] - body.start_radii_m, ends[:, 1] - body.end_radii_m) < 0.05
    _fill(contact, _floor_outlines(camera, body, starts, ends, np.zeros(2))[near], 190.0)
    left, top, width, height = cv2.boundingRect(cv2.max(mask, contact))
    if width == 0:
        return
    pad = 14
    part = slice(max(top - pad, 0), top + height + pad), slice(max(left - pad, 0), left + width + pad)
    soft = cv2.max(cv2.GaussianBlur(mask[part], (0, 0), 4.0), cv2.GaussianBlur(contact[part], (0, 0), 2.5))
    image[part] = np.rint(image[part] * (1.0 - (soft * np.float32(0.62 / 255.0))[..., None])).astype(np.uint8)


def _floor_outlines(camera: Camera, body: Body, starts: Array, ends: Array, slope: Array) -> Array:
    """Return the cones' shadows on the floor (P, K, 2), pixels; light along `slope`."""
    a, b = (ends_[:, [0, 2]] + np.maximum(ends_[:, 1:2], 0.0) * slope for ends_ in (starts, ends))
    flat = outlines(a, b, body.start_radii_m, body.end_radii_m)
    return camera.project(np.stack((flat[..., 0], np.zeros(flat.shape[:2]), flat[..., 1]), axis=-1))


def _fill(mask: Image, polygons: Array, value: float) -> None:
    """Fill polygons (P, K, 2), pixels, except those with points behind the camera."""
    for polygon in polygons:
        if np.all(np.isfinite(polygon)):
            limited = np.clip(polygon, -4000.0, 4000.0)
            cv2.fillConvexPoly(mask, np.rint(limited * 16).astype(np.int32), (value,), cv2.LINE_AA, 4)


def _lines(x: Array, z: Array, distance: Array, camera: Camera, spacing: float) -> Array:
    """Strength 0..1 of grid lines about a pixel and a half wide."""
    strength = np.zeros_like(x)
    for value in (x, z):
        off = np.abs(value / spacing - np.round(value / spacing)) * spacing
        along_rows, along_columns = np.gradient(value)
        pixel = np.maximum(np.hypot(along_rows, along_columns), 1e-9)
        strength = np.maximum(
            strength, np.clip(1.3 - off / pixel, 0.0, 1.0) * np.clip(spacing / (4.0 * pixel), 0.0, 1.0)
        )
    return strength


def _write(image: Image, text: str, place: tuple[int, int], size: float, colour: tuple[float, float, float]) -> None:
    """Write text with a dark rim, so that it is read on any ground."""
    cv2.putText(image, text, place, _FONT, size, (20.0, 20.0, 20.0), 3, cv2.LINE_AA)
    cv2.putText(image, text, place, _FONT, size, colour, 1, cv2.LINE_AA)
