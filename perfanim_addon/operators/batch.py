"""A batch of takes in the worker, and its page."""

import os
from pathlib import Path
from typing import Any

import bpy

from ..jobs.job import Job, command
from ..settings import batch_settings, readiness
from ..settings.capture_settings import settings
from .database import starter_arguments
from .jobs import JobOperator

PANEL = "batch"


class PERFANIM_OT_run_batch(JobOperator, bpy.types.Operator):
    """Solve all takes of the folder or plan, several at a time; what is done already is left alone"""

    bl_idname = "perfanim.run_batch"
    bl_label = "Run Batch"
    title = "Batch"
    panel = PANEL

    @classmethod
    def lacks(cls, context: bpy.types.Context) -> str:
        """Needs takes and a folder for the results."""
        problem = batch_settings.problem(context.scene.perfanim_batch)
        return problem[:1].upper() + problem[1:]

    def begin(self, context: bpy.types.Context, python: str | None) -> Job:
        """Start the work, after the starter database where that is needed and missing."""
        needs_starter = not context.scene.perfanim_batch.plan and not settings(context).database
        first = None
        request = self.request(context)
        if needs_starter and not readiness.starter_database_path().exists():
            first = Job("Making the starter database", PANEL, command(starter_arguments()), python)
        return Job(self.title, PANEL, request, python, first=first)

    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the command."""
        chosen = context.scene.perfanim_batch
        jobs = chosen.processes or max(1, (os.cpu_count() or 1) - 1)
        return ["batch", str(batch_settings.plan_file(context, chosen)), "--jobs", str(jobs)]

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Open the page with all takes."""
        show_page(Path(summary["page"]))
        counted = ", ".join(f"{summary[status]} {status}" for status in ("good", "doubtful", "bad"))
        return f"{len(summary['takes'])} takes: {counted}; see {summary['page']}"


def show_page(page: Path) -> None:
    """Open a page in the browser."""
    bpy.ops.wm.url_open(url=page.absolute().as_uri())


register, unregister = bpy.utils.register_classes_factory((PERFANIM_OT_run_batch,))
