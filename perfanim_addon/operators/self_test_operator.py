"""Operator of the self-test."""

from typing import Any

import bpy

from ..capture.self_test_run import PANEL, SelfTest
from ..jobs import activity
from ..jobs.job import Job
from ..preferences import diagnostics
from ..settings import readiness
from ..viewport import viewport_drawing
from .database_operators import starter_job
from .job_operators import JobOperator


class PERFANIM_OT_self_test(JobOperator, bpy.types.Operator):
    """Check libraries and cameras, and capture the simulated performer for a second"""

    bl_label = "Self-Test"
    panel = PANEL

    def create_job(self, context: bpy.types.Context, python: str | None) -> Job:
        database = readiness.starter_database_path()
        self._test = SelfTest(str(database), None if database.exists() else starter_job(PANEL, python), python)
        return self._test

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        result = super().modal(context, event)
        if event.type == "TIMER" or "PASS_THROUGH" not in result:
            state = activity.message(PANEL)[0] or f"{self._test.text} ..."
            diagnostics.tested[:] = [*self._test.lines, f"Self-test: {state}"]
            viewport_drawing.redraw("PREFERENCES")
        return result

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        return "everything works" if summary["cameras"] else "everything works, but there is no camera yet"


register = diagnostics.tested.clear
