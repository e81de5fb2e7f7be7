"""Hands panel: presets for the fingers."""

import bpy

from ...core.retarget.hand_poses import HAND_POSES
from ..capture.live_capture import running_capture
from ..preferences.sidebar_tab import SidebarPanel
from . import panel_drawing

KEY = "hands"
SIDES = {"LEFT": "l", "BOTH": "lr", "RIGHT": "r"}


class PERFANIM_PT_hands(SidebarPanel, bpy.types.Panel):
    """Panel with a row of buttons for each pose."""

    bl_label = "Hands"
    bl_parent_id = "PERFANIM_PT_character"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        is_live = running_capture() is not None
        name = "perfanim.pose_hands_live" if is_live else "perfanim.pose_hands"
        column = layout.column(align=True)
        for number, pose in enumerate(HAND_POSES, 1):
            split = column.split(factor=0.36, align=True)
            split.label(text=f"{number}  {pose.capitalize()}")
            row = split.row(align=True)
            for side in SIDES:
                button = row.operator(name, text=side.capitalize())
                button.pose, button.side = pose.upper(), side
        if is_live:
            layout.label(text="Keys 1 to 5; Shift: left, Ctrl: right")
        panel_drawing.draw_outcome(context, layout, KEY)
