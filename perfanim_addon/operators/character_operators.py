"""Operators for the character: add, choose, map its bones."""

import bpy
import numpy as np

from ...core.body.calibration_poses import t_pose
from ...core.body.skeleton import Skeleton, forward_kinematics
from ...core.body.standard_skeleton import default_skeleton
from ...core.errors import CharacterError
from ...core.retarget.bone_map import checked_map
from ...core.retarget.bone_map_files import preset_paths, read_bone_map, write_bone_map
from ..capture.armature_driver import ArmatureDriver
from ..capture.performer_targets import add_character
from ..character.armature_reading import read_armature_rest
from ..character.bone_map_settings import store_map
from ..character.create_character import find_armature, own_map
from ..character.retarget_plans import PRESETS_FOLDER, find_map
from ..character.selection import active_armatures
from ..panels.character_panel import shown_armature
from ..preferences.paths import absolute, user_folder
from ..preferences.property_kinds import HIDDEN, string
from ..settings import readiness
from ..settings.capture_settings import PERFANIM_PG_settings, settings
from .operator_bases import DialogOperator, UndoOperator, need

PANEL = "character"


def performer_skeleton(chosen: PERFANIM_PG_settings) -> Skeleton:
    """Return the subject's skeleton, or an average adult's."""
    known = readiness.found(readiness.subject, absolute(chosen.subject)) if chosen.subject else None
    return default_skeleton() if known is None else known.skeleton


class PERFANIM_OT_add_character(UndoOperator, bpy.types.Operator):
    """Add a humanoid armature with a simple mesh and the proportions of the subject"""

    bl_label = "Add Character"
    panel = PANEL

    def run(self, context: bpy.types.Context) -> None:
        add_character(context, performer_skeleton(settings(context)))


class PERFANIM_OT_use_active_armature(UndoOperator, bpy.types.Operator):
    """Animate the active armature; its bones are mapped to joints automatically"""

    bl_label = "Use Active Armature"
    panel = PANEL

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        count = len(active_armatures(context))
        if count > 1:
            return f"{context.object.name} has {count} armatures: select one of them"
        return "" if count else "Select an armature first"

    def run(self, context: bpy.types.Context) -> None:
        (armature_object,) = active_armatures(context)
        if own_map(armature_object) is None:
            find_map(armature_object, user_folder(PRESETS_FOLDER))  # raises for anything but humanoids
        settings(context).armature = armature_object


class _ArmatureOperator(UndoOperator):
    """Base of the operators for an armature's bone map."""

    panel = PANEL
    armature: string("Armature", "Armature to map; empty for the one chosen under Character", options=HIDDEN)
    missing_input = need(shown_armature, "Choose an armature first")

    def target(self, context: bpy.types.Context) -> bpy.types.Object:
        """Return the armature to work on; CharacterError if it is gone."""
        return find_armature(self.armature) if self.armature else settings(context).armature


class PERFANIM_OT_find_bones(_ArmatureOperator, bpy.types.Operator):
    """Map the bones to joints again, by their names and the shape of the rig"""

    bl_label = "Find Bones"

    def run(self, context: bpy.types.Context) -> None:
        armature_object = self.target(context)
        store_map(armature_object, find_map(armature_object, user_folder(PRESETS_FOLDER)))


class PERFANIM_OT_show_t_pose(_ArmatureOperator, bpy.types.Operator):
    """Put the character into the T pose to check the bone map; Undo restores the pose.
    A limb in the wrong place is mapped to the wrong bone"""

    bl_label = "Show T Pose"

    def run(self, context: bpy.types.Context) -> None:
        skeleton = performer_skeleton(settings(context))
        rotations = t_pose(skeleton)
        lowest_m = float(forward_kinematics(skeleton, rotations, np.zeros(3))[0][:, 1].min())
        ArmatureDriver(self.target(context).name, skeleton).apply(rotations, np.array([0.0, -lowest_m, 0.0]))


class PERFANIM_OT_pick_bone(_ArmatureOperator, bpy.types.Operator):
    """Map the active bone to the joint selected in the list"""

    bl_label = "Use Active Bone"

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        shown = shown_armature(context)
        if shown is not None and (not shown.perfanim_character.joints or shown.data.bones.active is None):
            return "Select a bone of the armature in Pose Mode first"
        return super().missing_input(context)

    def run(self, context: bpy.types.Context) -> None:
        armature_object = self.target(context)
        kept = armature_object.perfanim_character
        entry = kept.joints[min(kept.active, len(kept.joints) - 1)]
        entry.bone = armature_object.data.bones.active.name


class PERFANIM_OT_load_bone_map(_ArmatureOperator, bpy.types.Operator):
    """Load a saved bone map"""

    bl_label = "Load Bone Map"

    preset: bpy.props.StringProperty(options={"HIDDEN"})

    def run(self, context: bpy.types.Context) -> None:
        armature_object, path = self.target(context), preset_paths(user_folder(PRESETS_FOLDER)).get(self.preset)
        if path is None:
            raise CharacterError(f"there is no bone map {self.preset!r}", advice="open the menu again")
        store_map(armature_object, checked_map(read_armature_rest(armature_object), read_bone_map(path), self.preset))


class PERFANIM_OT_save_bone_map(DialogOperator, _ArmatureOperator, bpy.types.Operator):
    """Save the bone map under a name, for other characters with these bones"""

    bl_label = "Save Bone Map"
    bl_options = {"REGISTER"}

    name: string("Name", "Name of the bone map", "My Rig")

    def run(self, context: bpy.types.Context) -> str:
        kept = self.target(context).perfanim_character
        bones = {entry.name: entry.bone for entry in kept.joints if entry.bone}
        stem = bpy.path.clean_name(self.name).strip("_")
        if not stem or not bones:
            what = "the bone map needs a name and at least one bone"
            raise CharacterError(what, advice="type a name, and click Find Bones")
        path = user_folder(PRESETS_FOLDER) / f"{stem}.toml"
        write_bone_map(path, self.name, bones)
        return f"{self.name} saved as {path}"
