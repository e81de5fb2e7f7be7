"""Base classes of the operators: preconditions and error reports."""

import traceback
from abc import abstractmethod

import bpy

from ...core.errors import CaptureError, PerfanimError
from ..jobs import activity


class CheckedOperator:
    """Base of operators with preconditions; the disabled button shows the missing one.

    Subclasses relax `needs_scene` or `needs_idle`, and name what else is missing in `missing_input`.
    """

    needs_scene = True
    needs_idle = True
    bl_idname = ""

    def __init_subclass__(cls) -> None:
        """Name the operator after its class: PERFANIM_OT_find_bones, perfanim.find_bones."""
        super().__init_subclass__()
        cls.bl_idname = cls.__name__.replace("PERFANIM_OT_", "perfanim.")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return True if nothing is missing; else explain it in the tooltip."""
        missing = _scene_problem(context) if cls.needs_scene else ""
        if not missing and cls.needs_idle and activity.current() is not None:
            missing = "Perfanim is busy: wait until it has finished, or stop it"
        missing = missing or cls.missing_input(context)
        if missing:
            cls.poll_message_set(missing)
        return not missing

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        """Return the step that must come first, "" for none."""
        return ""


class RunningOperator(CheckedOperator):
    """Base of the operators on running work."""

    needs_scene = needs_idle = False


class DialogOperator:
    """Base of operators that ask for their properties first."""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return set(context.window_manager.invoke_props_dialog(self))


class PanelOperator(CheckedOperator):
    """Base of operators that act at once; the panel shows their result or error.

    Subclasses set `panel` and implement `run`, which returns the line for the panel and may raise PerfanimError; ""
    clears the line, None leaves it.
    """

    panel = ""

    @abstractmethod
    def run(self, context: bpy.types.Context) -> str | None:
        """Do the work and return the line to show."""

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            text = self.run(context)
        except PerfanimError as error:
            return report_error(self, self.panel, error)
        if text is not None:
            activity.set_message(self.panel, text)
        if text:
            self.report({"INFO"}, text)
        return {"FINISHED"}


class UndoOperator(PanelOperator):
    """Base of those that Undo takes back."""

    bl_options = {"REGISTER", "UNDO"}


def _scene_problem(context: bpy.types.Context) -> str:
    if context.window is None or context.scene is None:
        return "Needs a window with a scene"
    return "" if context.scene.is_editable else "The scene is linked from another file and cannot be edited"


def defect(error: Exception) -> PerfanimError:
    """Print where an unexpected error arose; return it for the panel."""
    traceback.print_exc()
    return CaptureError(f"{type(error).__name__}: {error}", advice="see the console, and report this")


def report_error(operator: bpy.types.Operator, panel: str, error: PerfanimError) -> set[str]:
    """Report an error, show it in the panel, and cancel."""
    text = str(error)
    activity.set_message(panel, text, "ERROR")
    operator.report({"ERROR"}, text)
    return {"CANCELLED"}
