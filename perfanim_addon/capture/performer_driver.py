"""Moves the characters of further performers in the room of the first one's, and makes actions of their motion."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.body.scene_pose import ScenePose
from ...core.body.skeleton import forward_kinematics
from ...core.markers.subject import Subject
from ..animation.actions import write_with_plan
from ..animation.suspended_actions import SuspendedActions
from ..character.create_character import create_character
from ..character.posing import plan_for
from ..settings import target_settings
from ..settings.result_settings import placement
from .armature_driver import ArmatureDriver
from .capture_space import CaptureSpace, RigidOffset

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Role:
    """A further performer, and the character that moves along.

    Args:
        subject: who performs.
        index: of the poses' performers.
        target: which of the scene's further targets, None where there is none for them.
        armature: name of the character; "", or of one that was deleted: a new one is added.
        only: bones that are moved, None for all.
    """

    subject: Subject
    index: int
    target: int | None = None
    armature: str = ""
    only: frozenset[str] | None = None

    def first_seen(self, frames: Sequence[ScenePose]) -> int | None:
        """Return in which of the frames something is known of where they are for the first time, None if in none."""
        return next((row for row, frame in enumerate(frames) if frame.performers[self.index].confidence > 0.0), None)

    def character(self) -> bpy.types.Object | None:
        """Return the character, None where there is none (any more)."""
        found = bpy.data.objects.get(self.armature) if self.armature else None
        return found if _is_there(found) else None

    def cast(self, context: bpy.types.Context, room: CaptureSpace) -> "Role":
        """Return the role with a character; where there is none one is added, and chosen for the target.

        It stands where the room's own character stands, as large as the room is: both then move as the performers do.
        """
        if self.character() is not None:
            return self
        entries = context.scene.perfanim_targets.entries
        entry = entries[self.target] if self.target is not None and self.target < len(entries) else None
        if entry is not None and _is_there(entry.armature):  # it was added meanwhile
            return replace(self, armature=entry.armature.name, only=None)
        name = create_character(context, self.subject.skeleton, self.subject.name)
        room.put_at_origin(bpy.data.objects[name])
        if entry is not None:
            entry.armature = bpy.data.objects[name]
        return replace(self, armature=name, only=None)


def roles_of(context: bpy.types.Context, subjects: Sequence[Subject]) -> list[Role]:
    """Return the further performers of a take, or of a capture that begins, with the characters that are chosen."""
    roles = []
    for index, target in enumerate(target_settings.meant_for(context.scene, [subject.name for subject in subjects])):
        chosen = context.scene.perfanim_targets.entries[target].armature if target is not None else None
        roles.append(Role(subjects[index], index + 1, target, chosen.name if _is_there(chosen) else ""))
    return roles


def _is_there(armature: bpy.types.Object | None) -> bool:
    """Return whether an armature is in some scene: a deleted one stays in the file as long as it is chosen."""
    return armature is not None and bool(armature.users_scene)


class PerformerDriver:
    """Lets characters follow the further performers of a capture. Only names are held, nothing of Blender's data.

    Args:
        subjects: in the order of the poses' performers, from the second on.
        parts: of the body that are moved.

    Raises:
        CharacterError: a chosen armature cannot be driven.
    """

    def __init__(self, context: bpy.types.Context, subjects: Sequence[Subject], parts: Collection[str]) -> None:
        self._held = SuspendedActions()
        self._followers = [_Follower(role, parts, self._held) for role in roles_of(context, subjects)]

    @property
    def roles(self) -> list[Role]:
        """Who performs, with the characters that move along by now."""
        return [follower.role for follower in self._followers]

    def enter(self, context: bpy.types.Context, room: CaptureSpace) -> None:
        """Go on in the room of the first performer's character; who has no character gets a new one."""
        for follower in self._followers:
            follower.enter(context, room)

    def apply(self, frames: Sequence[ScenePose]) -> None:
        """Move the characters of those who have been seen; one that was deleted meanwhile is left out.

        Args:
            frames: all poses of the capture so far; the last is shown.
        """
        for follower in self._followers:
            follower.apply(frames)

    def apply_again(self) -> None:
        """Move the characters as last, after an animation has overwritten that."""
        for follower in self._followers:
            follower.apply_again()

    def restore(self) -> None:
        """Give the characters the actions back that were taken off."""
        self._held.give_back()


class _Follower:
    """A further performer's character while live; what it plays is left to it until the performer is seen."""

    def __init__(self, role: Role, parts: Collection[str], held: SuspendedActions) -> None:
        self.role = role
        self._parts = parts
        self._held = held
        self._room: CaptureSpace | None = None
        self._carried: RigidOffset | None = None
        self._driver = self._bound(role) if role.armature else None

    def _bound(self, role: Role) -> ArmatureDriver:
        driver = ArmatureDriver(role.armature, role.subject.skeleton, self._parts)
        self.role = replace(role, only=driver.only)
        return driver

    def enter(self, context: bpy.types.Context, room: CaptureSpace) -> None:
        self._room = room
        if self._driver is None:
            self._driver = self._bound(self.role.cast(context, room))

    def apply(self, frames: Sequence[ScenePose]) -> None:
        character, driver = self.role.character(), self._driver
        if character is None or driver is None or self._room is None:
            return
        if self._carried is None:
            if self.role.first_seen(frames[-1:]) is None:
                return
            self._carried = _carried(self.role, frames, CaptureSpace(character, driver.plan), self._room)
            if driver.only is None:
                self._held.take(character)
        pose = frames[-1].performers[self.role.index]
        driver.apply(*self._carried.moved(pose.rotations, pose.root_position_m))

    def apply_again(self) -> None:
        if self._driver is not None and self.role.character() is not None:
            self._driver.apply_again()


def _carried(role: Role, frames: Sequence[ScenePose], own: CaptureSpace, room: CaptureSpace) -> RigidOffset:
    """Return what brings a further performer's poses into the room; the two agree where they were first seen."""
    first = role.first_seen(frames)
    if first is None:
        return own.carried_into(room, np.zeros(3))
    pose = frames[first].performers[role.index]
    joints, _ = forward_kinematics(role.subject.skeleton, pose.rotations, pose.root_position_m)
    return own.carried_into(room, np.array([pose.root_position_m[0], joints[:, 1].min(), pose.root_position_m[2]]))


def write_performer_actions(
    context: bpy.types.Context,
    roles: Sequence[Role],
    all_frames: Sequence[ScenePose],
    recorded: Sequence[ScenePose],
    at: Array,
    room: CaptureSpace,
    name: str,
) -> list[str]:
    """Write further performers' motion as actions of their characters, as is chosen; return the actions' names.

    Args:
        roles: who performs; one who was never seen leaves nothing, nor does one whose character has no bone selected
            where only those are to be moved.
        all_frames: poses of the whole capture, or take.
        recorded, at: (F,) those that are written, and the scene frame of each; keys begin where they are first seen.
        room: of the first performer's character.
        name: wished name of the actions, before the performer's.

    Raises:
        CharacterError: a character cannot be driven.
    """
    written = []
    for role in roles:
        first = role.first_seen(recorded)
        if first is None:
            continue
        is_new = role.character() is None
        role = role.cast(context, room)
        character, subject = bpy.data.objects[role.armature], role.subject
        plan = plan_for(character, subject.skeleton)
        how = placement(context, None if is_new else character, role.only)
        if how.only is not None and not how.only & {*plan.bones, *plan.located}:
            continue
        poses = [frame.performers[role.index] for frame in recorded[first:]]
        moved = _carried(role, all_frames, CaptureSpace(character, plan), room).moved(
            np.stack([pose.rotations for pose in poses]), np.stack([pose.root_position_m for pose in poses])
        )
        written.append(
            write_with_plan(character, at[first:], *moved, plan, name=f"{name} {subject.name}", placement=how)
        )
    return written
