"""Operators for jobs in the worker process."""

from abc import abstractmethod
from pathlib import Path
from typing import Any

import bpy
from bpy_extras.io_utils import ImportHelper

from ...core.errors import PerfanimError
from ...core.worker.requests import Request
from ..capture.tuning import TUNING
from ..jobs import activity
from ..jobs.job import Job, command
from ..preferences import preferences
from ..preferences.property_kinds import HIDDEN
from ..viewport import picture_overlay
from .operator_bases import CheckedOperator, RunningOperator, defect, last_folders, need, report_error


class JobOperator(CheckedOperator):
    """Base of the operators that run a job in the worker.

    Subclasses set `title` and `panel`, and implement `arguments` or `request`, and `on_result`. A `finishable` job can
    end early with the result so far.
    """

    title = ""
    panel = ""
    finishable = False
    about: tuple[str, ...] = ()  # names of the objects and actions that the result speaks of

    @abstractmethod
    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the command line's arguments; PerfanimError if the settings are invalid."""

    def request(self, context: bpy.types.Context) -> Request:
        """Return the worker's request; PerfanimError if the settings are invalid."""
        return command(self.arguments(context))

    def create_job(self, context: bpy.types.Context, python: str | None) -> Job:
        """Start the job; `python` is the worker's interpreter, None for Blender's own."""
        return Job(self.title, self.panel, self.request(context), python, self.finishable)

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Use the job's summary; return the line to show."""
        return f"{self.title}: done"

    def execute(self, context: bpy.types.Context) -> set[str]:
        activity.set_message(self.panel, "")
        try:
            job = self.create_job(context, preferences.worker_python(context))
        except PerfanimError as error:
            return report_error(self, self.panel, error)
        self._job = job
        activity.begin(context, job, TUNING.job_tick_s)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
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
        except Exception as error:  # a bug must not leave timer and worker behind
            return self._fail(context, defect(error))
        left = f", {job.time_left}" if job.time_left else ""
        context.workspace.status_text_set(f"{job.title}: {job.fraction:.0%} {job.text}{left}")
        activity.redraw_sidebars()
        return {"PASS_THROUGH"}

    def _fail(self, context: bpy.types.Context, error: PerfanimError) -> set[str]:
        activity.end()
        context.workspace.status_text_set(None)
        return report_error(self, self.panel, error)

    def _finish(self, context: bpy.types.Context, text: str, ok: bool = False) -> set[str]:
        context.workspace.status_text_set(None)
        activity.set_message(self.panel, text, about=self.about)
        activity.redraw_sidebars()
        self.report({"INFO"}, text)
        return {"FINISHED"} if ok else {"CANCELLED"}

    def cancel(self, context: bpy.types.Context) -> None:
        if activity.current() is self._job:
            activity.end()


class FilesOperator(ImportHelper):
    """Base of operators for several chosen files."""

    filename_ext = ""
    files: bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options=HIDDEN)
    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        # Blender would keep the folder only of a job that succeeds
        self.filepath = last_folders.get(type(self).__name__, self.filepath)
        return set(ImportHelper.invoke(self, context, event))

    def chosen_files(self) -> list[str]:
        """Return the chosen files, or the folder if no file is chosen."""
        last_folders[type(self).__name__] = self.directory
        files = [str(Path(self.directory) / item.name) for item in self.files if item.name]
        return files or [self.filepath or self.directory]


class PERFANIM_OT_cancel_job(RunningOperator, bpy.types.Operator):
    """Cancel the running job; unfinished results are discarded"""

    bl_label = "Cancel"
    missing_input = need(lambda context: isinstance(activity.current(), Job), "No job is running")

    def execute(self, context: bpy.types.Context) -> set[str]:
        activity.end()
        return {"FINISHED"}


class PERFANIM_OT_finish_job(RunningOperator, bpy.types.Operator):
    """End the job now and use the result so far"""

    bl_label = "Finish Now"
    missing_input = need(
        lambda context: getattr(activity.current(), "finishable", False), "No job is running that can finish early"
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        activity.current().finish()
        return {"FINISHED"}
