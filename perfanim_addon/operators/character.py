"""The character that moves along."""

import bpy

from ...core.errors import CharacterError, PerfanimError
from ...core.product_skeleton import default_skeleton
from ...core.skeleton import Skeleton
from .. import running, states
from ..character import check_armature
from ..live import add_character
from ..place import absolute
from ..properties import PERFANIM_PG_settings, settings
from . import common

PANEL = "character"


def performer_skeleton(chosen: PERFANIM_PG_settings) -> Skeleton:
    """Return the proportions for a new character: the subject's if there is one, else an average adult's."""
    found = states.subject(absolute(chosen.subject)) if chosen.subject else None
    return default_skeleton() if found is None or isinstance(found, PerfanimError) else found.skeleton


class PERFANIM_OT_add_character(bpy.types.Operator):
    """Add a plain humanoid with a simple mesh and the proportions of the subject, ready for capture"""

    bl_idname = "perfanim.add_character"
    bl_label = "Add Character"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while nothing runs."""
        return common.in_scene(cls, context) and common.idle(cls)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add it."""
        try:
            add_character(context, performer_skeleton(settings(context)))
        except PerfanimError as error:
            return common.failed(self, PANEL, error)
        running.set_message(PANEL, "")
        return {"FINISHED"}


class PERFANIM_OT_use_active_armature(bpy.types.Operator):
    """Let the active armature move along; its bones must have the product's names"""

    bl_idname = "perfanim.use_active_armature"
    bl_label = "Use Active Armature"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Needs an active armature."""
        if not (common.in_scene(cls, context) and common.idle(cls)):
            return False
        if context.object is None or context.object.type != "ARMATURE":
            cls.poll_message_set("Select an armature first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Check the bones and choose it."""
        missing = check_armature(context.object)
        if missing:
            error = CharacterError(
                f"lacks {len(missing)} bones: {', '.join(missing)}",
                where=context.object.name,
                advice="rename its bones, or add a character",
            )
            return common.failed(self, PANEL, error)
        settings(context).armature = context.object
        running.set_message(PANEL, "")
        return {"FINISHED"}


_CLASSES = (PERFANIM_OT_add_character, PERFANIM_OT_use_active_armature)

register, unregister = bpy.utils.register_classes_factory(_CLASSES)
