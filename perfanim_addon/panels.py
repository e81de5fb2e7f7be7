"""The sidebar's tab: one sub-panel a step, in the order of the work, each with its state in its header line."""

from collections.abc import Callable
from typing import Any

import bpy

from . import panel_character
from .capture.live_capture import Capture
from .character.body_parts import PARTS
from .jobs import activity as running
from .jobs.job import Job
from .panel_camera_controls import PERFANIM_PT_camera_controls
from .panel_sending import PERFANIM_PT_sending
from .preferences import preferences
from .preferences.sidebar_tab import SidebarPanel, register_panels, unregister_panels
from .settings import readiness
from .settings.capture_settings import settings

# Width of a character, and of what a line has beside its text (icon, margins, tabs), in unscaled pixels.
CHARACTER_PX = 6.2
MARGIN_PX = 90.0
ICON_CHARACTERS = 4  # as wide as so many
LEAST_SAID = 8  # characters of a state, however narrow the sidebar is


class _Step(SidebarPanel):
    """What the sub-panels share."""

    bl_options = {"DEFAULT_CLOSED"}
    state: Callable[[Any], readiness.State]
    key = ""

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        """Draw the state at the right of the header line."""
        row = self.layout.row()
        job = running.current()
        if isinstance(job, Job) and job.panel == self.key and job.heading:
            row.label(text=job.heading, icon="TIME")
        else:
            state = type(self).state(settings(context))
            row.alert = not state.ready
            room = max(LEAST_SAID, characters(context) - len(self.bl_label) - ICON_CHARACTERS)
            row.label(text=shortened(state.text, room), icon="CHECKMARK" if state.ready else "ERROR")
        row.separator()

    def draw(self, context: bpy.types.Context) -> None:
        """Draw."""
        chosen = settings(context)
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column()
        column.enabled = not isinstance(running.current(), Capture)
        self.draw_step(column, chosen)
        state = type(self).state(chosen)
        job = running.current()
        if state.problem and not (isinstance(job, Job) and job.panel == self.key):
            draw_text(context, layout, state.problem, "ERROR")
        draw_job(layout, self.key)
        draw_text(context, layout, *running.message(self.key))

    def draw_step(self, layout: bpy.types.UILayout, chosen: Any) -> None:
        """Draw the step's own settings and buttons."""


class PERFANIM_PT_cameras(_Step, bpy.types.Panel):
    """Source of the images and calibration."""

    bl_label = "Cameras"
    state = staticmethod(readiness.cameras)
    key = "cameras"

    def draw_step(self, layout: bpy.types.UILayout, chosen: Any) -> None:
        """Draw."""
        layout.prop(chosen, "source")
        if chosen.source == "SIMULATED":
            _props(layout, chosen, "behaviour", "practise")
            if readiness.is_known(chosen):
                return
        elif chosen.source == "CAMERAS":
            _props(layout, chosen, "left_device", "right_device")
            if chosen.right_device >= 0:
                layout.prop(chosen, "further_devices")
            _props(layout, chosen, "width", "height", "camera_fps")
        elif not readiness.has_cameras(chosen):
            _props(layout, chosen.id_data.perfanim_receiving, "port", "sender")
            return
        elif chosen.source == "VIDEOS":
            _props(layout, chosen, "left_video", "right_video")
        else:
            _props(layout, chosen, "left_folder", "right_folder", "files_fps")
        layout.prop(chosen, "calibration")
        box = layout.box().column()
        box.prop(chosen, "board_kind")
        box.label(text="Squares" if chosen.board_kind == "CHARUCO" else "Inner corners")
        _props(box, chosen, "board_columns", "board_rows", "board_square_mm")
        if chosen.board_kind == "CHARUCO":
            _props(box, chosen, "board_code_mm", "board_dictionary")
        if chosen.source == "CAMERAS":
            box.operator("perfanim.save_board", icon="FILE")
            _props(box, chosen, "board_views", "board_timed")
            if chosen.board_timed:
                box.prop(chosen, "board_every_s")
        if chosen.source in ("CAMERAS", "SIMULATED"):
            box.operator("perfanim.calibrate_board", icon="CAMERA_STEREO")
            box.operator("perfanim.set_floor", icon="AXIS_TOP")
            box = layout.box().column()
            _props(box, chosen, "floor_height_mm", "floor_longest_mm")
            box.operator("perfanim.set_floor_markers", icon="AXIS_TOP")
        if chosen.source != "SIMULATED":
            box = layout.box().column()
            _props(box, chosen, "board_left", "board_right")
            box.operator("perfanim.calibrate_cameras", icon="IMAGE_DATA")


class PERFANIM_PT_markers(_Step, bpy.types.Panel):
    """Which markers are worn and how they are found."""

    bl_label = "Markers"
    state = staticmethod(readiness.markers)
    key = "markers"

    def draw_step(self, layout: bpy.types.UILayout, chosen: Any) -> None:
        """Draw."""
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
    """Who performs."""

    bl_label = "Subject"
    state = staticmethod(readiness.performer)
    key = "subject"

    def draw_step(self, layout: bpy.types.UILayout, chosen: Any) -> None:
        """Draw."""
        row = layout.row(align=True)
        row.prop(chosen, "subject")
        row.operator_menu_enum("perfanim.use_profile", "profile", text="", icon="COMMUNITY")
        box = layout.box().column()
        box.prop(chosen, "subject_name")
        if not readiness.is_known(chosen) and readiness.has_cameras(chosen) and not readiness.is_one_camera(chosen):
            if chosen.source == "CAMERAS":
                _props(box, chosen, "countdown_s", "between_s")
            box.operator("perfanim.calibrate_performer", icon="OUTLINER_OB_ARMATURE")
            box.operator("perfanim.record_t_pose", icon="ARMATURE_DATA")
        _props(box, chosen, "subject_take", "take_poses")
        box.operator("perfanim.calibrate_subject", icon="FILE_REFRESH")
        row = box.row(align=True)
        row.prop(chosen, "subject_height")
        row.operator("perfanim.average_performer", text="", icon="USER")


class PERFANIM_PT_database(_Step, bpy.types.Panel):
    """Recorded motion that fills in what the markers do not show."""

    bl_label = "Motion Database"
    state = staticmethod(readiness.motion)
    key = "database"

    def draw_step(self, layout: bpy.types.UILayout, chosen: Any) -> None:
        """Draw."""
        row = layout.row(align=True)
        row.prop(chosen, "database")
        row.operator("perfanim.use_starter_database", text="", icon="LOOP_BACK")
        layout.prop(chosen, "database_fps")
        layout.operator("perfanim.build_database", icon="IMPORT")


class PERFANIM_PT_character(_Step, bpy.types.Panel):
    """Who moves along."""

    bl_label = "Character"
    state = staticmethod(readiness.character)
    key = "character"

    def draw_step(self, layout: bpy.types.UILayout, chosen: Any) -> None:
        """Draw."""
        layout.prop(chosen, "armature")
        row = layout.row(align=True)
        row.operator("perfanim.add_character", icon="ADD")
        row.operator("perfanim.use_active_armature", text="Use Active", icon="EYEDROPPER")
        panel_character.draw_bones(layout, chosen.armature)


class PERFANIM_PT_capture(SidebarPanel, bpy.types.Panel):
    """Start, stop, and how it goes."""

    bl_label = "Capture"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        """Draw the state at the right of the header line."""
        activity = running.current()
        row = self.layout.row()
        if isinstance(activity, Capture):
            row.label(text=activity.line, icon="REC")
        else:
            problem = readiness.first_problem(settings(context))
            row.alert = bool(problem)
            row.label(text="not ready" if problem else "ready", icon="ERROR" if problem else "CHECKMARK")
        row.separator()

    def draw(self, context: bpy.types.Context) -> None:
        """Draw."""
        layout = self.layout
        activity = running.current()
        row = layout.row()
        row.scale_y = 1.8
        if isinstance(activity, Capture):
            row.operator("perfanim.stop_capture", icon="SNAP_FACE")
            if activity.by_button:
                text = "Record" if activity.recording is None else "Stop Recording"
                row.operator("perfanim.record", text=text, icon="REC", depress=activity.recording is not None)
            self._draw_figures(context, layout, activity)
        else:
            row.operator("perfanim.start_capture", icon="REC")
            problem = readiness.first_problem(settings(context))
            draw_text(context, layout, problem, "ERROR")
            if not problem:
                draw_text(context, layout, *running.message("capture"))

    def _draw_figures(self, context: bpy.types.Context, layout: bpy.types.UILayout, capture: Capture) -> None:
        run = capture.run
        if run is None:
            draw_progress(layout, capture.job.fraction if capture.job else 0.0, capture.line)
            return
        figures = run.statistics
        if figures.received == 0 and run.fraction is not None:
            draw_progress(layout, run.fraction, run.activity)
        grid = layout.grid_flow(columns=2, even_columns=True, row_major=True)
        grid.label(text=f"{figures.frames_per_s:.0f} frames/s")
        grid.label(text=f"{figures.latency_s * 1000:.0f} ms latency")
        grid.label(text=f"{figures.received} frames")
        grid.label(text=f"{figures.solve_s * 1000:.0f} ms of it solver")
        if figures.skew_s is not None:
            grid.label(text=f"Cameras {figures.skew_s * 1000:+.1f} ms")
            grid.label(text=f"{figures.blind} bad images")
        grid.label(text=f"{figures.lost} dropped")
        grid.label(text=f"{figures.not_shown} not drawn")
        draw_progress(layout, figures.confidence, f"Confidence {figures.confidence:.0%}")
        for name, confidence in capture.further:
            draw_progress(layout, confidence, f"{name} {confidence:.0%}")
        if figures.waiting > 1:
            layout.label(text=f"Solver {figures.waiting} frames behind", icon="SORTTIME")
        draw_text(context, layout, run.notice, "ERROR")


class PERFANIM_PT_capture_settings(SidebarPanel, bpy.types.Panel):
    """How it is recorded, and what is done to the motion."""

    bl_label = "Recording"
    bl_parent_id = "PERFANIM_PT_capture"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw."""
        chosen, is_live = settings(context), isinstance(running.current(), Capture)
        column = self.layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        _props(column, chosen, "smoothing_ms", "feet")
        column.row().prop(chosen, "overlay")
        column = column.column()
        column.enabled = not is_live
        column.prop(chosen, "record_by_button")
        row = column.row(align=True)
        row.prop(chosen, "record_countdown_s")
        row.prop(chosen, "record_sound", text="", icon="OUTLINER_OB_SPEAKER")
        _props(column, chosen, "record_length_s")
        column.prop(chosen.id_data.perfanim_result, "start")
        row = column.row(align=True)
        row.use_property_split = False
        row.label(text="Only")
        parts = row.grid_flow(columns=2, align=True, row_major=True)
        for part in PARTS:
            parts.prop_enum(chosen, "body_parts", part)
        _props(column, chosen, "capture_preview", "extend_scene")


def _props(layout: bpy.types.UILayout, chosen: Any, *names: str) -> None:
    for name in names:
        layout.prop(chosen, name)


def draw_progress(layout: bpy.types.UILayout, fraction: float, text: str) -> None:
    """Draw a bar with text."""
    layout.progress(factor=min(max(fraction, 0.0), 1.0), text=text)


def draw_job(layout: bpy.types.UILayout, panel: str) -> None:
    """Draw the progress of a job of this panel, its Cancel and, where it has one, Finish Now."""
    job = running.current()
    if isinstance(job, Job) and job.panel == panel:
        row = layout.row(align=True)
        draw_progress(row, job.fraction, job.text)
        row.operator("perfanim.cancel_job", text="", icon="X")
        if job.finishable:
            layout.operator("perfanim.finish_job", icon="CHECKMARK")


def draw_text(context: bpy.types.Context, layout: bpy.types.UILayout, text: str, icon: str) -> None:
    """Draw a sentence over as many lines as it takes in a sidebar of this width; nothing for ""."""
    column = layout.column(align=True)
    text = text[:1].upper() + text[1:]
    for index, line in enumerate(wrapped(text, characters(context))):
        column.label(text=line, icon=icon if index == 0 else "BLANK1")


def characters(context: bpy.types.Context) -> int:
    """Return how many characters a line of the sidebar has room for beside its icon and margins."""
    unscaled_px = context.region.width / context.preferences.system.ui_scale
    return max(16, int((unscaled_px - MARGIN_PX) / CHARACTER_PX))


def shortened(text: str, width: int) -> str:
    """Return the text, cut to at most `width` characters: a longer one would lie over what stands before it."""
    return text if len(text) <= width else text[: width - 1].rstrip(" ,") + "…"


def wrapped(text: str, width: int) -> list[str]:
    """Return the text cut into lines of at most `width` characters; long paths are cut wherever it must be."""
    lines: list[str] = []
    for word in text.split():
        if lines and len(lines[-1]) + 1 + len(word) <= width:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
        while len(lines[-1]) > width:
            lines[-1:] = [lines[-1][:width], lines[-1][width:]]
    return lines


_CLASSES = (
    PERFANIM_PT_cameras,
    PERFANIM_PT_camera_controls,
    PERFANIM_PT_markers,
    PERFANIM_PT_subject,
    PERFANIM_PT_database,
    PERFANIM_PT_character,
    PERFANIM_PT_capture,
    PERFANIM_PT_capture_settings,
    PERFANIM_PT_sending,
)


def register() -> None:
    """Register the panels in the tab that the preferences name."""
    for order, cls in enumerate(_CLASSES):
        cls.bl_order = order
    register_panels(preferences.tab(bpy.context), *_CLASSES)


def unregister() -> None:
    """Undo `register`."""
    unregister_panels(*_CLASSES)
