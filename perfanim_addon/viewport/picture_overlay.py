"""Camera preview in a corner of the 3D viewports and as an image in the file.

No Blender data is held between two pictures, and none is left after `hide`.
"""

import bpy
import numpy as np

from ...core.geometry.arrays import Image
from ..blender_versions import texture_options
from . import viewport_drawing
from .viewport_drawing import STYLE

NAME = "Perfanim Preview"
_SHOWN_IN = ("VIEW_3D", "IMAGE_EDITOR")
_line = [""]  # text above the picture


def show(picture: Image, line: str) -> None:
    """Show a picture (height, width, 3), RGB, and a line above it, until `hide`."""
    height, width = picture.shape[:2]
    image = bpy.data.images.get(NAME)
    if image is None:
        image = bpy.data.images.new(NAME, width, height)
    elif tuple(image.size) != (width, height):
        image.scale(width, height)
    pixels = np.ones((height, width, 4), dtype=np.float32)
    pixels[..., :3] = picture[::-1] / np.float32(255.0)
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    _line[0] = line
    handler.add()
    viewport_drawing.redraw(*_SHOWN_IN)


def hide() -> None:
    """Remove the picture. Safe to call at any time."""
    if handler.remove():
        image = bpy.data.images.get(NAME)
        if image is not None:
            bpy.data.images.remove(image)
        viewport_drawing.redraw(*_SHOWN_IN)


def _draw() -> None:
    import gpu  # only with a window
    from gpu_extras.presets import draw_texture_2d

    image = bpy.data.images.get(NAME)
    if image is None:
        return
    scale = bpy.context.preferences.system.ui_scale
    left, right = viewport_drawing.free(bpy.context.area, bpy.context.region)
    width = min(STYLE.picture * scale, STYLE.picture_share * (right - left))
    height = width * image.size[1] / image.size[0]
    x, y = left + STYLE.margin * scale, STYLE.margin * scale
    draw_texture_2d(gpu.texture.from_image(image), (x, y), width, height, **texture_options())
    size = STYLE.text * scale
    viewport_drawing.text(_line[0], (x, y + height + 0.5 * size), size, (1.0, 1.0, 1.0, 1.0))


handler = viewport_drawing.DrawHandler(_draw)
