"""Live motion of the characters and objects in a capture."""

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import replace

import bpy
from mathutils import Quaternion, Vector

from ...core.body.scene_pose import PropPose, ScenePose
from ...core.errors import CharacterError
from ...core.markers.prop import Prop
from ...core.markers.subject import Subject
from ..animation.hand_keys import hand_turns
from ..blender_versions import detach_action
from ..settings import target_settings
from .armature_driver import ArmatureDriver
from .capture_space import CaptureSpace, RigidOffset
from .performer_targets import PerformerTarget, copy_targets, performer_targets


class SuspendedActions:
    """Detaches the actions of objects and restores them. It holds only names, no Blender data."""

    def __init__(self) -> None:
        self._held: dict[str, str] = {}

    def take(self, target: bpy.types.Object) -> None:
        """Detach an object's action, if it has one."""
        animation = target.animation_data
        if animation is not None and animation.action is not None:
            self._held[target.name] = animation.action.name
            detach_action(animation)

    def give_back(self) -> None:
        """Restore the actions of all objects that still exist."""
        for name, action_name in self._held.items():
            target, action = bpy.data.objects.get(name), bpy.data.actions.get(action_name)
            if target is not None and target.animation_data is not None and action is not None:
                target.animation_data.action = action
        self._held.clear()


class SceneDriver:
    """Moves characters and objects of performers and props, given in the order of the poses.

    It holds only names, no Blender data. CharacterError if a chosen object or armature cannot be driven.
    """

    def __init__(
        self, context: bpy.types.Context, performers: Sequence[Subject], props: Sequence[Prop], parts: Collection[str]
    ) -> None:
        for entry in target_settings.of_kind(context.scene, "PROP"):
            target_settings.check_object(entry.object)
        self.held = SuspendedActions()
        self.props = props
        self._prop_driver = PropDriver(props, self.held)
        first, *further = performer_targets(context, performers)
        self._further = [_PerformerDriver(target, parts, self.held) for target in further]
        self._main = _PerformerDriver(first, parts, self.held)
        self._copies = [_PerformerDriver(target, parts, self.held) for target in copy_targets(context, performers[0])]
        for driver in self._copies:
            driver.start(context, None)
        self.space: CaptureSpace | None = None
        if first.armature:
            self.start(context)

    @property
    def targets(self) -> list[PerformerTarget]:
        """The performers with their current characters."""
        return [driver.target for driver in (self._main, *self._further)]

    @property
    def copies(self) -> list[PerformerTarget]:
        """The further characters of the first performer."""
        return [driver.target for driver in self._copies]

    def start(self, context: bpy.types.Context) -> CaptureSpace:
        """Return the capture space; the first call creates it and missing characters."""
        if self.space is None:
            main = self._main.start(context, None)
            character = bpy.data.objects[main.object_name]
            self._main.suspend_action(character)
            self.space = CaptureSpace(character, main.plan)
            for driver in self._copies:
                driver.suspend_own_action()
            for driver in self._further:
                driver.start(context, self.space)
        return self.space

    def apply(self, context: bpy.types.Context, poses: Sequence[ScenePose]) -> None:
        """Show the newest pose; deleted further targets are skipped. CharacterError if the first character is gone."""
        space, pose = self.start(context), poses[-1]
        self._main.apply(pose, None)
        for driver in self._copies:
            driver.apply_if_present(pose)
        self._prop_driver.apply(context, pose.props, space)
        for driver in self._further:
            driver.apply_offset(poses, space)

    def pose_hands(self, name: str, sides: str) -> None:
        """Keep the hands of the first performer's characters in a pose; see `hand_turns`.

        Further characters without fingers stay as they are; CharacterError if the first one has none.
        """
        self._main.pose_hands(name, sides)
        for driver in self._copies:
            with suppress(CharacterError):
                driver.pose_hands(name, sides)

    def reapply_pose(self) -> None:
        """Apply the last pose again after an animation has overwritten it."""
        for driver in (self._main, *self._copies, *self._further):
            driver.reapply_pose()


class _PerformerDriver:
    """Drives one performer's character; that of a further performer keeps its action until the performer is seen."""

    def __init__(self, target: PerformerTarget, parts: Collection[str], held: SuspendedActions) -> None:
        self.target = target
        self._parts = parts
        self._held = held
        self._offset: RigidOffset | None = None
        self._driver = self._bind(target) if target.armature and target.index else None

    def _bind(self, target: PerformerTarget) -> ArmatureDriver:
        driver = ArmatureDriver(target.armature, target.subject.skeleton, self._parts)
        self.target = replace(target, only=driver.only)
        return driver

    def start(self, context: bpy.types.Context, space: CaptureSpace | None) -> ArmatureDriver:
        if self._driver is None:
            self._driver = self._bind(self.target.ensure_character(context, space))
        return self._driver

    def suspend_action(self, character: bpy.types.Object) -> None:
        if self.target.only is None:
            self._held.take(character)

    def suspend_own_action(self) -> None:
        character = self.target.character()
        if character is not None:
            self.suspend_action(character)

    def apply_if_present(self, pose: ScenePose) -> None:
        if self.target.character() is not None:
            self.apply(pose, None)

    def apply(self, pose: ScenePose, offset: RigidOffset | None) -> None:
        body = pose.performers[self.target.index]
        rotations, root_m = body.rotations, body.root_position_m
        if self._driver is not None:
            self._driver.apply(*(offset.apply(rotations, root_m) if offset else (rotations, root_m)))

    def pose_hands(self, name: str, sides: str) -> None:
        character = self.target.character()
        if self._driver is not None and character is not None:
            self._driver.hold(hand_turns(character, sides, name))

    def apply_offset(self, poses: Sequence[ScenePose], space: CaptureSpace) -> None:
        character = self.target.character()
        if character is None or self._driver is None:
            return
        if self._offset is None:
            if self.target.first_seen(poses[-1:]) is None:
                return
            self._offset = self.target.offset_into(space, CaptureSpace(character, self._driver.plan), poses)
            self.suspend_action(character)
        self.apply(poses[-1], self._offset)

    def reapply_pose(self) -> None:
        if self._driver is not None and (self.target.entry is None or self.target.character() is not None):
            self._driver.apply_again()


class PropDriver:
    """Objects that follow props; a missing object is added when its prop is first seen."""

    def __init__(self, props: Sequence[Prop], held: SuspendedActions) -> None:
        self.props = tuple(props)
        self._names: list[str | None] = [None] * len(props)
        self._held = held

    def apply(self, context: bpy.types.Context, poses: Sequence[PropPose], space: CaptureSpace) -> None:
        """Move the objects of the visible props; deleted objects are skipped."""
        for index, pose in enumerate(poses):
            if not pose.found:
                continue
            target = bpy.data.objects.get(self._names[index] or self._start(context, index))
            if target is not None:
                rotation, location = space.to_scene(pose.rotation, pose.position_m)
                target.rotation_quaternion, target.location = Quaternion(rotation), Vector(location)

    def _start(self, context: bpy.types.Context, index: int) -> str:
        name = target_settings.object_of(context, self.props[index])
        target = bpy.data.objects[name]
        target.rotation_mode = "QUATERNION"
        self._held.take(target)
        self._names[index] = name
        return name
