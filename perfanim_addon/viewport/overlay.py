"""Overlay of markers, solved skeleton and common space in the 3D viewports."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import bpy
import numpy as np

from ...core.body.body_parts import PART_JOINTS
from ...core.body.scene_pose import PerformerPose, ScenePose
from ...core.body.skeleton import Skeleton, forward_kinematics
from ...core.geometry.arrays import Array
from ...core.geometry.camera import CameraRig
from ...core.markers.marker_set import MarkerSet, PointKind
from ...core.markers.subject import Subject
from ...core.simulate.studio.studio_rig import default_rig
from ...core.vision.common_space import CommonSpace, common_space
from ..character.axes import points_to_blender
from . import viewport_drawing
from .ghost import Ghost
from .name_layout import PlacedName, place_names
from .viewport_drawing import STYLE

Colour = tuple[float, float, float, float]
Projection = Callable[[Array], Array]

_RAY_PIECES: Array = np.linspace(0.0, 1.0, 17)[:, None]  # a ray is split, because part of it may lie behind the viewer
_RAY_COLOUR: Colour = (1.0, 0.67, 0.24, 0.8)  # as in the preview for blobs seen by only one camera
_NAME_COLOUR: Colour = (1.0, 1.0, 1.0, 1.0)
_LEADER_COLOUR: Colour = (1.0, 1.0, 1.0, 0.5)
_GHOST_COLOUR: Colour = (0.75, 0.85, 1.0, 0.45)
_SPACE_COLOUR: Colour = (0.31, 1.0, 0.31, 0.8)  # as in the pictures of Check Setup


@dataclass(frozen=True)
class Scene:
    """Parts of the overlay that stay the same during a capture."""

    performers: tuple[tuple[Skeleton, tuple[str, ...]], ...]  # skeleton and marker names (M), in the poses' order
    cameras_m: Array  # positions (C, 3) in the capture space
    placed: Callable[[Array], Array]  # transform of points (N, 3) from the capture space to the scene
    rig: CameraRig | None = None  # cameras, if their floor is known
    ghost: Ghost | None = None  # of the last take

    @classmethod
    def of(
        cls,
        performers: Sequence[Subject],
        calibration: CameraRig | None,
        placed: Callable[[Array], Array],
        simulated: bool = False,
        ghost: Ghost | None = None,
    ) -> "Scene":
        """Return the overlay scene of a capture; without a calibration it has the simulated cameras."""
        rig = calibration or default_rig()
        cameras_m = np.array([camera.centre_m for camera in rig.cameras])
        bodies = tuple((subject.skeleton, _names(subject.marker_set)) for subject in performers)
        return cls(bodies, cameras_m, placed, rig if simulated or "floor" in rig.metadata else None, ghost)

    @cached_property
    def space(self) -> CommonSpace | None:
        """Part of the floor in view of all cameras; None if the floor is unknown."""
        return common_space(self.rig) if self.rig else None


def _names(marker_set: MarkerSet) -> tuple[str, ...]:
    """Return the names of a set's markers; those of keypoints are empty, because they are many and close together."""
    return ("",) * len(marker_set) if marker_set.points is PointKind.KEYPOINTS else marker_set.names


@dataclass
class _State:
    scene: Scene | None = None
    pose: ScenePose | None = None
    parts: frozenset[str] = frozenset()
    elapsed_s: float = 0.0


_state = _State()


def show(scene: Scene | None, pose: ScenePose, parts: frozenset[str], elapsed_s: float = 0.0) -> None:
    """Show parts of a pose (see the setting "overlay") until `hide`; the ghost stands where it was at a time."""
    if scene is None or not parts:
        hide()
        return
    _state.scene, _state.pose, _state.parts, _state.elapsed_s = scene, pose, parts, elapsed_s
    handler.add()


def show_space(rig: CameraRig) -> None:
    """Show the part of the floor in view of all cameras until `hide`."""
    if "floor" in rig.metadata:
        show(Scene((), np.empty((0, 3)), points_to_blender, rig), ScenePose(()), frozenset({"SPACE"}))
        viewport_drawing.redraw("VIEW_3D")


def hide() -> None:
    """Remove the overlay. Safe to call at any time."""
    if handler.remove():
        _state.scene, _state.pose, _state.elapsed_s = None, None, 0.0
        viewport_drawing.redraw("VIEW_3D")


def _draw() -> None:
    scene, pose, area, region = _state.scene, _state.pose, bpy.context.area, bpy.context.region
    if scene is None or pose is None or not area.spaces.active.overlay.show_overlays:
        return
    scale = bpy.context.preferences.system.ui_scale
    matrix, size = np.array(bpy.context.region_data.perspective_matrix), np.array([region.width, region.height])

    def on_screen(points_m: Array) -> Array:
        return projected(matrix, size, scene.placed(points_m))

    shapes, names = shapes_of(scene, pose, _state.parts, on_screen, scale, _state.elapsed_s)
    placed = _placed(shapes, names)
    shapes.draw()
    for name, place in placed:
        viewport_drawing.text(name, place.start, STYLE.name * scale, _NAME_COLOUR)
    for performer in pose.performers[:1]:
        text = f"Confidence {performer.confidence:.0%}"
        size, margin = STYLE.text * scale, STYLE.margin * scale
        right = viewport_drawing.free(area, region)[1] - viewport_drawing.text_width(text, size)
        viewport_drawing.text(text, (right - margin, margin), size, confidence_colour(performer.confidence))


handler = viewport_drawing.DrawHandler(_draw)


def _placed(shapes: "Shapes", names: list[tuple[str, Array]]) -> list[tuple[str, PlacedName]]:
    """Lay out names; add a leader line to each that is away from its point."""
    points, scale = np.array([point for _, point in names]).reshape(-1, 2), shapes.scale
    size = STYLE.name * scale
    widths = [viewport_drawing.text_width(name, size) for name, _ in names]
    placed = place_names(points, widths, size, STYLE.beside * scale, STYLE.dot * scale)
    for point, place in zip(points, placed, strict=True):
        if place.is_away:
            shapes.line(point, np.array(place.near), STYLE.ray, _LEADER_COLOUR)
    return [(name, place) for (name, _), place in zip(names, placed, strict=True)]


def confidence_colour(confidence: float) -> Colour:
    """Return green for full confidence, red for none."""
    return coloured(confidence / 3.0)


def shapes_of(
    scene: Scene, pose: ScenePose, parts: frozenset[str], on_screen: Projection, scale: float, elapsed_s: float = 0.0
) -> tuple["Shapes", list[tuple[str, Array]]]:
    """Return the shapes for a pose, and names with their points (2,).

    Args:
        on_screen: Projection of points (N, 3) in the capture space to pixels (N, 2); NaN if out of sight.
        scale: Size of an unscaled pixel in pixels.
        elapsed_s: Time at which the last take's ghost is shown.
    """
    shapes, names = Shapes(scale), []
    if "GHOST" in parts and scene.ghost is not None:
        for skeleton, joints_m in scene.ghost.at(elapsed_s):
            _add_bones(shapes, skeleton, on_screen(joints_m), [_GHOST_COLOUR] * len(skeleton))
    for (skeleton, labels), body in zip(scene.performers, pose.performers, strict=False):
        if "SKELETON" in parts:
            _add_skeleton(shapes, skeleton, body, on_screen)
        if "MARKERS" in parts:
            names += _add_markers(shapes, labels, scene.cameras_m, body, on_screen)
    if "SPACE" in parts and scene.space is not None:
        names += _add_space(shapes, scene.space, on_screen)
    return shapes, names


def _add_space(shapes: "Shapes", space: CommonSpace, on_screen: Projection) -> list[tuple[str, Array]]:
    """Add the outline on the floor; return its size as a name at its centre."""
    outline = on_screen(space.outline_m)
    for start, end in pairwise(outline):
        shapes.line(start, end, STYLE.bone, _SPACE_COLOUR)
    in_sight = outline[np.isfinite(outline).all(axis=1)]
    return [(space.text, in_sight.mean(axis=0))] if len(in_sight) else []


def _add_skeleton(shapes: "Shapes", skeleton: Skeleton, pose: PerformerPose, on_screen: Projection) -> None:
    """Add the bones, each in the colour of the confidence in its part of the body."""
    joints = on_screen(forward_kinematics(skeleton, pose.rotations, pose.root_position_m)[0])
    colours = [confidence_colour(pose.confidence)] * len(joints)
    for part, confidence in zip(PART_JOINTS.values(), pose.part_confidences.tolist(), strict=False):
        for joint in part:
            colours[joint] = confidence_colour(confidence)
    _add_bones(shapes, skeleton, joints, colours)


def _add_bones(shapes: "Shapes", skeleton: Skeleton, joints: Array, colours: Sequence[Colour]) -> None:
    """Add the bones between joints (J, 2) on the screen."""
    for joint, parent in enumerate(skeleton.parents.tolist()):
        if parent >= 0:
            shapes.line(joints[parent], joints[joint], STYLE.bone, colours[joint])


def _add_markers(
    shapes: "Shapes", labels: Sequence[str], cameras_m: Array, pose: PerformerPose, on_screen: Projection
) -> list[tuple[str, Array]]:
    """Add markers and rays; return the names with their points."""
    names = []
    located = np.isfinite(pose.observed_m).all(axis=1)
    places = on_screen(np.where(located[:, None], pose.observed_m, pose.markers_m))
    for index, (name, place, camera) in enumerate(zip(labels, places, pose.single_cameras.tolist(), strict=True)):
        colour = coloured(index * 0.618 % 1.0)  # the golden ratio gives neighbours in the set different hues
        if camera >= 0:
            ray = pose.markers_m[index] + _RAY_PIECES * (cameras_m[camera] - pose.markers_m[index])
            for start, end in pairwise(on_screen(ray)):
                shapes.line(start, end, STYLE.ray, _RAY_COLOUR)
        if np.isfinite(place).all():
            (shapes.dot if located[index] else shapes.ring)(place, STYLE.dot, colour)
            names += [(name, place)] if name else []
    return names


def projected(matrix: Array, size: Array, points: Array) -> Array:
    """Project scene points (N, 3) to pixels (N, 2) of a region with the view's matrix (4, 4); NaN behind the viewer."""
    clip = points @ matrix[:, :3].T + matrix[:, 3]
    with np.errstate(invalid="ignore", divide="ignore"):
        seen = np.where(clip[:, 3:] > 0.0, clip[:, :2] / clip[:, 3:], np.nan)
    return (0.5 + 0.5 * seen) * size


def coloured(hue: float) -> Colour:
    """Return a saturated colour for a hue: 0 red, 1/3 green, 2/3 blue."""
    red, green, blue = np.clip(np.abs((6.0 * hue + np.array([0.0, 4.0, 2.0])) % 6.0 - 3.0) - 1.0, 0.0, 1.0).tolist()
    return red, green, blue, 1.0


class Shapes:
    """Dots, rings and lines made of triangles, which every graphics backend can draw; sizes in unscaled pixels."""

    def __init__(self, scale: float = 1.0) -> None:
        self.scale = scale
        self.corners: list[Array] = []  # (3 N, 2) each
        self.colours: list[Colour] = []

    def line(self, start: Array, end: Array, width: float, colour: Colour) -> None:
        """Add a line, unless an end is out of sight or it has no length."""
        way = end - start
        length = float(np.hypot(*way))
        if not np.isfinite(length) or length == 0.0:
            return
        aside = 0.5 * self.scale * width / length * np.array([-way[1], way[0]])
        a, b, c, d = start + aside, start - aside, end - aside, end + aside
        self._add(np.array([a, b, c, a, c, d]), colour)

    def dot(self, centre: Array, radius: float, colour: Colour) -> None:
        """Add a disc."""
        rim = centre + self.scale * radius * _CIRCLE
        middle = np.broadcast_to(centre, rim.shape)
        self._add(np.stack([middle, rim, np.roll(rim, -1, axis=0)], axis=1).reshape(-1, 2), colour)

    def ring(self, centre: Array, radius: float, colour: Colour) -> None:
        """Add a circle."""
        rim = centre + self.scale * radius * _CIRCLE
        for start, end in zip(rim, np.roll(rim, -1, axis=0), strict=True):
            self.line(start, end, 0.3 * radius, colour)

    def _add(self, corners: Array, colour: Colour) -> None:
        self.corners.append(corners)
        self.colours.extend([colour] * len(corners))

    def draw(self) -> None:
        """Draw everything at once."""
        if self.corners:
            viewport_drawing.triangles(np.concatenate(self.corners), self.colours)


_CIRCLE: Array = np.stack([f(np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)) for f in (np.cos, np.sin)], axis=1)
