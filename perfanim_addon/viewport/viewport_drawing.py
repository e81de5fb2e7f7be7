"""Drawing over 3D viewports: text, triangles, free area."""

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np

from ...core.geometry.arrays import Array

_FONT = 0


def redraw(*kinds: str) -> None:
    """Redraw all areas of these types."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in kinds:
                area.tag_redraw()


def free(area: bpy.types.Area, region: bpy.types.Region) -> tuple[float, float]:
    """Return left and right of the region's part without toolbar and sidebar, pixels."""
    left, right = 0.0, float(region.width)
    for other in area.regions:
        if other.type == "TOOLS":
            left = max(left, other.x + other.width - region.x)
        elif other.type == "UI" and other.width > 1:
            right = min(right, other.x - region.x)
    return left, max(right, left + 1.0)


def text_width(line: str, size: float) -> float:
    """Return how wide a line of text is, in pixels."""
    import blf  # without a window there is none of this

    blf.size(_FONT, size)
    return float(blf.dimensions(_FONT, line)[0])


def text(line: str, place: Sequence[float], size: float, colour: Sequence[float]) -> None:
    """Draw a line of text with a shadow; (0, 0) is the region's lower left corner."""
    import blf

    blf.size(_FONT, size)
    blf.color(_FONT, *colour)
    blf.enable(_FONT, blf.SHADOW)
    blf.shadow(_FONT, 5, 0.0, 0.0, 0.0, 1.0)
    blf.position(_FONT, float(place[0]), float(place[1]), 0.0)
    blf.draw(_FONT, line)
    blf.disable(_FONT, blf.SHADOW)


def triangles(corners: Array, colours: Sequence[Any]) -> None:
    """Draw triangles: corners (3 N, 2) in pixels of the region, and colours, RGBA."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("FLAT_COLOR")
    content = {"pos": corners.astype(np.float32), "color": np.array(colours, dtype=np.float32)}
    batch = batch_for_shader(shader, "TRIS", content)
    gpu.state.blend_set("ALPHA")
    batch.draw(shader)
    gpu.state.blend_set("NONE")
