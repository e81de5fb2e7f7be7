"""Screen for the performer, readable from three metres: camera pictures, large text, and the pose to take.

It fills the image editor of a window of its own. Only the name of the window's screen is held, no Blender data.
"""

from dataclasses import dataclass

import bpy
import numpy as np

from ...core.body.calibration_poses import POSES
from ...core.body.skeleton import forward_kinematics
from ...core.body.standard_skeleton import default_skeleton
from ...core.geometry.arrays import Array
from ..blender_versions import texture_options
from . import picture_overlay, viewport_drawing
from .overlay import Colour, Shapes

WHITE: Colour = (1.0, 1.0, 1.0, 1.0)
RED: Colour = (1.0, 0.25, 0.2, 1.0)
GREEN: Colour = (0.35, 0.95, 0.4, 1.0)
_ORANGE: Colour = (1.0, 0.72, 0.25, 1.0)
_BACKGROUND: Colour = (0.03, 0.03, 0.035, 1.0)


@dataclass(frozen=True)
class ScreenLayout:
    """Sizes as shares of the screen's height; letters of 3 % of a 30 cm high screen are 1 cm high."""

    title: float = 0.2  # size of the headline
    line: float = 0.06  # size of the other lines
    margin: float = 0.04
    picture: float = 0.5  # largest height of the cameras' pictures
    pose_width: float = 0.3  # width of the drawn pose, as a share of the screen's width
    bone: float = 0.012  # width of a limb


_LAYOUT = ScreenLayout()


@dataclass(frozen=True)
class PerformerView:
    """What the performer reads.

    Args:
        title: A word, a number or a time.
        line: Instruction below it.
        problem: What is wrong at the moment; "" if nothing.
        pose: Name of the pose to take (`calibration_poses.POSES`); "" for none.
    """

    title: str
    line: str = ""
    problem: str = ""
    colour: Colour = WHITE
    pose: str = ""


@dataclass
class _State:
    screen: str = ""
    view: PerformerView = PerformerView("")


_state = _State()


def window() -> bpy.types.Window | None:
    """Return the performer's window, or None if it is not open."""
    windows = bpy.context.window_manager.windows
    return next((each for each in windows if _state.screen and each.screen.name == _state.screen), None)


def open_window() -> None:
    """Open the window; it stays until it is closed."""
    known = {each.as_pointer() for each in bpy.context.window_manager.windows}
    bpy.ops.wm.window_new()
    opened = next(each for each in bpy.context.window_manager.windows if each.as_pointer() not in known)
    _state.screen = opened.screen.name
    area = max(opened.screen.areas, key=lambda each: each.width * each.height)
    area.type = "IMAGE_EDITOR"
    handler.add()


def close() -> None:
    """Close the window. Safe to call at any time."""
    opened = window()
    if opened is not None:
        with bpy.context.temp_override(window=opened):
            bpy.ops.wm.window_close()
    forget()


def forget() -> None:
    """Forget the window, because another file may have a screen of the same name."""
    _state.screen = ""
    handler.remove()


def show(view: PerformerView) -> None:
    """Show what the performer reads."""
    _state.view = view
    opened = window()
    for area in opened.screen.areas if opened is not None else ():
        space = area.spaces.active
        for name in ("header", "tool_header", "toolbar", "ui"):  # Blender shows them again when the editor is new
            if getattr(space, f"show_region_{name}"):
                setattr(space, f"show_region_{name}", False)
        area.tag_redraw()


def _draw() -> None:
    context, view = bpy.context, _state.view
    if context.screen.name != _state.screen:
        return
    width, height = float(context.region.width), float(context.region.height)
    margin = _LAYOUT.margin * height
    shapes = Shapes()
    shapes.line(np.array([0.0, 0.5 * height]), np.array([width, 0.5 * height]), height, _BACKGROUND)
    shapes.draw()
    top = height - margin - _draw_picture(width, height, margin)
    free = width - 2.0 * margin
    if view.pose:
        _draw_pose(view.pose, (width - margin - _LAYOUT.pose_width * width, margin, _LAYOUT.pose_width * width, top))
        free -= _LAYOUT.pose_width * width + margin
    size = fitted(view.title, _LAYOUT.title * height, free)
    y = top - size
    viewport_drawing.text(view.title, (margin, y), size, view.colour)
    size = _LAYOUT.line * height
    y -= 0.3 * size  # below the headline's descenders
    for text, colour in ((view.line, WHITE), (view.problem, _ORANGE)):
        for line in lines(text, size, free):
            y -= 1.3 * size
            viewport_drawing.text(line, (margin, y), size, colour)


handler = viewport_drawing.DrawHandler(_draw, "SpaceImageEditor")


def _draw_picture(width: float, height: float, margin: float) -> float:
    """Draw the cameras' pictures at the top; return their height with the margin, 0 without pictures."""
    import gpu  # only with a window
    from gpu_extras.presets import draw_texture_2d

    image = bpy.data.images.get(picture_overlay.NAME)
    if image is None:
        return 0.0
    scale = min((width - 2.0 * margin) / image.size[0], _LAYOUT.picture * height / image.size[1])
    shown_width, shown_height = scale * image.size[0], scale * image.size[1]
    place = (0.5 * (width - shown_width), height - margin - shown_height)
    draw_texture_2d(gpu.texture.from_image(image), place, shown_width, shown_height, **texture_options())
    return shown_height + margin


def pose_drawing(name: str, box: tuple[float, float, float, float], height: float) -> Shapes:
    """Return a figure in a pose, as in a mirror, and beside it the same from the side.

    Args:
        name: Name of the pose in `calibration_poses.POSES`.
        box: Left, bottom, width and top in pixels.
        height: Height of the screen in pixels.
    """
    skeleton = default_skeleton()
    places_m, _ = forward_kinematics(skeleton, POSES[name](skeleton), np.zeros(3))
    left, bottom, width, top = box
    shapes = Shapes()
    scale = min((top - bottom) / 2.0, width / 3.2)  # pixels per metre: 2 m high, 1.9 m and 1.1 m wide
    bone = _LAYOUT.bone * height
    for middle, across in ((0.32, 0), (0.8, 2)):
        flat = places_m[:, [across, 1]] * scale + [left + middle * width, bottom - scale * places_m[:, 1].min()]
        _add_figure(shapes, flat, skeleton.parents.tolist(), skeleton.index("head"), bone)
    return shapes


def _add_figure(shapes: Shapes, places: Array, parents: list[int], head: int, bone: float) -> None:
    for joint, parent in enumerate(parents):
        if parent >= 0:
            shapes.line(places[parent], places[joint], bone, WHITE)
            shapes.dot(places[joint], 0.5 * bone, WHITE)
    shapes.dot(places[head] + [0.0, bone], 2.2 * bone, WHITE)


def _draw_pose(name: str, box: tuple[float, float, float, float]) -> None:
    pose_drawing(name, box, float(bpy.context.region.height)).draw()


def fitted(text: str, size: float, width: float) -> float:
    """Return the size of a line of text, made smaller if it would be wider than `width` pixels."""
    return min(size, size * width / max(viewport_drawing.text_width(text, size), 1.0))


def lines(text: str, size: float, width: float) -> list[str]:
    """Return a text in lines of at most `width` pixels."""
    found: list[str] = []
    for word in text.split():
        longer = f"{found[-1]} {word}" if found else word
        if found and viewport_drawing.text_width(longer, size) <= width:
            found[-1] = longer
        else:
            found.append(word)
    return found
