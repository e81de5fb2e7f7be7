"""Operator that solves a batch of takes and shows the report."""

import os
from pathlib import Path
from typing import Any

import bpy

from ...core.errors import counted
from ..settings import batch_settings
from .database_operators import SolvingOperator


class PERFANIM_OT_run_batch(SolvingOperator, bpy.types.Operator):
    """Solve all unfinished takes of the folder or plan, several at a time"""

    bl_label = "Run Batch"
    title = "Batch"
    panel = "batch"

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        problem = batch_settings.problem(context.scene.perfanim_batch)
        return problem[:1].upper() + problem[1:]

    def uses_starter(self, context: bpy.types.Context) -> bool:
        """Return True unless a plan names its own database."""
        return not context.scene.perfanim_batch.plan

    def arguments(self, context: bpy.types.Context) -> list[str]:
        chosen = context.scene.perfanim_batch
        jobs = chosen.processes or max(1, (os.cpu_count() or 1) - 1)
        return ["batch", str(batch_settings.plan_file(context, chosen)), "--jobs", str(jobs)]

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        show_page(Path(summary["page"]))
        grades = ", ".join(f"{summary[status]} {status}" for status in ("good", "doubtful", "bad"))
        return f"{counted(len(summary['takes']), 'take')}: {grades}; see {summary['page']}"


def show_page(page: Path) -> None:
    """Open a page in the browser."""
    bpy.ops.wm.url_open(url=page.absolute().as_uri())
