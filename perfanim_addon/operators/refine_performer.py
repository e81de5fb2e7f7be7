"""Operators of the performer refined by a take: refine, use, refuse."""

from pathlib import Path
from typing import Any

import bpy

from ...core.errors import SubjectError, TakeError
from ...core.formats.take_file.take_reader import summarise
from ...core.markers.subject import Subject, load_subject, save_subject
from ..jobs import activity
from ..panels import takes_panel
from ..preferences.paths import absolute
from ..settings import performer_refinement, readiness
from ..settings.capture_settings import settings
from .database_operators import SolvingOperator
from .operator_bases import PanelOperator, UndoOperator
from .put_on_character import TakeOperator
from .subject_operators import profile_path

_FITS = "fits this take: nothing to change"


class PERFANIM_OT_refine_performer(TakeOperator, SolvingOperator, bpy.types.Operator):
    """Find by the take's motion where bones and markers of its performer are off.
    Nothing changes until Use is clicked"""

    bl_label = "Refine Performer"
    title = "Refining the performer"

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        return readiness.motion(settings(context)).problem

    def arguments(self, context: bpy.types.Context) -> list[str]:
        known = summarise(self.path)
        if not known.complete:
            raise TakeError("was cut off", where=known.notes.name, advice="click Recover Take")
        if not known.performers:
            raise TakeError("has no performer yet", where=known.notes.name, advice="click Solve Again")
        # the worker's file is read at once; Blender removes this folder at its end
        self._result = Path(bpy.app.tempdir) / f"refined{performer_refinement.ENDING}"
        database = str(readiness.database_path(settings(context)))
        return performer_refinement.command_line(self.path, database, self._result)

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Offer the refined performer, or say that the body fits."""
        subject, was_capture = load_subject(self._result), performer_refinement.captured() == self.path
        self._result.unlink()
        changes = summary["changes"]
        if changes:
            performer_refinement.keep_refined(self.path, subject, changes)
            return ""
        performer_refinement.close()
        text = f"{subject.name} {_FITS}"
        if was_capture:
            activity.set_message("capture", text)
        return text


class _AnsweringOperator(PanelOperator):
    """Base of the answers to a refined performer."""

    panel = takes_panel.KEY

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        return "" if performer_refinement.refined() else "Click Refine Performer first"


class PERFANIM_OT_use_refined_performer(_AnsweringOperator, UndoOperator, bpy.types.Operator):
    """Save the refined performer as a new file beside the old one, and use it"""

    bl_label = "Use Refined Performer"

    def run(self, context: bpy.types.Context) -> str:
        """Write the new file and choose it."""
        found, chosen = performer_refinement.refined(), settings(context)
        if found is None:
            raise SubjectError("no performer is refined", advice="click Refine Performer first")
        target = performer_refinement.path_beside(_file_of(found.subject, chosen))
        save_subject(found.subject, target)
        chosen.subject = str(target)
        performer_refinement.close()
        return f"{target.name} is used from now on; Solve Again with the performer As Chosen improves earlier takes"


class PERFANIM_OT_refuse_refined_performer(_AnsweringOperator, bpy.types.Operator):
    """Forget the refined performer; the present one stays in use"""

    bl_label = "Keep Present Performer"

    def run(self, context: bpy.types.Context) -> str:
        performer_refinement.close()
        return ""


def _file_of(subject: Subject, chosen: Any) -> Path:
    """Return the chosen file if it is this performer's, else where it would be saved."""
    path = absolute(chosen.subject)
    known = readiness.subject(path) if path else None
    is_same = isinstance(known, Subject) and known.name == subject.name
    return Path(path) if is_same else profile_path(subject.name)
