"""Overlay of markers, solved skeleton and space in the 3D viewports.

It costs nothing while it is off, and leaves nothing once it is hidden.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import bpy
import numpy as np

from ...core.body.scene_pose import PerformerPose, ScenePose
from ...core.body.skeleton import Skeleton, forward_kinematics
from ...core.geometry.arrays import Array
from ...core.geometry.camera import CameraRig
from ...core.markers.subject import Subject
from ...core.simulate.studio.studio_rig import default_rig
from ...core.vision.common_space import CommonSpace, common_space
from ..character.axes import points_to_blender
from . import viewport_drawing
from .name_layout import PlacedName, place_names

Colour = tuple[float, float, float, float]
Projection = Callable[[Array], Array]

_DOT = 5.0  # its radius, in unscaled pixels, as all here
_BONE, _RAY = 3.0, 1.0  # widths of lines
_RING_SHARE = 0.3  # of its radius is the width of a ring
_TEXT, _MARGIN, _BESIDE = 16.0, 16.0, 8.0
_NAME = 11.0
_SIDES = 16  # of a dot
_PIECES: Array = np.linspace(0.0, 1.0, 17)[:, None]  # of a ray, as part of it may lie behind the viewer
_RAY_COLOUR: Colour = (1.0, 0.67, 0.24, 0.8)  # as what one camera alone sees has in the preview
_NAME_COLOUR: Colour = (1.0, 1.0, 1.0, 1.0)
_LEADER_COLOUR: Colour = (1.0, 1.0, 1.0, 0.5)
_SPACE_COLOUR: Colour = (0.31, 1.0, 0.31, 0.8)  # as in the pictures of the check
_HUES = 0.618  # from one marker's colour to the next, so that neighbours in the set differ
_GREEN = 1 / 3


@dataclass(frozen=True)
class Scene:
    """Constant parts of a capture.

    Args:
        performers: skeleton and names (M) of the markers of each, in the order of a pose's performers.
        cameras_m: (C, 3) where the cameras are, in the performers' room.
        placed: turns points (N, 3) of that room into points of the scene.
        rig: cameras that know the floor, None for others.
    """

    performers: tuple[tuple[Skeleton, tuple[str, ...]], ...]
    cameras_m: Array
    placed: Callable[[Array], Array]
    rig: CameraRig | None = None

    @classmethod
    def of(
        cls,
        performers: Sequence[Subject],
        calibration: CameraRig | None,
        placed: Callable[[Array], Array],
        simulated: bool = False,
    ) -> "Scene":
        """Return the scene of a capture; without a calibration, the simulated cameras'."""
        rig = calibration or default_rig()
        cameras_m = np.array([camera.centre_m for camera in rig.cameras])
        bodies = tuple((subject.skeleton, subject.marker_set.names) for subject in performers)
        return cls(bodies, cameras_m, placed, rig if simulated or "floor" in rig.metadata else None)

    @cached_property
    def space(self) -> CommonSpace | None:
        """Floor that all cameras see; None where the floor is not known."""
        return common_space(self.rig) if self.rig else None


@dataclass
class _State:
    handler: Any = None
    scene: Scene | None = None
    pose: ScenePose | None = None
    parts: frozenset[str] = frozenset()


_state = _State()


def show(scene: Scene | None, pose: ScenePose, parts: frozenset[str]) -> None:
    """Show a pose until `hide`; without `parts` (of the setting "overlay") hide it."""
    if scene is None or not parts:
        hide()
        return
    _state.scene, _state.pose, _state.parts = scene, pose, parts
    if _state.handler is None:
        _state.handler = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")


def show_space(rig: CameraRig) -> None:
    """Show the floor that all cameras see until `hide`, where a new character stands."""
    if "floor" in rig.metadata:
        show(Scene((), np.empty((0, 3)), points_to_blender, rig), ScenePose(()), frozenset({"SPACE"}))
        viewport_drawing.redraw("VIEW_3D")


def hide() -> None:
    """Take it away. Safe to call at any time."""
    if _state.handler is None:
        return
    bpy.types.SpaceView3D.draw_handler_remove(_state.handler, "WINDOW")
    _state.handler = _state.scene = _state.pose = None
    viewport_drawing.redraw("VIEW_3D")


def _draw() -> None:
    scene, pose, area, region = _state.scene, _state.pose, bpy.context.area, bpy.context.region
    if scene is None or pose is None or not area.spaces.active.overlay.show_overlays:
        return
    scale = bpy.context.preferences.system.ui_scale
    matrix, size = np.array(bpy.context.region_data.perspective_matrix), np.array([region.width, region.height])

    def on_screen(points_m: Array) -> Array:
        return projected(matrix, size, scene.placed(points_m))

    shapes, names = shapes_of(scene, pose, _state.parts, on_screen, scale)
    placed = _placed(shapes, names, scale)
    shapes.draw()
    for name, place in placed:
        viewport_drawing.text(name, place.start, _NAME * scale, _NAME_COLOUR)
    for performer in pose.performers[:1]:
        text = f"Confidence {performer.confidence:.0%}"
        right = viewport_drawing.free(area, region)[1] - viewport_drawing.text_width(text, _TEXT * scale)
        place = (right - _MARGIN * scale, _MARGIN * scale)
        viewport_drawing.text(text, place, _TEXT * scale, confidence_colour(performer))


def _placed(shapes: "Shapes", names: list[tuple[str, Array]], scale: float) -> list[tuple[str, PlacedName]]:
    """Lay out names without overlap; add a line to each that is away from its point."""
    if not names:
        return []
    points = np.array([point for _, point in names])
    widths = [viewport_drawing.text_width(name, _NAME * scale) for name, _ in names]
    placed = place_names(points, widths, _NAME * scale, _BESIDE * scale, _DOT * scale)
    for point, place in zip(points, placed, strict=True):
        if place.is_away:
            shapes.line(point, np.array(place.near), _RAY * scale, _LEADER_COLOUR)
    return [(name, place) for (name, _), place in zip(names, placed, strict=True)]


def confidence_colour(pose: PerformerPose) -> Colour:
    """Return green for a pose that is sure, red for a guessed one."""
    return coloured(_GREEN * pose.confidence)


def shapes_of(
    scene: Scene, pose: ScenePose, parts: frozenset[str], on_screen: Projection, scale: float
) -> tuple["Shapes", list[tuple[str, Array]]]:
    """Return the shapes of a pose, and names with the points (2,) that they name.

    Args:
        scene, pose, parts: as of `show`.
        on_screen: turns points (N, 3) of the performers' room into places (N, 2) in pixels, NaN for those out of sight.
        scale: pixels to an unscaled one.
    """
    shapes, names = Shapes(), []
    for (skeleton, labels), body in zip(scene.performers, pose.performers, strict=False):
        if "SKELETON" in parts:
            _add_skeleton(shapes, skeleton, body, on_screen, scale)
        if "MARKERS" in parts:
            names += _add_markers(shapes, labels, scene.cameras_m, body, on_screen, scale)
    if "SPACE" in parts and scene.space is not None:
        names += _add_space(shapes, scene.space, on_screen, scale)
    return shapes, names


def _add_space(shapes: "Shapes", space: CommonSpace, on_screen: Projection, scale: float) -> list[tuple[str, Array]]:
    """Add the outline on the floor; return its size with the place of its middle."""
    outline = on_screen(space.outline_m)
    for start, end in pairwise(outline):
        shapes.line(start, end, _BONE * scale, _SPACE_COLOUR)
    in_sight = outline[np.isfinite(outline).all(axis=1)]
    return [(space.text, in_sight.mean(axis=0))] if len(in_sight) else []


def _add_skeleton(
    shapes: "Shapes", skeleton: Skeleton, pose: PerformerPose, on_screen: Projection, scale: float
) -> None:
    joints = on_screen(forward_kinematics(skeleton, pose.rotations, pose.root_position_m)[0])
    for joint, parent in enumerate(skeleton.parents.tolist()):
        if parent >= 0:
            shapes.line(joints[parent], joints[joint], _BONE * scale, confidence_colour(pose))


def _add_markers(
    shapes: "Shapes", labels: Sequence[str], cameras_m: Array, pose: PerformerPose, on_screen: Projection, scale: float
) -> list[tuple[str, Array]]:
    """Add markers and rays; return the names with their places."""
    names = []
    located = np.isfinite(pose.observed_m).all(axis=1)
    places = on_screen(np.where(located[:, None], pose.observed_m, pose.markers_m))
    for index, (name, place, camera) in enumerate(zip(labels, places, pose.single_cameras.tolist(), strict=True)):
        colour = coloured(index * _HUES % 1.0)
        if camera >= 0:
            ray = pose.markers_m[index] + _PIECES * (cameras_m[camera] - pose.markers_m[index])
            for start, end in pairwise(on_screen(ray)):
                shapes.line(start, end, _RAY * scale, _RAY_COLOUR)
        if np.isfinite(place).all():
            (shapes.dot if located[index] else shapes.ring)(place, _DOT * scale, colour)
            names.append((name, place))
    return names


def projected(matrix: Array, size: Array, points: Array) -> Array:
    """Return region pixels (N, 2) of scene points (N, 3), NaN behind the viewer.

    Args:
        matrix: (4, 4) the view's perspective.
        size: (2,) of the region in pixels.
    """
    clip = points @ matrix[:, :3].T + matrix[:, 3]
    with np.errstate(invalid="ignore", divide="ignore"):
        seen = np.where(clip[:, 3:] > 0.0, clip[:, :2] / clip[:, 3:], np.nan)
    return (0.5 + 0.5 * seen) * size


def coloured(hue: float) -> Colour:
    """Return a full colour by its hue: 0 red, 1/3 green, 2/3 blue."""
    red, green, blue = np.clip(np.abs((6.0 * hue + np.array([0.0, 4.0, 2.0])) % 6.0 - 3.0) - 1.0, 0.0, 1.0).tolist()
    return red, green, blue, 1.0


class Shapes:
    """Dots, rings and lines, all of triangles: every graphics backend can draw these."""

    def __init__(self) -> None:
        self.corners: list[Array] = []  # (3 N, 2) each
        self.colours: list[Colour] = []

    def line(self, start: Array, end: Array, width: float, colour: Colour) -> None:
        """Add a line; none where an end is not in sight or it has no length."""
        way = end - start
        length = float(np.hypot(*way))
        if not np.isfinite(length) or length == 0.0:
            return
        aside = 0.5 * width / length * np.array([-way[1], way[0]])
        a, b, c, d = start + aside, start - aside, end - aside, end + aside
        self._add(np.array([a, b, c, a, c, d]), colour)

    def dot(self, centre: Array, radius: float, colour: Colour) -> None:
        """Add a disc."""
        rim = centre + radius * _CIRCLE
        middle = np.broadcast_to(centre, rim.shape)
        self._add(np.stack([middle, rim, np.roll(rim, -1, axis=0)], axis=1).reshape(-1, 2), colour)

    def ring(self, centre: Array, radius: float, colour: Colour) -> None:
        """Add a circle."""
        rim = centre + radius * _CIRCLE
        for start, end in zip(rim, np.roll(rim, -1, axis=0), strict=True):
            self.line(start, end, _RING_SHARE * radius, colour)

    def _add(self, corners: Array, colour: Colour) -> None:
        self.corners.append(corners)
        self.colours.extend([colour] * len(corners))

    def draw(self) -> None:
        """Draw all in one go."""
        if self.corners:
            viewport_drawing.triangles(np.concatenate(self.corners), self.colours)


_CIRCLE: Array = np.stack([f(np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)) for f in (np.cos, np.sin)], axis=1)
