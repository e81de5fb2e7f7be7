"""Operators for a performer away from the desk: a screen of their own, and a key that starts and stops."""

import bpy

from ..capture.live_capture import running_capture
from ..capture.performer_view import performer_view
from ..capture.tuning import TUNING
from ..settings.capture_settings import chosen_gesture, settings
from ..viewport import performer_screen
from .operator_bases import CheckedOperator, RunningOperator, need


def _refresh() -> float | None:
    """Show what the performer reads now; called by a timer until the window is closed."""
    if performer_screen.window() is None:
        performer_screen.close()
        return None
    performer_screen.show(performer_view(chosen_gesture(settings(bpy.context))))
    return TUNING.job_tick_s


class PERFANIM_OT_performer_screen(RunningOperator, bpy.types.Operator):
    """Open or close a window for the performer, readable from three metres: camera pictures, the pose to take,
    the countdown, the time recorded, and markers that are lost"""

    bl_label = "Performer's Screen"
    missing_input = need(lambda _context: not bpy.app.background, "Needs a window")

    def execute(self, context: bpy.types.Context) -> set[str]:
        if performer_screen.window() is not None:
            performer_screen.close()
        else:
            performer_screen.open_window()
            if not bpy.app.timers.is_registered(_refresh):
                bpy.app.timers.register(_refresh)
        return {"FINISHED"}


class PERFANIM_OT_start_or_stop(CheckedOperator, bpy.types.Operator):
    """Start the capture or stop it; with Record by Button, start or stop a recording"""

    bl_label = "Start or Stop"
    needs_idle = False

    def execute(self, context: bpy.types.Context) -> set[str]:
        capture = running_capture()
        if capture is not None:
            capture.signal(settings(context))
            return {"FINISHED"}
        if not bpy.ops.perfanim.start_capture.poll():
            self.report({"WARNING"}, "The capture is not ready: look at the Capture panel")
            return {"CANCELLED"}
        return set(bpy.ops.perfanim.start_capture("INVOKE_DEFAULT"))


@bpy.app.handlers.persistent
def _forget_window(*_: object) -> None:
    performer_screen.forget()


_keys: list[tuple[bpy.types.KeyMap, bpy.types.KeyMapItem]] = []


def register() -> None:
    """Add the key, which can be changed in Blender's preferences, and forget the window with its file."""
    bpy.app.handlers.load_pre.append(_forget_window)
    configuration = bpy.context.window_manager.keyconfigs.addon
    if configuration is None:  # Blender runs without a window
        return
    keymap = configuration.keymaps.new("Window")
    key = keymap.keymap_items.new(PERFANIM_OT_start_or_stop.bl_idname, "R", "PRESS", ctrl=True, shift=True)
    _keys.append((keymap, key))


def unregister() -> None:
    """Remove the key, the timer, the handler and the window."""
    bpy.app.handlers.load_pre.remove(_forget_window)
    while _keys:
        keymap, key = _keys.pop()
        keymap.keymap_items.remove(key)
    if bpy.app.timers.is_registered(_refresh):
        bpy.app.timers.unregister(_refresh)
    performer_screen.close()
