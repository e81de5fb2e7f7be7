"""Body drawn fast: nested outlines of each cone, brighter towards the light."""

from collections.abc import Mapping

import cv2
import numpy as np

from ...geometry.arrays import Array, Image
from ...geometry.camera import Camera
from .cones import RoundCones
from .performer_body import Body
from .studio_settings import TABLES

_ARC = np.linspace(0.0, 1.0, 9)
_SHIFT = 4  # fractional bits of polygon corners
_LAYERS = ((1.0, 0.62), (0.82, 0.86), (0.6, 1.04), (0.34, 1.18))  # size of the outline, brightness
_SMALL_PX = 7.0  # cones thinner than this get half of the layers
_LIGHT = np.array([-0.45, -0.75])  # direction to the light in the image (x right, y down)

Colour = tuple[float, float, float]  # BGR, 0-255

COLOURS: dict[str, Colour] = TABLES["colours"]


def outlines(a: Array, b: Array, ra: Array, rb: Array) -> Array:
    """Return outlines (N, K, 2), pixels, around two circles each.

    Centres (N, 2) and radii (N,) are in pixels.
    """
    axis = b - a
    length = np.maximum(np.hypot(axis[:, 0], axis[:, 1]), 1e-9)
    heading = np.arctan2(axis[:, 1], axis[:, 0])[:, None]
    # the common tangents touch both circles at this angle from the axis; one circle inside the other has none
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
    """Draw the body into an image, in place, far limbs first; `colours` by material."""
    materials, groups = body.materials, body.limbs
    ends = np.concatenate((cones.starts, cones.ends))
    depth = camera.to_camera(ends)[:, 2]
    count = len(cones)
    pixels = camera.project(ends)
    radii = camera.focal_px * np.concatenate((cones.start_radii, cones.end_radii)) / np.maximum(depth, 0.05)
    near = np.minimum(depth[:count], depth[count:]) > 0.2
    large = np.maximum(radii[:count], radii[count:]) > _SMALL_PX
    size = np.repeat(np.array([layer[0] for layer in _LAYERS]), count)
    reach = np.tile(radii.reshape(2, count), len(_LAYERS))
    place = np.tile(pixels.reshape(2, count, 2), (1, len(_LAYERS), 1))
    place = place + ((1.0 - size) * reach)[..., None] * (0.55 * _LIGHT)
    polygons = outlines(place[0], place[1], size * reach[0], size * reach[1])
    corners = np.rint(np.nan_to_num(polygons) * (1 << _SHIFT)).astype(np.int32)
    corners = corners.reshape(len(_LAYERS), count, -1, 2)
    middle = 0.5 * (depth[:count] + depth[count:]) - 0.5 * (cones.start_radii + cones.end_radii)
    for group in sorted(groups, key=lambda members: -float(middle[members].mean())):
        order = [int(part) for part in group[np.argsort(-middle[group])] if near[part]]
        # layer by layer, so that the parts of a limb melt into each other
        for layer, (_, tone) in enumerate(_LAYERS):
            for part in order if layer % 2 == 0 else [part for part in order if large[part]]:
                b, g, r = colours[materials[part]]
                colour = (light * tone * b, light * tone * g, light * tone * r)
                # only the rim stands against something unlike it
                rim = cv2.LINE_AA if layer == 0 else cv2.LINE_8
                cv2.fillConvexPoly(image, corners[layer, part], colour, rim, _SHIFT)
