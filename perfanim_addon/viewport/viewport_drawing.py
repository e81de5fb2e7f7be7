"""Drawing over 3D viewports: handlers, text, triangles, free area."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ...core.geometry.arrays import Array

_FONT = 0  # Blender's default font


@dataclass(frozen=True)
class Style:
    """Sizes in unscaled pixels, chosen by eye."""

    text: float = 16.0
    name: float = 11.0  # text size of markers' names
    margin: float = 16.0  # distance of text and pictures from the edges
    beside: float = 8.0  # distance of a name from its point
    dot: float = 5.0  # radius of markers
    bone: float = 3.0  # width of bones
    ray: float = 1.0  # width of rays and leader lines
    control: float = 9.0  # radius of the rings around a sketch's controls
    picture: float = 640.0  # width of the camera preview
    picture_share: float = 0.6  # largest share of the viewport's width for the preview


STYLE = Style()


class DrawHandler:
    """Function that draws over all 3D viewports, or other editors, while it is added.

    Args:
        space: Name of the editor's type in `bpy.types`.
    """

    def __init__(self, draw: Callable[[], None], space: str = "SpaceView3D") -> None:
        self._draw, self._space = draw, space
        self._handle: Any = None

    @property
    def added(self) -> bool:
        """Whether the function is added."""
        return self._handle is not None

    def add(self) -> None:
        """Add the function, unless it is added already."""
        if not self.added:
            self._handle = getattr(bpy.types, self._space).draw_handler_add(self._draw, (), "WINDOW", "POST_PIXEL")

    def remove(self) -> bool:
        """Remove the function; return whether it was added."""
        was_added = self.added
        if was_added:
            getattr(bpy.types, self._space).draw_handler_remove(self._handle, "WINDOW")
            self._handle = None
        return was_added


def redraw(*kinds: str) -> None:
    """Redraw all areas of these types."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in kinds:
                area.tag_redraw()


def free(area: bpy.types.Area, region: bpy.types.Region) -> tuple[float, float]:
    """Return the left and right edge (pixels) of the part of a region that toolbar and sidebar leave free."""
    left, right = 0.0, float(region.width)
    for other in area.regions:
        if other.type == "TOOLS":
            left = max(left, other.x + other.width - region.x)
        elif other.type == "UI" and other.width > 1:
            right = min(right, other.x - region.x)
    return left, max(right, left + 1.0)


def text_width(line: str, size: float) -> float:
    """Return the width of a line of text in pixels."""
    import blf  # only with a window

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
    """Draw triangles with corners (3 N, 2) in pixels of the region, and an RGBA colour for each corner."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("FLAT_COLOR")
    content = {"pos": corners.astype(np.float32), "color": np.array(colours, dtype=np.float32)}
    batch = batch_for_shader(shader, "TRIS", content)
    gpu.state.blend_set("ALPHA")
    batch.draw(shader)
    gpu.state.blend_set("NONE")
