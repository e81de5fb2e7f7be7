"""Camera preview in a corner of the 3D viewports and as an image of the file.

Nothing of Blender's data is kept between two pictures, and nothing is left once it is hidden.
"""

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ...core.geometry.arrays import Image
from . import viewport_drawing

NAME = "Perfanim Preview"

_WIDTH = 640  # unscaled pixels, as all here
_SHARE = 0.6  # of the viewport's width at most
_MARGIN = 16.0
_TEXT = 16.0
_WHITE = (1.0, 1.0, 1.0, 1.0)
_SHOWN_IN = ("VIEW_3D", "IMAGE_EDITOR")


@dataclass
class _State:
    handler: Any = None
    line: str = ""


_state = _State()


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
    _state.line = line
    if _state.handler is None:
        _state.handler = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")
    viewport_drawing.redraw(*_SHOWN_IN)


def hide() -> None:
    """Take the picture away. Safe to call at any time."""
    if _state.handler is None:
        return
    bpy.types.SpaceView3D.draw_handler_remove(_state.handler, "WINDOW")
    _state.handler = None
    image = bpy.data.images.get(NAME)
    if image is not None:
        bpy.data.images.remove(image)
    viewport_drawing.redraw(*_SHOWN_IN)


def _draw() -> None:
    # imported here: without a window there is no GPU
    import gpu
    from gpu_extras.presets import draw_texture_2d

    image = bpy.data.images.get(NAME)
    if image is None:
        return
    scale = bpy.context.preferences.system.ui_scale
    left, right = viewport_drawing.free(bpy.context.area, bpy.context.region)
    width = min(_WIDTH * scale, _SHARE * (right - left))
    height = width * image.size[1] / image.size[0]
    x, y = left + _MARGIN * scale, _MARGIN * scale
    # from 5.0 on the viewport does not encode colours
    encode = {"is_scene_linear_with_rec709_srgb_target": True} if bpy.app.version >= (5, 0, 0) else {}
    draw_texture_2d(gpu.texture.from_image(image), (x, y), width, height, **encode)
    viewport_drawing.text(_state.line, (x, y + height + 0.5 * _TEXT * scale), _TEXT * scale, _WHITE)
