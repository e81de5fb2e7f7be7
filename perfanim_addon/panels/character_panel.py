"""Bone map in the Character panel: joints, their bones, and doubtful matches."""

from typing import Any

import bpy

from ...core.body.standard_skeleton import joint_label
from ...core.retarget.bone_map import EXPECTED, MatchState
from ...core.retarget.bone_map_files import preset_paths
from ..character.create_character import own_map
from ..character.retarget_plans import PRESETS_FOLDER
from ..preferences.paths import user_folder
from ..preferences.property_kinds import draw_props, property_column
from ..settings.capture_settings import settings
from .panel_drawing import RowList

_SHOWN = "perfanim_armature"  # context member for the buttons and the menu
_ICONS = {MatchState.MAPPED.value: "CHECKMARK", MatchState.SUSPECT.value: "QUESTION"}


class PERFANIM_UL_joints(RowList, bpy.types.UIList):
    """List with one joint and its bone per row."""

    bl_idname = "PERFANIM_UL_joints"

    def draw_row(self, layout: bpy.types.UILayout, item: Any) -> None:
        needed = item.name in EXPECTED
        row = layout.row(align=True)
        row.alert = item.state == MatchState.SUSPECT.value or (needed and item.state == MatchState.MISSING.value)
        split = row.split(factor=0.46, align=True)
        split.label(text=joint_label(item.name), icon=_ICONS.get(item.state, "ERROR" if needed else "RADIOBUT_OFF"))
        kept = item.id_data.perfanim_character
        if kept.joints[min(kept.active, len(kept.joints) - 1)] == item:
            split.prop_search(item, "bone", item.id_data.data, "bones", text="")
        else:  # without the prefix that all names share, bones can be told apart in a narrow column
            split.label(text=item.bone.rpartition(":")[2], icon="BONE_DATA" if item.bone else "NONE")


class PERFANIM_MT_bone_maps(bpy.types.Menu):
    """Shipped bone maps, and those in the user's folder"""

    bl_idname = "PERFANIM_MT_bone_maps"
    bl_label = "Bone Maps"

    def draw(self, context: bpy.types.Context) -> None:
        folder, shown = user_folder(PRESETS_FOLDER), shown_armature(context)
        for name in sorted(preset_paths(folder)):
            button = self.layout.operator("perfanim.load_bone_map", text=name.replace("-", " ").title())
            button.preset, button.armature = name, shown.name if shown is not None else ""
        self.layout.separator()
        self.layout.operator("wm.path_open", text="Open My Folder", icon="FILE_FOLDER").filepath = str(folder)


def shown_armature(context: bpy.types.Context) -> bpy.types.Object | None:
    """Return the armature of the panel being drawn, else the first performer's."""
    return getattr(context, _SHOWN, None) or settings(context).armature


def draw_bones(layout: bpy.types.UILayout, armature_object: bpy.types.Object | None, list_id: str = "") -> None:
    """Draw the bone map of an armature; no bones for a new character."""
    if armature_object is None:
        return
    layout = layout.column()
    layout.context_pointer_set(_SHOWN, armature_object)
    kept = armature_object.perfanim_character
    if kept.joints:
        column = layout.column()
        column.template_list(PERFANIM_UL_joints.bl_idname, list_id, kept, "joints", kept, "active", rows=8)
        entry = kept.joints[min(kept.active, len(kept.joints) - 1)]
        if entry.reason:
            column.label(text=entry.reason, icon="INFO")
        column.operator("perfanim.pick_bone", icon="EYEDROPPER").armature = armature_object.name
    if kept.joints or own_map(armature_object) is None:
        row = layout.row(align=True)
        row.operator("perfanim.find_bones", icon="VIEWZOOM").armature = armature_object.name
        row.menu(PERFANIM_MT_bone_maps.bl_idname, text="", icon="PRESET")
        row.operator("perfanim.save_bone_map", text="", icon="ADD").armature = armature_object.name
    layout.operator("perfanim.show_t_pose", icon="ARMATURE_DATA").armature = armature_object.name
    layout.prop(kept, "root_motion")
    header, body = layout.panel("perfanim_adjust" + list_id, default_closed=True)
    header.label(text="Adjust")
    if body is not None:
        draw_props(property_column(body), kept, "hip_height", "shoulder", "arm_spread", "foot_pitch")
