"""Fast drawing of a body: nested outlines of each round cone, brighter towards the light."""

from collections.abc import Mapping

import cv2
import numpy as np

from ...geometry.arrays import Array, Image
from ...geometry.camera import Camera
from .cones import RoundCones
from .performer_body import Body
from .studio_settings import TABLES

_ARC = np.linspace(0.0, 1.0, 9)
_LAYERS = ((1.0, 0.62), (0.78, 0.92), (0.48, 1.12))  # scale of the outline, brightness
_LIGHT = np.array([-0.45, -0.75])  # direction to the light in the image (x right, y down)

Colour = tuple[float, float, float]  # BGR, 0-255

COLOURS: dict[str, Colour] = TABLES["colours"]


def outlines(a: Array, b: Array, ra: Array, rb: Array) -> Array:
    """Return outlines (N, K, 2) around pairs of circles.

    Args:
        a: Centres (N, 2) of the first circles.
        b: Centres (N, 2) of the second circles.
        ra: Radii (N,) of the first circles.
        rb: Radii (N,) of the second circles.
    """
    axis = b - a
    length = np.maximum(np.hypot(axis[:, 0], axis[:, 1]), 1e-9)
    heading = np.arctan2(axis[:, 1], axis[:, 0])[:, None]
    # the common tangents touch both circles at this angle from the axis; if one contains the other, there are none
    opening = np.arccos(np.clip((ra - rb) / length, -1.0, 1.0))[:, None]
    angle_b = heading - opening + 2.0 * opening * _ARC
    angle_a = heading + opening + 2.0 * (np.pi - opening) * _ARC
    circle_b = b[:, None] + rb[:, None, None] * np.stack((np.cos(angle_b), np.sin(angle_b)), axis=-1)
    circle_a = a[:, None] + ra[:, None, None] * np.stack((np.cos(angle_a), np.sin(angle_a)), axis=-1)
    return np.concatenate((circle_b, circle_a), axis=1)


def draw_body(
    image: Image,
    camera: Camera,
    body: Body,
    cones: RoundCones,
    light: float = 1.0,
    colours: Mapping[str, Colour] = COLOURS,
) -> None:
    """Draw the body into an image, in place, far limbs first.

    Args:
        colours: Colour of each material.
    """
    starts, ends = (camera.to_camera(points)[:, 2] for points in (cones.starts, cones.ends))
    middle = 0.5 * (starts + ends - cones.start_radii - cones.end_radii)
    a, b = camera.project(cones.starts), camera.project(cones.ends)
    ra = camera.focal_px * cones.start_radii / np.maximum(starts, 0.05)
    rb = camera.focal_px * cones.end_radii / np.maximum(ends, 0.05)
    sizes = np.array([size for size, _ in _LAYERS])[:, None]
    shifts = 0.55 * (1.0 - sizes) * _LIGHT
    a, b = ((ends + radii[:, None] * shifts[:, None]).reshape(-1, 2) for ends, radii in ((a, ra), (b, rb)))
    polygons = outlines(a, b, (sizes * ra).ravel(), (sizes * rb).ravel())
    layers = np.rint(np.nan_to_num(polygons) * 16.0).astype(np.int32).reshape(len(_LAYERS), len(cones), -1, 2)
    for limb in sorted(body.limbs, key=lambda members: -float(middle[members].mean())):
        order = [part for part in limb[np.argsort(-middle[limb])] if min(starts[part], ends[part]) > 0.2]
        # layer by layer, so that the parts of a limb merge
        for outline, (size, tone) in zip(layers, _LAYERS, strict=True):
            rim = cv2.LINE_AA if size == 1.0 else cv2.LINE_8
            for part in order:
                blue, green, red = colours[body.materials[part]]
                colour = light * tone * blue, light * tone * green, light * tone * red
                cv2.fillConvexPoly(image, outline[part], colour, rim, 4)  # 4 fractional bits
