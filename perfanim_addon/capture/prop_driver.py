"""Moves objects with props, in the space of the character that the capture drives, and makes actions of it."""

from collections.abc import Sequence

import bpy
import numpy as np
from mathutils import Quaternion, Vector
from numpy.typing import NDArray

from ...core.body.scene_pose import PropPose, ScenePose
from ...core.markers.prop import Prop
from ..animation.actions import write_object_action
from ..animation.placement import Placement, PlacementMode
from ..animation.suspended_actions import SuspendedActions
from ..settings import target_settings
from .capture_space import CaptureSpace

Array = NDArray[np.float64]


class TargetDriver:
    """Lets objects follow the props of a capture. Only names are held, nothing of Blender's data.

    Args:
        props: of the capture, in the order of its poses' props.

    Raises:
        CharacterError: a chosen object cannot follow.
    """

    def __init__(self, context: bpy.types.Context, props: Sequence[Prop]) -> None:
        for entry in target_settings.of_kind(context.scene, "PROP"):
            target_settings.check_object(entry.object)
        self._props = list(props)
        self._names: list[str | None] = [None] * len(props)  # an object is made when its prop is first seen
        self._held = SuspendedActions()

    def apply(self, context: bpy.types.Context, poses: Sequence[PropPose], room: CaptureSpace) -> None:
        """Move the objects of the props that are found, in the room of the character that the capture drives.

        One that was deleted meanwhile is left out.
        """
        for index, pose in enumerate(poses):
            if not pose.found:
                continue
            name = self._names[index] or self._begin(context, index)
            target = bpy.data.objects.get(name)
            if target is not None:
                turn, place = room.brought(pose.rotation, pose.position_m)
                target.rotation_quaternion, target.location = Quaternion(turn), Vector(place)

    def _begin(self, context: bpy.types.Context, index: int) -> str:
        name = target_settings.object_of(context, self._props[index])
        target = bpy.data.objects[name]
        target.rotation_mode = "QUATERNION"
        self._held.take(target)
        self._names[index] = name
        return name

    def restore(self) -> None:
        """Give the objects the actions back that were taken off."""
        self._held.give_back()


def write_prop_actions(
    context: bpy.types.Context,
    props: Sequence[Prop],
    poses: Sequence[ScenePose],
    frames: Array,
    room: CaptureSpace,
    name: str,
    placement: Placement,
) -> list[str]:
    """Write where props were as actions of the objects that follow them; return the actions' names.

    Keys stand where a prop was found; between them it goes straight.

    Args:
        props: in the order of the poses' props; one that was never found leaves nothing.
        poses, frames: (F,) poses and the scene frame of each.
        room: of the character.
        name: wished name of the actions, before the prop's.
        placement: of the character's action, of which `onto` and the bounds count here.

    Raises:
        CharacterError: an object cannot be animated.
    """
    written = []
    for index, prop in enumerate(props):
        rows = [row for row, pose in enumerate(poses) if len(pose.props) > index and pose.props[index].found]
        if not rows:
            continue
        found = [poses[row].props[index] for row in rows]
        turns, places = room.brought(
            np.array([pose.rotation for pose in found]), np.array([pose.position_m for pose in found])
        )
        target = bpy.data.objects[target_settings.object_of(context, prop)]
        target_settings.check_object(target)
        how = Placement(
            PlacementMode.STRIP if placement.onto is PlacementMode.LAYER else placement.onto, None, placement.bounds
        )
        written.append(
            write_object_action(target, frames[rows], turns, places, name=f"{name} {prop.name}", placement=how)
        )
    return written
