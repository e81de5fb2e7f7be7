"""Long work in the worker process, with progress and without freezing the window."""

from collections.abc import Sequence
from typing import Any

import bpy

from ...core.errors import CaptureError, PerfanimError
from ...core.worker.client import WorkerClient
from ...core.worker.protocol import Message, MessageKind
from .. import preferences, running
from . import common

TICK_S = 0.1


class Job:
    """A command of the command line, running in a worker process.

    Args:
        title: what is being done, for the panel.
        panel: whose line shows the result.
        arguments: of the `perfanim` command.
        python: interpreter of the worker, None for Blender's own.
    """

    def __init__(self, title: str, panel: str, arguments: Sequence[str], python: str | None) -> None:
        self.title = title
        self.panel = panel
        self.text = "starting"
        self.fraction = 0.0
        self.summary: dict[str, Any] | None = None
        self._client = WorkerClient({"job": "command", "arguments": list(arguments)}, python)

    @property
    def ended(self) -> bool:
        """Whether the worker is done."""
        return self._client.ended

    def tick(self) -> None:
        """Take what the worker has sent; raises the PerfanimError that ended the work."""
        for message in self._client.poll():
            self._take(message)

    def _take(self, message: Message) -> None:
        content = message.json() if message.kind is not MessageKind.FRAME else {}
        if message.kind is MessageKind.STATUS:
            self.text = str(content.get("activity", self.text))
            fraction = content.get("fraction")
            self.fraction = float(fraction) if isinstance(fraction, int | float) else self.fraction
        elif message.kind is MessageKind.RESULT:
            self.summary = content
        elif message.kind is MessageKind.ERROR:
            raise CaptureError(
                str(content.get("what")), where=str(content.get("where")), advice=str(content.get("advice"))
            )

    def close(self) -> None:
        """End the worker."""
        self._client.close()


class JobOperator:
    """Base of the operators that run a command in the worker.

    Subclasses say what with `title`, `panel`, `arguments` (raises PerfanimError for bad settings) and take the
    result in `done`, which returns the line to show.
    """

    title = ""
    panel = ""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only one thing at a time."""
        return common.in_scene(cls, context) and common.idle(cls)

    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the command line's arguments."""
        raise CaptureError(f"{type(self).__name__} does not say what to run")

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Use the summary; return the line to show."""
        return f"{self.title}: done"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the worker and go on by the timer."""
        running.set_message(self.panel, "")
        try:
            arguments = self.arguments(context)
            job = Job(self.title, self.panel, arguments, preferences.worker_python(context))
        except PerfanimError as error:
            return common.failed(self, self.panel, error)
        self._job = job
        running.begin(context, job, TICK_S)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Poll the worker at each tick."""
        job = self._job
        if running.current() is not job:
            return self._finish(context, "stopped")
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            job.tick()
            if job.ended:
                running.end()
                return self._finish(context, self.done(context, job.summary or {}), ok=job.summary is not None)
        except PerfanimError as error:
            running.end()
            context.workspace.status_text_set(None)
            return common.failed(self, self.panel, error)
        context.workspace.status_text_set(f"{job.title}: {job.fraction:.0%} {job.text}")
        running.redraw_sidebars()
        return {"PASS_THROUGH"}

    def _finish(self, context: bpy.types.Context, text: str, ok: bool = False) -> set[str]:
        context.workspace.status_text_set(None)
        running.set_message(self.panel, text)
        running.redraw_sidebars()
        self.report({"INFO"}, text)
        return {"FINISHED"} if ok else {"CANCELLED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender takes the operator down (the window is closed, the add-on switched off)."""
        if running.current() is self._job:
            running.end()


class PERFANIM_OT_cancel_job(bpy.types.Operator):
    """Stop the work that is running; nothing half done is left"""

    bl_idname = "perfanim.cancel_job"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while a job runs."""
        if not isinstance(running.current(), Job):
            cls.poll_message_set("Nothing is running")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """End it."""
        running.end()
        return {"FINISHED"}


def register() -> None:
    """Register the operator."""
    bpy.utils.register_class(PERFANIM_OT_cancel_job)


def unregister() -> None:
    """Undo `register`."""
    bpy.utils.unregister_class(PERFANIM_OT_cancel_job)
