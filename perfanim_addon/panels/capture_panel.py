"""Capture panel and its settings."""

from collections.abc import Iterable
from typing import Any

import bpy

from ..capture.capture_run import Statistics
from ..capture.live_capture import LiveCapture, further_performers, running_capture
from ..character.part_bones import PARTS
from ..jobs import activity
from ..preferences.property_kinds import draw_props, property_column
from ..preferences.sidebar_tab import SidebarPanel
from ..settings import readiness, vmc_settings
from ..settings.capture_settings import OVERLAYS, settings
from .panel_drawing import draw_progress, draw_text, header_status


class PERFANIM_PT_capture(SidebarPanel, bpy.types.Panel):
    """Panel with Start and Stop, and statistics."""

    bl_label = "Capture"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        capture = running_capture()
        row = self.layout.row()
        if capture is not None:
            row.label(text=header_status(context, self.bl_label, capture.line), icon="REC")
        else:
            problem = readiness.first_missing_step(settings(context))
            row.alert = bool(problem)
            row.label(text="not ready" if problem else "ready", icon="ERROR" if problem else "CHECKMARK")
        row.separator()

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        capture = running_capture()
        row = layout.row()
        row.scale_y = 1.8
        if capture is not None:
            row.operator("perfanim.stop_capture", icon="SNAP_FACE")
            if capture.by_button:
                text = "Record" if capture.recording is None else "Stop Recording"
                row.operator("perfanim.record", text=text, icon="REC", depress=capture.recording is not None)
            self._draw_statistics(context, layout, capture)
        else:
            row.operator("perfanim.start_capture", icon="REC")
            problem = readiness.first_missing_step(settings(context))
            draw_text(context, layout, problem, "ERROR")
            if not problem:
                draw_text(context, layout, *activity.message("capture"))

    def _draw_statistics(self, context: bpy.types.Context, layout: bpy.types.UILayout, capture: LiveCapture) -> None:
        run = capture.run
        figures = run.statistics if run else Statistics()
        grid = layout.grid_flow(columns=2, even_columns=True, row_major=True)
        for text in (
            f"{figures.frames_per_s:.0f} frames/s",
            f"{figures.latency_s * 1000:.0f} ms latency",
            f"{figures.received} frames",
            f"{figures.solve_s * 1000:.0f} ms solver",
            "Cameras" if figures.skew_s is None else f"Cameras {figures.skew_s * 1000:+.1f} ms",
            f"{figures.blind} bad images",
            f"{figures.lost} dropped",
            f"{figures.not_shown} not drawn",
        ):
            grid.label(text=text)
        if run is None:
            draw_progress(layout, capture.job.fraction if capture.job else 0.0, capture.line)
        elif figures.received == 0:
            draw_progress(layout, run.fraction or 0.0, run.activity)
        else:
            draw_progress(layout, figures.confidence, f"Confidence {figures.confidence:.0%}")
        for name, confidence in further_performers(capture):
            draw_progress(layout, confidence, f"{name} {confidence:.0%}")
        if figures.waiting > 1:
            layout.label(text=f"Solver {figures.waiting} frames behind", icon="SORTTIME")
        draw_notices(context, layout, capture)


def draw_notices(context: bpy.types.Context, layout: bpy.types.UILayout, capture: LiveCapture) -> None:
    """Draw the current problems of a capture."""
    for text in capture.run.notices if capture.run else ():
        draw_text(context, layout, text, "ERROR")


class PERFANIM_PT_capture_settings(SidebarPanel, bpy.types.Panel):
    """Panel for the recording and filter settings."""

    bl_label = "Recording"
    bl_parent_id = "PERFANIM_PT_capture"

    def draw(self, context: bpy.types.Context) -> None:
        chosen = settings(context)
        self.layout.operator("perfanim.performer_screen", icon="WINDOW")
        column = property_column(self.layout)
        draw_props(column, chosen, "immediate", "smoothing_ms", "feet")
        _draw_flags(column, chosen, "overlay", [name for name, *_ in OVERLAYS])
        column = column.column()
        column.enabled = running_capture() is None
        column.prop(chosen, "record_by_button")
        row = column.row(align=True)
        row.prop(chosen, "record_countdown_s")
        row.prop(chosen, "record_sound", text="", icon="OUTLINER_OB_SPEAKER")
        draw_props(column, chosen, "record_length_s", "record_signal")
        column.prop(chosen.id_data.perfanim_result, "start")
        _draw_flags(column, chosen, "body_parts", PARTS)
        draw_props(column, chosen, "capture_preview", "extend_scene")


def _draw_flags(layout: bpy.types.UILayout, chosen: Any, name: str, flags: Iterable[str]) -> None:
    """Draw the flags of a setting in two columns, because one row would cut them off."""
    row = layout.split(factor=0.4)  # width of the names on the left
    row.use_property_split = False
    title = row.column()
    title.alignment = "RIGHT"
    title.label(text=chosen.bl_rna.properties[name].name)
    grid = row.grid_flow(columns=2, align=True, row_major=True)
    for flag in flags:
        grid.prop_enum(chosen, name, flag)


class PERFANIM_PT_sending(SidebarPanel, bpy.types.Panel):
    """Panel for the VMC output."""

    bl_label = "Send by VMC"
    bl_parent_id = "PERFANIM_PT_capture"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context: bpy.types.Context) -> None:
        self.layout.enabled = activity.current() is None
        self.layout.prop(context.scene.perfanim_sending, "on", text="")

    def draw(self, context: bpy.types.Context) -> None:
        chosen = context.scene.perfanim_sending
        column = property_column(self.layout)
        column.enabled = chosen.on and activity.current() is None
        draw_props(column, chosen, "host", "port")
        wrong = vmc_settings.sending_problem(chosen) if chosen.on else ""
        if wrong:
            self.layout.label(text=wrong, icon="ERROR")
