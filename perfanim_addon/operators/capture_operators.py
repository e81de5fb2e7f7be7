"""Operators for the live capture: start, stop, record."""

import time

import bpy

from ...core.errors import PerfanimError
from ...core.retarget.hand_poses import HAND_POSES
from ..capture.live_capture import LiveCapture, judge_capture, refining_take, running_capture
from ..capture.tuning import TUNING
from ..jobs import activity
from ..preferences import preferences
from ..settings import guide_steps, readiness
from ..settings.capture_settings import settings
from ..settings.performer_refinement import offer
from .database_operators import is_starter_missing, starter_job
from .operator_bases import CheckedOperator, RunningOperator, defect, need, report_error

PANEL = "capture"
_TOO_SHORT = "the test walk was too short to say how good captures will be: walk about for ten seconds"
_HAND_KEYS = dict(zip(("ONE", "TWO", "THREE", "FOUR", "FIVE"), HAND_POSES, strict=True))


class PERFANIM_OT_start_capture(CheckedOperator, bpy.types.Operator):
    """Animate the character live and record an action until Stop Capture or Esc"""

    bl_label = "Start Capture"
    bl_options = {"REGISTER", "UNDO"}
    missing_input = staticmethod(lambda context: readiness.first_missing_step(settings(context)))

    def execute(self, context: bpy.types.Context) -> set[str]:
        activity.set_message(PANEL, "")
        offer.capture = ""
        try:
            python = preferences.worker_python(context)
            capture = LiveCapture(python, starter_job(PANEL, python) if is_starter_missing(context) else None)
        except PerfanimError as error:
            return report_error(self, PANEL, error)
        self._capture = capture
        self._shown_at = 0.0
        self._status = ""
        activity.begin(context, capture, TUNING.tick_s)
        context.window_manager.modal_handler_add(self)
        if not bpy.data.is_dirty and bpy.ops.ed.undo_push.poll():
            bpy.ops.ed.undo_push(message=self.bl_label)  # so that quitting asks: Blender does only if the file changed
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if activity.current() is not self._capture:
            return self._finish(context)
        if event.type == "ESC" and event.value == "PRESS":
            self._capture.stop()
            return {"RUNNING_MODAL"}
        if event.type in _HAND_KEYS and event.value == "PRESS" and not event.alt:
            self._pose_hands(_HAND_KEYS[event.type], "l" if event.shift else "r" if event.ctrl else "lr")
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            posed = self._capture.tick(context)
            self._show(context, posed)
        except PerfanimError as error:
            return self._finish(context, error)
        except Exception as error:  # a bug must not leave timer and worker behind, nor lose the recording
            return self._finish(context, defect(error))
        if self._capture.done:
            return self._finish(context, self._capture.run.error)
        return {"PASS_THROUGH"}

    def _pose_hands(self, name: str, sides: str) -> None:
        try:
            self._capture.pose_hands(name, sides)
        except PerfanimError as error:
            report_error(self, PANEL, error)

    def _show(self, context: bpy.types.Context, posed: bool) -> None:
        """Redraw the statistics once a second, if possible with a new pose, since this redraws the viewport too."""
        now = time.perf_counter()
        if now - self._shown_at > (TUNING.sidebar_s if posed else 2.0 * TUNING.sidebar_s):
            self._shown_at = now
            activity.redraw_sidebars()
            text = f"Perfanim: {self._capture.line}.  Esc or Stop Capture: stop and keep"
            if text != self._status:
                self._status = text
                context.workspace.status_text_set(text)

    def _finish(self, context: bpy.types.Context, error: PerfanimError | None = None) -> set[str]:
        """End the capture and write the recording as actions."""
        capture = self._capture
        if activity.current() is capture:
            activity.end()
        context.workspace.status_text_set(None)
        text = ""
        try:
            text = capture.keep(context)
            verdict = judge_capture(capture)
            guide_steps.seen.is_walked = bool(verdict)
            guide_steps.seen.walk = verdict or _TOO_SHORT
            offer.capture = refining_take(capture, settings(context))
        except PerfanimError as second:
            error = error or second
        if text or error is None:
            is_counting = capture.run is not None and bool(capture.run.poses)
            if not text and capture.by_button and is_counting:
                text = "nothing was recorded"
            text = text or ("stopped in the countdown" if is_counting else "stopped before the first frame")
            activity.set_message(PANEL, text, about=capture.actions)
            self.report({"INFO"}, text)
        if error is not None:
            report_error(self, PANEL, error)
            activity.set_message(PANEL, "; ".join(filter(None, (str(error), text))), "ERROR", capture.actions)
        activity.redraw_sidebars()
        return {"FINISHED"} if capture.run is not None and capture.run.poses else {"CANCELLED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Keep the recording because the window is closing."""
        if activity.current() is not self._capture:
            return  # already kept before a file was loaded or the add-on was disabled
        try:
            text = activity.finish(context)
        except PerfanimError as error:
            report_error(self, PANEL, error)
            return
        activity.set_message(PANEL, text, about=self._capture.actions)
        if text and bpy.ops.ed.undo_push.poll():
            bpy.ops.ed.undo_push(message=self.bl_label)


class PERFANIM_OT_stop_capture(RunningOperator, bpy.types.Operator):
    """Stop the capture; the recorded frames are kept as actions"""

    bl_label = "Stop Capture"
    missing_input = need(lambda context: running_capture(), "No capture is running")

    def execute(self, context: bpy.types.Context) -> set[str]:
        activity.current().stop()
        return {"FINISHED"}


class PERFANIM_OT_record(RunningOperator, bpy.types.Operator):
    """Start a recording, after its countdown, or stop it; the capture continues"""

    bl_label = "Record"

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        capture = running_capture()
        if capture is None or capture.run is None:
            return "Start the capture first"
        return "" if capture.by_button else "This capture records from its start; enable Record by Button first"

    def execute(self, context: bpy.types.Context) -> set[str]:
        activity.current().record(settings(context))
        activity.redraw_sidebars()
        return {"FINISHED"}
