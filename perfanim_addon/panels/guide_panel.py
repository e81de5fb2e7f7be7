"""Guide panel: the next step towards a capture with cameras."""

from typing import Any

import bpy

from ..capture.live_capture import running_capture
from ..jobs import activity
from ..preferences import body_network, preferences
from ..preferences.paths import ADDON
from ..preferences.property_kinds import draw_props, property_column
from ..preferences.sidebar_tab import SidebarPanel
from ..settings import guide_steps, readiness
from ..settings.capture_settings import settings
from .capture_panel import draw_notices
from .panel_drawing import draw_job, draw_text, header_status
from .step_panels import PERFANIM_PT_camera_controls, draw_ignored, draw_source

_NEXT = "Next: choose your own character under Character, and capture; every capture is listed under Takes"
_BY_HEIGHT = ("average_performer", "check_setup", "calibrate_walking")
_BOARD, _FOLDERS = ("board_columns", "board_rows", "board_square_mm"), ("board_left", "board_right")


class PERFANIM_PT_guide(SidebarPanel, bpy.types.Panel):
    """Panel with the next step: a sentence, its button and its result."""

    bl_label = "Guide"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        row = self.layout.row()
        number, *_ = guide_steps.next_step(settings(context))
        row.label(
            text=header_status(
                context, self.bl_label, f"step {number + 1} of {len(guide_steps.steps(settings(context)))}"
            )
        )
        row.separator()

    def draw(self, context: bpy.types.Context) -> None:
        layout, chosen = self.layout, settings(context)
        number, step, state = guide_steps.next_step(chosen)
        past = guide_steps.steps(chosen)[:number]
        skipped = ", ".join(step.title for step in past if guide_steps.is_skipped(chosen, step))
        done = ", ".join(step.title for step in past if not guide_steps.is_skipped(chosen, step))
        draw_text(context, layout, f"Done: {done}" if done else "", "CHECKMARK")
        if skipped:
            row = layout.row()
            draw_text(context, row, f"Skipped: {skipped}", "FF")
            row.operator("perfanim.unskip_steps", text="", icon="LOOP_BACK")
        draw_text(context, layout, f"{number + 1}. {step.title}", "FORWARD")
        draw_text(context, layout, step.text(chosen), "BLANK1")
        capture = running_capture()
        if capture is not None:
            layout.operator("perfanim.stop_capture", icon="SNAP_FACE")
            draw_notices(context, layout, capture)
            return
        _draw_settings(property_column(layout), chosen, step)
        if step is guide_steps.EXPOSURE and PERFANIM_PT_camera_controls.poll(context):
            preferences.draw_camera_controls(property_column(layout), context.preferences.addons[ADDON].preferences)
            layout.operator("perfanim.propose_exposure", icon="LIGHT_SUN")
        is_faulty = state.state is readiness.StepState.FAULTY
        for line in state.problem.splitlines() if is_faulty else ():
            draw_text(context, layout, line, "ERROR")
        if is_faulty and chosen.source == "SIMULATED" and chosen.practise_fault != "NONE":
            draw_text(context, layout, "in this practice, set Fault to None instead", "INFO")
        _draw_reflections(layout, chosen)
        draw_ignored(context, layout, chosen)
        name = step.operator(chosen)
        if name == "get_body_network":
            body_network.draw_buttons(layout)
        elif name:
            layout.operator(f"perfanim.{name}", icon="PLAY")
        if name == "calibrate_performer":
            layout.operator("perfanim.performer_screen", icon="WINDOW")
        if name == "calibrate_board" and chosen.source == "CAMERAS":
            layout.operator("perfanim.save_board", icon="FILE")
        passing = step.passing(chosen)
        if passing:
            layout.operator("perfanim.skip_step", text=passing, icon="FF")
        draw_job(context, layout, step.panel)
        text, icon = activity.message(step.panel)
        if icon == "ERROR" or (name != "check_setup" and not is_faulty):  # a good check needs no message
            draw_text(context, layout, text, icon)
        draw_text(context, layout, guide_steps.space(chosen), "ARROW_LEFTRIGHT")
        if step is guide_steps.STEPS[-1]:
            draw_text(context, layout, guide_steps.seen.walk, "ARMATURE_DATA")
            draw_text(context, layout, _NEXT if guide_steps.seen.is_walked else "", "FORWARD")


def _draw_reflections(layout: bpy.types.UILayout, chosen: Any) -> None:
    """Draw a button that ignores all reflections, and one for each."""
    numbers = guide_steps.reflections(chosen)
    if not numbers:
        return
    column = layout.column(align=True)
    column.operator("perfanim.ignore_reflections", icon="HIDE_ON").number = 0
    if len(numbers) > 1:
        grid = column.grid_flow(columns=3, even_columns=True, align=True, row_major=True)
        for number in numbers:
            grid.operator("perfanim.ignore_reflections", text=f"Only {number}").number = number


def _draw_settings(layout: bpy.types.UILayout, chosen: Any, step: guide_steps.GuideStep) -> None:
    """Draw those settings of the step that matter for the source."""
    if step is guide_steps.STEPS[0]:
        draw_source(layout, chosen)
    is_simulated, button = chosen.source == "SIMULATED", step.operator(chosen)
    hidden = {"practise_fault": not is_simulated, "subject_height": button not in _BY_HEIGHT}
    hidden |= dict.fromkeys(_BOARD, is_simulated or button == "calibrate_walking")
    if any(name in step.drawn and not hidden.get(name) for name in _BOARD):
        layout.label(text="Squares of the Board" if chosen.board_kind == "CHARUCO" else "Inner Corners of the Board")
    hidden |= dict.fromkeys(_FOLDERS, button != "calibrate_cameras")
    draw_props(layout, chosen, *(name for name in step.drawn if not hidden.get(name)))
