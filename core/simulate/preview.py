"""Pictures and videos made without Blender: a shaded body, and detections drawn on images.

Images are uint8 BGR and are changed in place; poses are as `forward_kinematics` takes them, in a world with the floor
at y = 0.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike

from ..body.skeleton import Skeleton
from ..errors import CaptureError
from ..geometry.arrays import Image
from ..geometry.camera import Camera
from ..vision.sources.image_files import write_image
from .studio.cones import RoundCones
from .studio.limb_outlines import Colour, draw_body, outlines
from .studio.performer_body import make_body
from .studio.studio_rig import looking_at
from .studio.studio_settings import TABLES


@dataclass(frozen=True)
class PreviewStyle:
    """Style of preview pictures; colours are BGR."""

    shadow: tuple[float, float] = (-0.42, -0.40)  # shift of a shadow in x and z per metre of height
    ring: tuple[float, float, float] = (90.0, 230.0, 120.0)  # colour of the rings around detections
    line: tuple[float, float, float] = (92.0, 86.0, 80.0)  # colour of the floor's lines
    gap_px: int = 4  # width of the gaps between pictures
    gap_level: int = 24  # grey level of the gaps


_STYLE = PreviewStyle()


@dataclass(frozen=True)
class CharacterStyle:
    """Colours of a body's trunk, head, left side and right side, and its opacity (0 to 1)."""

    colours: Mapping[str, Colour]
    opacity: float = 1.0
    shadow: bool = True


SOLVED = CharacterStyle(TABLES["preview_colours"])
TRUTH = CharacterStyle(dict.fromkeys(SOLVED.colours, (120.0, 200.0, 120.0)), 0.35, False)


class CharacterPainter:
    """Painter of one skeleton's body as seen by one camera."""

    def __init__(self, camera: Camera, skeleton: Skeleton, style: CharacterStyle = SOLVED) -> None:
        self.camera = camera
        self.style = style
        body = make_body(skeleton)
        self.body = replace(body, materials=tuple(_part(skeleton.names[joint]) for joint in body.joints))

    def draw(self, image: Image, rotations: ArrayLike, root_position_m: ArrayLike) -> None:
        """Draw a pose, given by rotations (J, 4) and root position (3,), with its shadow on the floor."""
        cones = self.body.cones(np.asarray(rotations, dtype=np.float64), np.asarray(root_position_m, dtype=np.float64))
        if self.style.shadow:
            _draw_shadow(image, self.camera, cones)
        drawn = image.copy()
        draw_body(drawn, self.camera, self.body, cones, colours=self.style.colours)
        cv2.addWeighted(drawn, self.style.opacity, image, 1.0 - self.style.opacity, 0.0, dst=image)


def preview_camera(root_positions_m: ArrayLike, size: tuple[int, int] = (640, 480)) -> Camera:
    """Return a virtual camera that sees a whole motion obliquely from the front.

    Args:
        root_positions_m: Root positions (F, 3); the camera leaves room for a body around them.
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
    """Return an empty stage: a backdrop, and lines on the floor every half metre."""
    width, height = camera.image_size
    level = np.linspace(0.0, 1.0, height)[:, None, None]
    shade = (1.0 - level) * np.array([74.0, 66.0, 60.0]) + level * np.array([124.0, 116.0, 110.0])
    picture = np.repeat(np.rint(shade).astype(np.uint8), width, axis=1)
    along = np.linspace(-6.0, 6.0, 49)
    for place in np.arange(-6.0, 6.5, 0.5):
        for x, z in ((place, along), (along, place)):
            points = np.stack(np.broadcast_arrays(x, 0.0, z), axis=-1)
            pixels = camera.project(points[camera.to_camera(points)[:, 2] > 0.3])
            cv2.polylines(picture, [np.rint(pixels * 16.0).astype(np.int32)], False, _STYLE.line, 1, cv2.LINE_AA, 4)
    return picture


def brightened(image: Image) -> Image:
    """Return an image with its dark parts brightened, because a capture's images show little but markers."""
    table = np.rint(255.0 * (np.arange(256) / 255.0) ** 0.55).astype(np.uint8)
    return np.asarray(cv2.LUT(image, table), dtype=np.uint8)


def draw_detections(image: Image, pixels: ArrayLike) -> None:
    """Draw rings around blobs with centres (N, 2), pixels."""
    for x, y in np.asarray(pixels, dtype=np.float64).reshape(-1, 2).tolist():
        cv2.circle(image, (round(x * 16), round(y * 16)), 7 * 16, _STYLE.ring, 1, cv2.LINE_AA, 4)


def draw_caption(image: Image, text: str, detail: str = "") -> None:
    """Write a title into the picture's upper left corner, with a smaller line below."""
    _write(image, text, (12, 24), 0.55, (244.0, 244.0, 244.0))
    if detail:
        _write(image, detail, (12, 44), 0.42, (214.0, 214.0, 214.0))


def side_by_side(*images: Image) -> Image:
    """Return images side by side, scaled to the height of the first, with thin gaps."""
    height = images[0].shape[0]
    row: list[Image] = []
    for image in images:
        width = round(image.shape[1] * height / image.shape[0])
        same = image.shape[0] == height
        row.append(image if same else np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)))
        row.append(np.full((height, _STYLE.gap_px, 3), _STYLE.gap_level, dtype=np.uint8))
    return np.hstack(row[:-1])


def write_contact_sheet(path: str | Path, frames: Sequence[Image], columns: int = 4, width: int = 1600) -> None:
    """Write pictures in rows to one image file (PNG or JPEG), `width` pixels wide.

    Raises:
        CaptureError: There are no pictures, or the file cannot be written.
    """
    if not frames:
        raise CaptureError("there are no pictures for the contact sheet", where=str(path), advice="give at least one")
    columns, gap = min(columns, len(frames)), _STYLE.gap_px
    cell = (width - gap * (columns + 1)) // columns
    height = round(frames[0].shape[0] * cell / frames[0].shape[1])
    rows = -(-len(frames) // columns)
    sheet = np.full((gap + rows * (height + gap), width, 3), _STYLE.gap_level, dtype=np.uint8)
    for i, frame in enumerate(frames):
        top, left = gap + (i // columns) * (height + gap), gap + (i % columns) * (cell + gap)
        sheet[top : top + height, left : left + cell] = cv2.resize(frame, (cell, height), interpolation=cv2.INTER_AREA)
    write_image(path, sheet)


def _part(joint: str) -> str:
    """Return the part of `CharacterStyle.colours` to which a joint belongs."""
    if joint in ("head", "upperneck", "lowerneck"):
        return "head"
    if joint in ("root", "lowerback", "upperback", "thorax", "lclavicle", "rclavicle"):
        return "trunk"
    return {"l": "left", "r": "right"}.get(joint[:1], "trunk")


def _draw_shadow(image: Image, camera: Camera, cones: RoundCones) -> None:
    """Darken the floor where the cones cast a soft shadow."""
    a, b = (ends[:, [0, 2]] + np.maximum(ends[:, 1:2], 0.0) * _STYLE.shadow for ends in (cones.starts, cones.ends))
    flat = outlines(a, b, cones.start_radii, cones.end_radii)
    polygons = camera.project(np.insert(flat, 1, 0.0, axis=-1))
    polygons = polygons[np.isfinite(polygons).all(axis=(1, 2))]  # leaves out cones behind the camera
    mask = np.zeros(image.shape[:2], dtype=np.uint8)
    for polygon in np.rint(np.clip(polygons, -4000.0, 4000.0)).astype(np.int32):
        cv2.fillConvexPoly(mask, polygon, (150.0,))
    soft = cv2.GaussianBlur(mask, (0, 0), 4.0)
    left, top, width, height = cv2.boundingRect(soft)
    part = image[top : top + height, left : left + width]
    shade = soft[top : top + height, left : left + width] * np.float32(0.62 / 255.0)
    part[:] = np.rint(part * (1.0 - shade[..., None])).astype(np.uint8)


def _write(image: Image, text: str, place: tuple[int, int], size: float, colour: tuple[float, float, float]) -> None:
    """Write text with a dark rim, so that it is legible on any background."""
    cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, size, (20.0, 20.0, 20.0), 3, cv2.LINE_AA)
    cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)
