"""Panels for the steps before a capture."""

from collections.abc import Callable
from typing import Any

import bpy

from ..capture.live_capture import running_capture
from ..preferences import body_network, preferences
from ..preferences.paths import ADDON
from ..preferences.property_kinds import draw_props, draw_rate, property_column
from ..preferences.sidebar_tab import SidebarPanel
from ..settings import camera_choice, ignored_places, readiness
from ..settings.capture_settings import settings
from . import character_panel
from .panel_drawing import draw_outcome, draw_text, header_status, job_of


def draw_source(layout: bpy.types.UILayout, chosen: Any) -> None:
    """Draw the choice of source, and the source's settings."""
    layout.prop(chosen, "source")
    if chosen.source in ("CAMERAS", "VIDEOS", "IMAGES"):
        layout.prop(chosen, "follow")
    if chosen.source == "SIMULATED":
        draw_props(layout, chosen, "behaviour", "practise")
    elif chosen.source == "CAMERAS":
        for side in ("left", "right"):
            layout.prop(chosen, f"{side}_camera")
            if getattr(chosen, f"{side}_device") == camera_choice.NETWORK:
                layout.prop(chosen, f"{side}_address")
            elif camera_choice.has_thumbnails():
                layout.template_icon_view(chosen, f"{side}_camera", show_labels=True, scale=4.0)
        if chosen.right_device != camera_choice.NONE:
            layout.prop(chosen, "further_devices")
        draw_props(layout, chosen, "width", "height")
        draw_rate(layout, chosen, "camera_fps")
    elif not readiness.has_cameras(chosen):
        draw_props(layout, chosen.id_data.perfanim_receiving, "port", "sender")
    elif chosen.source == "VIDEOS":
        draw_props(layout, chosen, "left_video", "right_video")
    else:
        draw_props(layout, chosen, "left_folder", "right_folder", "files_fps")


def draw_ignored(context: bpy.types.Context, layout: bpy.types.UILayout, chosen: Any) -> None:
    """Draw a line for each camera with ignored positions, and a button to forget them."""
    for camera, sentence in ignored_places.sentences(chosen) if readiness.has_cameras(chosen) else ():
        row = layout.row()
        draw_text(context, row, sentence, "HIDE_ON")
        row.operator("perfanim.forget_ignored", text="", icon="X").camera = camera


class _Step(SidebarPanel):
    bl_options = {"DEFAULT_CLOSED"}
    state: Callable[[Any], readiness.StepStatus]
    key = ""

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        row, job = self.layout.row(), job_of(self.key)
        if job is not None and job.heading:
            row.label(text=job.heading, icon="TIME")
        else:
            state = type(self).state(settings(context))
            row.alert = not state.ready or bool(state.doubt)
            text = header_status(context, self.bl_label, state.text)
            row.label(text=text, icon="ERROR" if row.alert else "CHECKMARK")
        row.separator()

    def draw(self, context: bpy.types.Context) -> None:
        chosen = settings(context)
        layout = self.layout
        column = property_column(layout)
        column.enabled = running_capture() is None
        self.draw_step(column, chosen)
        state = type(self).state(chosen)
        problem = state.problem or state.doubt
        if problem and job_of(self.key) is None:
            draw_text(context, layout, problem, "ERROR")
        elif state.ready and header_status(context, self.bl_label, state.text) != state.text:  # shortened above
            draw_text(context, layout, state.text, "CHECKMARK")
        draw_outcome(context, layout, self.key)

    def draw_step(self, layout: bpy.types.UILayout, chosen: Any) -> None:
        """Draw the step's own settings and buttons."""


class PERFANIM_PT_cameras(_Step, bpy.types.Panel):
    """Panel for image source and calibration."""

    bl_label = "Cameras"
    state = staticmethod(readiness.cameras)
    key = "cameras"

    def draw_step(self, layout: bpy.types.UILayout, chosen: Any) -> None:
        draw_source(layout, chosen)
        if readiness.follows_person(chosen) and body_network.problem():
            body_network.draw_buttons(layout)
        if readiness.is_known(chosen) or not readiness.has_cameras(chosen):
            return
        layout.prop(chosen, "calibration")
        if chosen.source in ("CAMERAS", "VIDEOS", "IMAGES") and readiness.follows_person(chosen):
            layout.prop(chosen, "subject_height")
            layout.operator("perfanim.calibrate_walking", icon="ARMATURE_DATA")
        draw_ignored(bpy.context, layout, chosen)
        box = layout.box().column()
        box.prop(chosen, "board_kind")
        box.label(text="Squares" if chosen.board_kind == "CHARUCO" else "Inner Corners")
        draw_props(box, chosen, "board_columns", "board_rows", "board_square_mm")
        if chosen.board_kind == "CHARUCO":
            draw_props(box, chosen, "board_code_mm", "board_dictionary")
        if chosen.source == "CAMERAS":
            box.operator("perfanim.save_board", icon="FILE")
            draw_props(box, chosen, "board_views", "board_timed")
            if chosen.board_timed:
                box.prop(chosen, "board_every_s")
        if chosen.source in ("CAMERAS", "SIMULATED"):
            box.operator("perfanim.calibrate_board", icon="CAMERA_STEREO")
            box.operator("perfanim.set_floor", icon="AXIS_TOP")
            box = layout.box().column()
            draw_props(box, chosen, "floor_height_mm", "floor_longest_mm")
            box.operator("perfanim.set_floor_markers", icon="AXIS_TOP")
        if chosen.source != "SIMULATED":
            box = layout.box().column()
            draw_props(box, chosen, "board_left", "board_right")
            box.operator("perfanim.calibrate_cameras", icon="IMAGE_DATA")


class PERFANIM_PT_markers(_Step, bpy.types.Panel):
    """Panel for the markers and their detection."""

    bl_label = "Markers"
    state = staticmethod(readiness.markers)
    key = "markers"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return not readiness.follows_person(settings(context))

    def draw_step(self, layout: bpy.types.UILayout, chosen: Any) -> None:
        row = layout.row()
        row.enabled = not chosen.marker_set_file
        row.prop(chosen, "marker_set")
        layout.prop(chosen, "marker_set_file")
        if not readiness.has_cameras(chosen):
            return
        if chosen.source == "CAMERAS":
            layout.prop(chosen, "background_s")
        layout.prop(chosen, "threshold_auto", text="Threshold Auto")
        row = layout.row()
        row.enabled = not chosen.threshold_auto
        row.prop(chosen, "threshold")


class PERFANIM_PT_subject(_Step, bpy.types.Panel):
    """Performer panel."""

    bl_label = "Subject"
    state = staticmethod(readiness.performer)
    key = "subject"

    def draw_step(self, layout: bpy.types.UILayout, chosen: Any) -> None:
        row = layout.row(align=True)
        row.prop(chosen, "subject")
        row.operator_menu_enum("perfanim.use_profile", "profile", text="", icon="COMMUNITY")
        box = layout.box().column()
        box.prop(chosen, "subject_name")
        if readiness.is_measured(chosen):
            if chosen.source == "CAMERAS":
                draw_props(box, chosen, "countdown_s", "between_s")
            box.operator("perfanim.calibrate_performer", icon="OUTLINER_OB_ARMATURE")
            box.operator("perfanim.record_t_pose", icon="ARMATURE_DATA")
        draw_props(box, chosen, "subject_take", "take_poses")
        box.operator("perfanim.calibrate_subject", icon="FILE_REFRESH")
        row = box.row(align=True)
        row.prop(chosen, "subject_height")
        row.operator("perfanim.average_performer", text="", icon="USER")


class PERFANIM_PT_database(_Step, bpy.types.Panel):
    """Motion Database panel."""

    bl_label = "Motion Database"
    state = staticmethod(readiness.motion)
    key = "database"

    def draw_step(self, layout: bpy.types.UILayout, chosen: Any) -> None:
        row = layout.row(align=True)
        row.prop(chosen, "database")
        row.operator("perfanim.use_starter_database", text="", icon="LOOP_BACK")
        layout.prop(chosen, "database_fps")
        layout.operator("perfanim.build_database", icon="IMPORT")
        layout.operator("perfanim.get_motion", icon="URL")


class PERFANIM_PT_character(_Step, bpy.types.Panel):
    """Character panel."""

    bl_label = "Character"
    state = staticmethod(readiness.character)
    key = "character"

    def draw_step(self, layout: bpy.types.UILayout, chosen: Any) -> None:
        layout.prop(chosen, "armature")
        row = layout.row(align=True)
        row.operator("perfanim.add_character", icon="ADD")
        row.operator("perfanim.use_active_armature", text="Use Active", icon="EYEDROPPER")
        character_panel.draw_bones(layout, chosen.armature)


class PERFANIM_PT_camera_controls(SidebarPanel, bpy.types.Panel):
    """Panel for the camera controls in the preferences."""

    bl_label = "Exposure, Gain, Focus"
    bl_parent_id = "PERFANIM_PT_cameras"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return settings(context).source == "CAMERAS" and ADDON in context.preferences.addons

    def draw(self, context: bpy.types.Context) -> None:
        preferences.draw_camera_controls(property_column(self.layout), context.preferences.addons[ADDON].preferences)
