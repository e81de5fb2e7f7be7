"""The character that moves along."""

from collections.abc import Callable

import bpy
import numpy as np

from ...core.body.calibration_poses import t_pose
from ...core.body.skeleton import Skeleton, forward_kinematics
from ...core.body.standard_skeleton import default_skeleton
from ...core.errors import CharacterError, PerfanimError
from ...core.retarget.bone_map import BoneMap, checked_map
from ...core.retarget.bone_map_files import preset_paths, read_bone_map, write_bone_map
from ..capture.armature_driver import ArmatureDriver
from ..capture.write_take import add_character
from ..character.bone_map_settings import store_map
from ..character.create_character import check_armature, find_armature
from ..character.posing import PRESETS_FOLDER, find_map
from ..character.rig import read_armature_rest
from ..jobs import activity
from ..panels.character import shown_armature
from ..preferences.paths import absolute, user_folder
from ..settings import readiness
from ..settings.capture_settings import PERFANIM_PG_settings, settings
from . import common

PANEL = "character"


def performer_skeleton(chosen: PERFANIM_PG_settings) -> Skeleton:
    """Return the proportions for a new character: the subject's if there is one, else an average adult's."""
    found = readiness.subject(absolute(chosen.subject)) if chosen.subject else None
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
        activity.set_message(PANEL, "")
        return {"FINISHED"}


def _meant(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return the active armature, or that which the active object belongs to, or those below it.

    Importers leave a mesh or an empty of the character active.
    """
    active = context.object
    if active is None:
        return []
    above = active
    while above is not None:
        found = above if above.type == "ARMATURE" else above.find_armature()
        if found is not None:
            return [found]
        above = above.parent
    return [obj for obj in active.children_recursive if obj.type == "ARMATURE"]


class PERFANIM_OT_use_active_armature(bpy.types.Operator):
    """Let the armature of the active object move along; which bone is which joint is found by itself"""

    bl_idname = "perfanim.use_active_armature"
    bl_label = "Use Active Armature"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Needs an active armature, or something of its character that is active."""
        if not (common.in_scene(cls, context) and common.idle(cls)):
            return False
        count = len(_meant(context))
        if count == 0:
            cls.poll_message_set("Select an armature first")
        elif count > 1:
            cls.poll_message_set(f"{count} armatures hang on {context.object.name}: select one of them")
        return count == 1

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Choose it if it is a humanoid."""
        (armature_object,) = _meant(context)
        try:
            if check_armature(armature_object):
                find_map(armature_object, user_folder(PRESETS_FOLDER))
        except CharacterError as error:
            return common.failed(self, PANEL, error)
        settings(context).armature = armature_object
        activity.set_message(PANEL, "")
        return {"FINISHED"}


class _OnArmature:
    """What the operators on a chosen armature's bone map share."""

    bl_options = {"REGISTER", "UNDO"}
    armature: bpy.props.StringProperty(
        name="Armature",
        description="Whose bones are meant; empty: those of the armature chosen under Character",
        options={"HIDDEN", "SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Needs a chosen armature."""
        if not (common.in_scene(cls, context) and common.idle(cls)):
            return False
        if shown_armature(context) is None:
            cls.poll_message_set("Choose an armature first")
            return False
        return True

    def meant(self, context: bpy.types.Context) -> bpy.types.Object:
        """Return the armature that is meant; CharacterError when it is gone."""
        return find_armature(self.armature) if self.armature else settings(context).armature

    def use_map(self, context: bpy.types.Context, found: Callable[[bpy.types.Object], BoneMap]) -> set[str]:
        """Give the armature the bone map that `found` returns for it."""
        try:
            armature_object = self.meant(context)
            store_map(armature_object, found(armature_object))
        except PerfanimError as error:
            return common.failed(self, PANEL, error)
        activity.set_message(PANEL, "")
        return {"FINISHED"}


class PERFANIM_OT_find_bones(_OnArmature, bpy.types.Operator):
    """Find again which bone is which joint, by names and shape"""

    bl_idname = "perfanim.find_bones"
    bl_label = "Find Bones"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Find them."""
        return self.use_map(context, lambda armature: find_map(armature, user_folder(PRESETS_FOLDER)))


class PERFANIM_OT_show_t_pose(_OnArmature, bpy.types.Operator):
    """Put the character into the performer's T pose: a limb that does not point sideways, or straight down, is mapped
    to the wrong bone. Undo brings the pose back"""

    bl_idname = "perfanim.show_t_pose"
    bl_label = "Show T Pose"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Pose it."""
        chosen = settings(context)
        skeleton = performer_skeleton(chosen)
        rotations = t_pose(skeleton)
        lowest_m = float(forward_kinematics(skeleton, rotations, np.zeros(3))[0][:, 1].min())
        try:
            ArmatureDriver(self.meant(context).name, skeleton).apply(rotations, np.array([0.0, -lowest_m, 0.0]))
        except PerfanimError as error:
            return common.failed(self, PANEL, error)
        activity.set_message(PANEL, "")
        return {"FINISHED"}


class PERFANIM_OT_pick_bone(_OnArmature, bpy.types.Operator):
    """Use the bone that is active in the viewport for the joint chosen in the list"""

    bl_idname = "perfanim.pick_bone"
    bl_label = "Use Active Bone"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Needs an active bone and a list."""
        if not super().poll(context):
            return False
        armature_object = shown_armature(context)
        if not armature_object.perfanim_character.joints or armature_object.data.bones.active is None:
            cls.poll_message_set("Select a bone of the armature in Pose Mode first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Use it."""
        armature_object = self.meant(context)
        kept = armature_object.perfanim_character
        entry = kept.joints[min(kept.active, len(kept.joints) - 1)]
        entry.bone = armature_object.data.bones.active.name
        return {"FINISHED"}


class PERFANIM_OT_load_bone_map(_OnArmature, bpy.types.Operator):
    """Take which bone is which joint from a kept bone map"""

    bl_idname = "perfanim.load_bone_map"
    bl_label = "Load Bone Map"

    preset: bpy.props.StringProperty(options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Load it."""
        return self.use_map(context, self._kept)

    def _kept(self, armature_object: bpy.types.Object) -> BoneMap:
        path = preset_paths(user_folder(PRESETS_FOLDER)).get(self.preset)
        if path is None:
            raise CharacterError(f"there is no bone map {self.preset!r}", advice="open the menu again")
        return checked_map(read_armature_rest(armature_object), read_bone_map(path), self.preset)


class PERFANIM_OT_save_bone_map(_OnArmature, bpy.types.Operator):
    """Keep which bone is which joint under a name, for other characters with these bones"""

    bl_idname = "perfanim.save_bone_map"
    bl_label = "Save Bone Map"
    bl_options = {"REGISTER"}

    name: bpy.props.StringProperty(name="Name", description="Name of the bone map", default="My Rig")

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the name."""
        return context.window_manager.invoke_props_dialog(self)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Save it."""
        kept = self.meant(context).perfanim_character
        bones = {entry.name: entry.bone for entry in kept.joints if entry.bone}
        stem = bpy.path.clean_name(self.name).strip("_")
        try:
            if not stem or not bones:
                raise CharacterError("needs a name and bones", advice="type a name, and let the bones be found")
            path = user_folder(PRESETS_FOLDER) / f"{stem}.toml"
            write_bone_map(path, self.name, bones)
        except PerfanimError as error:
            return common.failed(self, PANEL, error)
        activity.set_message(PANEL, f"{self.name} is kept as {path}", "CHECKMARK")
        return {"FINISHED"}


_CLASSES = (
    PERFANIM_OT_add_character,
    PERFANIM_OT_use_active_armature,
    PERFANIM_OT_find_bones,
    PERFANIM_OT_pick_bone,
    PERFANIM_OT_show_t_pose,
    PERFANIM_OT_load_bone_map,
    PERFANIM_OT_save_bone_map,
)

register, unregister = bpy.utils.register_classes_factory(_CLASSES)
