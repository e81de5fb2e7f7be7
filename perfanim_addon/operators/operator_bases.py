"""Base classes of the operators: preconditions and error reports."""

import traceback
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import bpy

from ...core.errors import CaptureError, PerfanimError
from ..jobs import activity
from ..panels.panel_drawing import wrapped

_POP_UP_CHARACTERS = 80  # in a line of the pop-up that shows an error
last_folders: dict[str, str] = {}  # operator -> folder chosen last


def need(is_met: Callable[[bpy.types.Context], object], text: str) -> Any:
    """Return a `missing_input` with one condition; the text says what is missing."""
    return staticmethod(lambda context: "" if is_met(context) else text)


class CheckedOperator:
    """Base of operators with preconditions; the disabled button shows the first unmet one."""

    needs_scene = True
    needs_idle = True
    bl_idname = ""

    def __init_subclass__(cls) -> None:
        """Derive the operator's name from its class: PERFANIM_OT_find_bones becomes perfanim.find_bones."""
        super().__init_subclass__()
        cls.bl_idname = cls.__name__.replace("PERFANIM_OT_", "perfanim.")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        missing = ""
        if cls.needs_scene and (context.window is None or context.scene is None):
            missing = "Needs a window with a scene"
        elif cls.needs_scene and not context.scene.is_editable:
            missing = "The scene is linked from another file and cannot be edited"
        elif cls.needs_idle and activity.current() is not None:
            missing = "Perfanim is busy: wait until it has finished, or stop it"
        missing = missing or cls.missing_input(context)
        if missing:
            cls.poll_message_set(missing)
        return not missing

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        """Return the step that must come first, or ""."""
        return ""


class RunningOperator(CheckedOperator):
    """Base of operators that act on running work."""

    needs_scene = needs_idle = False


class DialogOperator:
    """Base of operators that ask for their properties first."""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return set(context.window_manager.invoke_props_dialog(self))


class PanelOperator(CheckedOperator):
    """Base of operators that `run` at once; the `panel` shows their result or error."""

    panel = ""
    about: tuple[str, ...] = ()  # names of the objects and actions that the result speaks of

    @abstractmethod
    def run(self, context: bpy.types.Context) -> str | None:
        """Do the work and return the line to show, if any; PerfanimError for bad input."""

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            text = self.run(context) or ""
        except PerfanimError as error:
            return report_error(self, self.panel, error)
        activity.set_message(self.panel, text, about=self.about)
        if text:
            self.report({"INFO"}, text)
        return {"FINISHED"}


class UndoOperator(PanelOperator):
    """Base of operators with undo."""

    bl_options = {"REGISTER", "UNDO"}


def defect(error: Exception) -> PerfanimError:
    """Print the traceback of an unexpected exception; return an error for the panel."""
    traceback.print_exc()
    return CaptureError(f"{type(error).__name__}: {error}", advice="report this, with the text in the system console")


def report_error(operator: bpy.types.Operator, panel: str, error: PerfanimError) -> set[str]:
    """Report an error, show it in the panel, and cancel."""
    text = str(error)
    activity.set_message(panel, text, "ERROR")
    operator.report({"ERROR"}, " \n".join(wrapped(text, _POP_UP_CHARACTERS)))  # Blender cuts lines that are too wide
    return {"CANCELLED"}
