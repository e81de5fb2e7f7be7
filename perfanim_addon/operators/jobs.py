"""Long work in the worker process, with progress and without freezing the window."""

import traceback
from typing import Any

import bpy

from ...core.errors import CaptureError, PerfanimError
from ..jobs import activity
from ..jobs.job import Job, command
from ..preferences import preferences
from ..viewport import camera_preview
from . import common

TICK_S = 0.1


class JobOperator:
    """Base of the operators that let the worker do something.

    Subclasses say what with `title`, `panel`, `arguments` of a command or else `request` (both raise PerfanimError for
    bad settings) and take the result in `done`, which returns the line to show; `lacks` says what must be chosen
    before. A job that is `finishable` may be asked to end early with what it has.
    """

    title = ""
    panel = ""
    finishable = False

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only one thing at a time, and only with what it needs."""
        if not (common.in_scene(cls, context) and common.idle(cls)):
            return False
        missing = cls.lacks(context)
        if missing:
            cls.poll_message_set(missing)
        return not missing

    @classmethod
    def lacks(cls, context: bpy.types.Context) -> str:
        """Return what is to be done before, as the greyed button says it; "" when nothing is."""
        return ""

    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the command line's arguments."""
        raise CaptureError(f"{type(self).__name__} does not say what to run")

    def request(self, context: bpy.types.Context) -> dict[str, Any]:
        """Return what the worker is asked for."""
        return command(self.arguments(context))

    def begin(self, context: bpy.types.Context, python: str | None) -> Job:
        """Start the work in a worker that `python` runs, None for Blender's own."""
        return Job(self.title, self.panel, self.request(context), python, self.finishable)

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Use the summary; return the line to show."""
        return f"{self.title}: done"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the worker and go on by the timer."""
        activity.set_message(self.panel, "")
        try:
            job = self.begin(context, preferences.worker_python(context))
        except PerfanimError as error:
            return common.failed(self, self.panel, error)
        self._job = job
        activity.begin(context, job, TICK_S)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Poll the worker at each tick."""
        job = self._job
        if activity.current() is not job:
            return self._finish(context, "stopped")
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            job.tick()
            if job.ended:
                activity.end()
                if job.summary is None:
                    return self._finish(context, "stopped")
                return self._finish(context, self.done(context, job.summary), ok=True)
            picture = job.take_preview()
            if picture is not None:
                camera_preview.show(picture, job.text)
        except PerfanimError as error:
            activity.end()
            context.workspace.status_text_set(None)
            return common.failed(self, self.panel, error)
        except Exception as error:
            # A defect must not leave timer and worker behind.
            traceback.print_exc()
            activity.end()
            context.workspace.status_text_set(None)
            text = f"{type(error).__name__}: {error}"
            return common.failed(self, self.panel, CaptureError(text, advice="see the console, and report this"))
        context.workspace.status_text_set(f"{job.title}: {job.fraction:.0%} {job.text}")
        activity.redraw_sidebars()
        return {"PASS_THROUGH"}

    def _finish(self, context: bpy.types.Context, text: str, ok: bool = False) -> set[str]:
        context.workspace.status_text_set(None)
        activity.set_message(self.panel, text)
        activity.redraw_sidebars()
        self.report({"INFO"}, text)
        return {"FINISHED"} if ok else {"CANCELLED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender takes the operator down (the window is closed, the add-on switched off)."""
        if activity.current() is self._job:
            activity.end()


class PERFANIM_OT_cancel_job(bpy.types.Operator):
    """Stop the work that is running; nothing half done is left"""

    bl_idname = "perfanim.cancel_job"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while a job runs."""
        if not isinstance(activity.current(), Job):
            cls.poll_message_set("Nothing is running")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """End it."""
        activity.end()
        return {"FINISHED"}


class PERFANIM_OT_finish_job(bpy.types.Operator):
    """End the work now, with what it has so far"""

    bl_idname = "perfanim.finish_job"
    bl_label = "Finish Now"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while a job runs that can end early."""
        job = activity.current()
        if not (isinstance(job, Job) and job.finishable):
            cls.poll_message_set("Nothing is running that can be finished early")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Ask for the end; the job's own timer takes the result."""
        job = activity.current()
        if isinstance(job, Job):
            job.finish()
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((PERFANIM_OT_cancel_job, PERFANIM_OT_finish_job))
