"""Live capture: the modal operator and its Stop."""

import time
import traceback

import bpy

from ...core.errors import CaptureError, PerfanimError
from ..capture.live_capture import LiveCapture
from ..jobs import activity
from ..preferences import preferences
from ..settings import readiness
from ..settings.capture_settings import settings
from . import common
from .database import starter_arguments

PANEL = "capture"
TICK_S = 1 / 60
SIDEBAR_S = 1.0  # the figures are redrawn this often, the viewport only when bones move


class PERFANIM_OT_start_capture(bpy.types.Operator):
    """Let the character follow the performer until Stop Capture or Esc; what is recorded becomes an Action"""

    bl_idname = "perfanim.start_capture"
    bl_label = "Start Capture"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only if every step is ready."""
        if not (common.in_scene(cls, context) and common.idle(cls)):
            return False
        problem = readiness.first_problem(settings(context))
        if problem:
            cls.poll_message_set(problem)
        return not problem

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start; the timer goes on with it."""
        activity.set_message(PANEL, "")
        chosen = settings(context)
        prepare = []
        try:
            if not chosen.database and not readiness.starter_database_path().exists():
                prepare = starter_arguments()
            capture = LiveCapture(preferences.worker_python(context), prepare)
        except PerfanimError as error:
            return common.failed(self, PANEL, error)
        self._capture = capture
        self._shown_at = 0.0
        self._status = ""
        activity.begin(context, capture, TICK_S)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Advance at each tick; everything else passes through."""
        if activity.current() is not self._capture:
            return self._finish(context)
        if event.type == "ESC" and event.value == "PRESS":
            self._capture.stop()
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            posed = self._capture.tick(context)
            self._show(context, posed)
        except PerfanimError as error:
            return self._finish(context, error)
        except Exception as error:
            # A defect must not leave timer and worker behind, nor lose what is recorded.
            traceback.print_exc()
            text = f"{type(error).__name__}: {error}"
            return self._finish(context, CaptureError(text, advice="see the console, and report this"))
        if self._capture.done:
            return self._finish(context, self._capture.run.error)
        return {"PASS_THROUGH"}

    def _show(self, context: bpy.types.Context, posed: bool) -> None:
        """Redraw the figures now and then; the viewport is redrawn by the moving bones themselves.

        Together with a new pose where one comes: Blender draws the viewport again for the sidebar that lies over it.
        """
        now = time.perf_counter()
        if now - self._shown_at > (SIDEBAR_S if posed else 2.0 * SIDEBAR_S):
            self._shown_at = now
            activity.redraw_sidebars()
            text = f"Perfanim: {self._capture.line}.  Esc or Stop Capture: end and keep"
            if text != self._status:
                self._status = text
                context.workspace.status_text_set(text)

    def _finish(self, context: bpy.types.Context, error: PerfanimError | None = None) -> set[str]:
        """End everything, keep what was captured as one Action."""
        capture = self._capture
        if activity.current() is capture:
            activity.end()
        context.workspace.status_text_set(None)
        text = ""
        try:
            text = capture.keep(context)
        except PerfanimError as second:
            error = error or second
        if text or error is None:
            is_counting = capture.run is not None and bool(capture.run.poses)
            if not text and capture.by_button and is_counting:
                text = "nothing was recorded"
            text = text or ("stopped in the countdown" if is_counting else "stopped before the first frame")
            activity.set_message(PANEL, text)
            self.report({"INFO"}, text)
        if error is not None:
            common.failed(self, PANEL, error)
        activity.redraw_sidebars()
        return {"FINISHED"} if capture.run is not None and capture.run.poses else {"CANCELLED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender takes the operator down (its window is closed): keep what was captured."""
        if activity.current() is not self._capture:
            return  # loading a file and switching the add-on off have done so
        try:
            text = activity.finish(context)
        except PerfanimError as error:
            common.failed(self, PANEL, error)
            return
        activity.set_message(PANEL, text)
        if text and bpy.ops.ed.undo_push.poll():
            bpy.ops.ed.undo_push(message=self.bl_label)


class PERFANIM_OT_stop_capture(bpy.types.Operator):
    """End the capture; every recorded frame is kept in an Action"""

    bl_idname = "perfanim.stop_capture"
    bl_label = "Stop Capture"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while capturing."""
        if not isinstance(activity.current(), LiveCapture):
            cls.poll_message_set("Nothing is being captured")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Ask for the end; the capture's own timer finishes it."""
        capture = activity.current()
        if isinstance(capture, LiveCapture):
            capture.stop()
        return {"FINISHED"}


class PERFANIM_OT_record(bpy.types.Operator):
    """Begin a recording, after its countdown, or end the one that goes on; the capture goes on"""

    bl_idname = "perfanim.record"
    bl_label = "Record"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while capturing by button."""
        capture = activity.current()
        if not isinstance(capture, LiveCapture) or capture.run is None:
            cls.poll_message_set("Start the capture first")
            return False
        if not capture.by_button:
            cls.poll_message_set("The recording began with the capture; switch Record by Button on before")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Begin or end."""
        capture = activity.current()
        if isinstance(capture, LiveCapture):
            capture.record(settings(context))
        activity.redraw_sidebars()
        return {"FINISHED"}


_CLASSES = (PERFANIM_OT_start_capture, PERFANIM_OT_stop_capture, PERFANIM_OT_record)

register, unregister = bpy.utils.register_classes_factory(_CLASSES)
