"""Operators of jobs in the worker process."""

from abc import abstractmethod
from typing import Any

import bpy

from ...core.errors import PerfanimError
from ...core.worker.requests import Request
from ..jobs import activity
from ..jobs.job import Job, command
from ..preferences import preferences
from ..viewport import picture_overlay
from .operator_bases import CheckedOperator, RunningOperator, defect, report_error

TICK_S = 0.1


class JobOperator(CheckedOperator):
    """Base of the operators that run a job in the worker.

    Subclasses set `title` and `panel`, give the `arguments` of a command or else a `request` (both raise PerfanimError
    for bad settings), and use the result in `on_result`, which returns the line to show. A `finishable` job can be
    asked to end early with the result so far.
    """

    title = ""
    panel = ""
    finishable = False

    @abstractmethod
    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the command line's arguments."""

    def request(self, context: bpy.types.Context) -> Request:
        """Return the request for the worker."""
        return command(self.arguments(context))

    def create_job(self, context: bpy.types.Context, python: str | None) -> Job:
        """Start the job in a worker run by `python`, None for Blender's own."""
        return Job(self.title, self.panel, self.request(context), python, self.finishable)

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Use the job's summary; return the line to show."""
        return f"{self.title}: done"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the job; the timer continues it."""
        activity.set_message(self.panel, "")
        try:
            job = self.create_job(context, preferences.worker_python(context))
        except PerfanimError as error:
            return report_error(self, self.panel, error)
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
                return self._finish(context, self.on_result(context, job.summary), ok=True)
            picture = job.take_preview()
            if picture is not None:
                picture_overlay.show(picture, job.text)
        except PerfanimError as error:
            return self._fail(context, error)
        except Exception as error:  # a defect must not leave timer and worker behind
            return self._fail(context, defect(error))
        context.workspace.status_text_set(f"{job.title}: {job.fraction:.0%} {job.text}")
        activity.redraw_sidebars()
        return {"PASS_THROUGH"}

    def _fail(self, context: bpy.types.Context, error: PerfanimError) -> set[str]:
        activity.end()
        context.workspace.status_text_set(None)
        return report_error(self, self.panel, error)

    def _finish(self, context: bpy.types.Context, text: str, ok: bool = False) -> set[str]:
        context.workspace.status_text_set(None)
        activity.set_message(self.panel, text)
        activity.redraw_sidebars()
        self.report({"INFO"}, text)
        return {"FINISHED"} if ok else {"CANCELLED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """End the job: the window is closing or the add-on is being disabled."""
        if activity.current() is self._job:
            activity.end()


class PERFANIM_OT_cancel_job(RunningOperator, bpy.types.Operator):
    """Cancel the running job; unfinished results are discarded"""

    bl_label = "Cancel"

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        return "" if isinstance(activity.current(), Job) else "No job is running"

    def execute(self, context: bpy.types.Context) -> set[str]:
        activity.end()
        return {"FINISHED"}


class PERFANIM_OT_finish_job(RunningOperator, bpy.types.Operator):
    """End the job now and use the result so far"""

    bl_label = "Finish Now"

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        job = activity.current()
        return "" if isinstance(job, Job) and job.finishable else "No job is running that can finish early"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Ask the worker to end; the job's timer takes the result."""
        activity.current().finish()
        return {"FINISHED"}
