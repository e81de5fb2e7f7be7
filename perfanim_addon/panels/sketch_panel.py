"""Sketch Motion panel."""

import bpy

from ..preferences.property_kinds import draw_props, property_column
from ..preferences.sidebar_tab import SidebarPanel
from ..settings import sketch_settings
from ..settings.capture_settings import settings
from ..sketch import live_sketch
from ..sketch.controls import controls_of
from ..sketch.live_sketch import KEY
from . import panel_drawing


class PERFANIM_PT_sketch(SidebarPanel, bpy.types.Panel):
    """Panel for a character's sketch."""

    bl_label = "Sketch Motion"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, armature = self.layout, settings(context).armature
        if armature is not None:
            layout.row(align=True).prop(armature.perfanim_sketch, "parts")
        row = layout.row(align=True)
        row.operator("perfanim.add_controls", icon="EMPTY_AXIS")
        row.operator("perfanim.add_controls", text="From Animation", icon="ACTION").from_action = True
        if armature is not None:
            layout.operator("perfanim.follow_rig", icon="CON_ARMATURE")
            if controls_of(armature):
                row = layout.row(align=True)
                row.operator("perfanim.draw_hips_path", icon="GREASEPENCIL")
                row.operator("perfanim.follow_curve", icon="CON_FOLLOWPATH")
                layout.operator("perfanim.solve_sketch", icon="OUTLINER_OB_ARMATURE")
                row = layout.row(align=True)
                is_live = live_sketch.current() is not None
                row.operator("perfanim.live_sketch", icon="PLAY", depress=is_live)
                row.operator("perfanim.bake_sketch", icon="NLA_PUSHDOWN")
            if armature.perfanim_sketch.action is not None:
                layout.operator("perfanim.take_up_sketch", icon="LOOP_BACK")
        panel_drawing.draw_outcome(context, layout, KEY)


class PERFANIM_PT_sketch_settings(SidebarPanel, bpy.types.Panel):
    """Panel for a sketch's settings."""

    bl_label = "Sketch Settings"
    bl_parent_id = "PERFANIM_PT_sketch"
    bl_options = {"DEFAULT_CLOSED"}  # the buttons and their message then fit in a small window

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        armature = settings(context).armature
        return armature is not None and bool(controls_of(armature))

    def draw(self, context: bpy.types.Context) -> None:
        layout, armature = self.layout, settings(context).armature
        are_shown = any(each.motion_path is not None for each in controls_of(armature).values())
        layout.operator("perfanim.show_motion_paths", icon="IPO_BEZIER", depress=are_shown)
        sketch_settings.draw(layout, armature.perfanim_sketch)
        draw_props(property_column(layout), context.scene.perfanim_result, "onto")
