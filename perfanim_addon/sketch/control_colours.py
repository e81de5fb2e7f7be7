"""Coloured rings around a sketch's controls in the 3D viewports, because Blender draws all empties in one colour."""

import bpy
import numpy as np

from ...core.body.standard_skeleton import JOINT_NAMES
from ..settings.capture_settings import settings
from ..viewport.overlay import Colour, Shapes, projected
from ..viewport.viewport_drawing import STYLE, DrawHandler
from .controls import controls_of

_LEFT, _RIGHT, _MIDDLE = (0.25, 0.55, 1.0, 1.0), (1.0, 0.3, 0.25, 1.0), (1.0, 0.8, 0.2, 1.0)


def colour_of(joint: str) -> Colour:
    """Return a control's colour: blue on the left, red on the right, else yellow."""
    for side, other, colour in (("l", "r", _LEFT), ("r", "l", _RIGHT)):
        if joint.startswith(side) and other + joint[1:] in JOINT_NAMES:
            return colour
    return _MIDDLE


def _draw() -> None:
    context = bpy.context
    armature = settings(context).armature
    if armature is None or not context.area.spaces.active.overlay.show_overlays:
        return
    shown = {joint: each for joint, each in controls_of(armature).items() if each.visible_get()}
    if not shown:
        return
    places = np.array([each.matrix_world.translation for each in shown.values()], dtype=np.float64)
    size = np.array([context.region.width, context.region.height])
    on_screen = projected(np.array(context.region_data.perspective_matrix), size, places)
    shapes = Shapes(context.preferences.system.ui_scale)
    for joint, place in zip(shown, on_screen, strict=True):
        shapes.ring(place, STYLE.control, colour_of(joint))
    shapes.draw()


handler = DrawHandler(_draw)
