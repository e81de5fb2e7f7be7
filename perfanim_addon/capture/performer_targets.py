"""Performers of a capture or take, and their characters."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...core.body.scene_pose import ScenePose
from ...core.body.skeleton import Skeleton, forward_kinematics
from ...core.markers.subject import Subject
from ..character.body_mesh import remove_body
from ..character.create_character import create_character
from ..character.free_place import find_free_position, look_at
from ..settings import target_settings
from ..settings.capture_settings import settings
from .capture_space import CaptureSpace, RigidOffset


@dataclass(frozen=True)
class PerformerTarget:
    """A performer and their character."""

    subject: Subject
    index: int  # index in the poses; the first performer's character defines the capture space
    entry: int | None = None  # index among the scene's additional targets
    armature: str = ""  # name of the character; "" adds a new one
    only: frozenset[str] | None = None  # bones to move, None for all

    def first_seen(self, poses: Sequence[ScenePose]) -> int | None:
        """Return the index of the first pose that shows the performer, or None if none does."""
        return next((row for row, pose in enumerate(poses) if pose.performers[self.index].confidence > 0.0), None)

    def character(self) -> bpy.types.Object | None:
        """Return the character, or None if there is none or it was deleted."""
        found = bpy.data.objects.get(self.armature) if self.armature else None
        return found if _is_in_scene(found) else None

    def ensure_character(self, context: bpy.types.Context, space: CaptureSpace | None) -> "PerformerTarget":
        """Return the target with a character; if it has none, add one and choose it.

        The first performer's character stands in a free position, any other at the origin of the capture space and with
        its scale.
        """
        if self.character() is not None:
            return self
        if space is None:
            chosen = settings(context)
            name = chosen.armature.name if _is_in_scene(chosen.armature) and not self.armature else ""
            return replace(self, armature=name or add_character(context, self.subject.skeleton), only=None)
        entries = context.scene.perfanim_targets.entries
        entry = entries[self.entry] if self.entry is not None and self.entry < len(entries) else None
        if entry is not None and _is_in_scene(entry.armature):  # added meanwhile
            return replace(self, armature=entry.armature.name, only=None)
        name = create_character(context, self.subject.skeleton, self.subject.name)
        space.put_at_origin(bpy.data.objects[name])
        if entry is not None:
            entry.armature = bpy.data.objects[name]
        return replace(self, armature=name, only=None)

    def offset_into(self, space: CaptureSpace, own: CaptureSpace, poses: Sequence[ScenePose]) -> RigidOffset:
        """Return the offset from `own` into `space`, two spaces that agree where the performer was first seen."""
        first = self.first_seen(poses)
        if first is None:
            return own.offset_into(space, np.zeros(3))
        pose = poses[first].performers[self.index]
        joints, _ = forward_kinematics(self.subject.skeleton, pose.rotations, pose.root_position_m)
        x, _, z = pose.root_position_m
        return own.offset_into(space, np.array([x, joints[:, 1].min(), z]))


def performer_targets(context: bpy.types.Context, subjects: Sequence[Subject]) -> list[PerformerTarget]:
    """Return performers with the characters chosen in the settings and additional targets."""
    main = settings(context).armature
    targets = [PerformerTarget(subjects[0], 0, None, main.name if main else "")]
    entries = context.scene.perfanim_targets.entries
    names = [subject.name for subject in subjects[1:]]
    for index, entry in enumerate(target_settings.meant_for(context.scene, names), 1):
        chosen = entries[entry].armature if entry is not None else None
        name = chosen.name if chosen is not None and _is_in_scene(chosen) else ""
        targets.append(PerformerTarget(subjects[index], index, entry, name))
    return targets


def copy_targets(context: bpy.types.Context, subject: Subject) -> list[PerformerTarget]:
    """Return the further characters that the first performer moves, each from where it stands."""
    entries = enumerate(context.scene.perfanim_targets.entries)
    chosen = [(index, each.armature) for index, each in entries if each.kind == "CHARACTER"]
    return [
        PerformerTarget(subject, 0, index, armature.name)
        for index, armature in chosen
        if _is_in_scene(armature) and armature != settings(context).armature
    ]


def add_character(context: bpy.types.Context, skeleton: Skeleton) -> str:
    """Add a character in a free position and choose it, in place of one that was deleted; return its name."""
    before = settings(context).armature
    if before is not None and not _is_in_scene(before):
        remove_body(before)
    place = find_free_position(context)
    name = create_character(context, skeleton)
    character = bpy.data.objects[name]
    character.location = place
    settings(context).armature = character
    look_at(context, place)
    return name


def _is_in_scene(armature: bpy.types.Object | None) -> bool:
    """Return whether an armature is in a scene; a setting keeps even a deleted one in the file."""
    return armature is not None and bool(armature.users_scene)
