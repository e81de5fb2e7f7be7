"""Operators that refine the performer with a take: refine, use, discard."""

from pathlib import Path
from typing import Any

import bpy

from ...core.errors import SubjectError, TakeError
from ...core.formats.take_file.take_reader import summarise
from ...core.markers.subject import load_subject, save_subject
from ..jobs import activity
from ..panels import takes_panel
from ..preferences.paths import absolute
from ..settings import performer_refinement, readiness
from ..settings.capture_settings import settings
from ..settings.performer_refinement import Refined, offer
from .database_operators import SolvingOperator
from .operator_bases import PanelOperator, UndoOperator, need
from .put_on_character import TakeOperator
from .subject_operators import profile_path


class PERFANIM_OT_refine_performer(TakeOperator, SolvingOperator, bpy.types.Operator):
    """Use the take's motion to find where the performer's bones and markers are off.
    Nothing changes until Use is clicked"""

    bl_label = "Refine Performer"
    title = "Refining the performer"
    missing_input = staticmethod(lambda context: readiness.motion(settings(context)).problem)

    def arguments(self, context: bpy.types.Context) -> list[str]:
        known = summarise(self.path)
        if not known.complete:
            raise TakeError("was cut off", where=known.notes.name, advice="click Recover Take")
        if not known.performers:
            raise TakeError("has no performer yet", where=known.notes.name, advice="click Solve Again")
        self._result = Path(bpy.app.tempdir) / f"refined{performer_refinement.ENDING}"
        database = str(readiness.database_path(settings(context)))
        return performer_refinement.command_line(self.path, database, self._result)

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        subject, was_capture = load_subject(self._result), offer.capture == self.path
        self._result.unlink()
        if summary["changes"]:
            offer.refined = Refined(self.path, subject, tuple(summary["changes"]))
            return ""
        offer.close()
        text = f"{subject.name} fits this take: nothing to change"
        if was_capture:
            activity.set_message("capture", text)
        return text


class _AnsweringOperator(PanelOperator):
    """Base of the operators that answer the offer of a refined performer."""

    panel = takes_panel.KEY
    missing_input = need(lambda context: offer.refined, "Click Refine Performer first")


class PERFANIM_OT_use_refined_performer(_AnsweringOperator, UndoOperator, bpy.types.Operator):
    """Save the refined performer as a new file beside the old one, and use it"""

    bl_label = "Use Refined Performer"

    def run(self, context: bpy.types.Context) -> str:
        found, chosen = offer.refined, settings(context)
        if found is None:
            raise SubjectError("there is no refined performer", advice="click Refine Performer first")
        path = absolute(chosen.subject)
        known = readiness.found(readiness.subject, path) if path else None
        is_same = known is not None and known.name == found.subject.name
        old = Path(path) if is_same else profile_path(found.subject.name)
        target = performer_refinement.path_beside(old)
        save_subject(found.subject, target)
        chosen.subject = str(target)
        offer.close()
        return f"{target.name} is used from now on; Solve Again with Performer set to As Chosen improves earlier takes"


class PERFANIM_OT_refuse_refined_performer(_AnsweringOperator, bpy.types.Operator):
    """Discard the refined performer and keep the current one"""

    bl_label = "Keep Current Performer"

    def run(self, context: bpy.types.Context) -> None:
        offer.close()
