"""What runs at the moment: at most one capture or one job, and the last message of each panel.

Nothing of Blender's data is kept here, only names and the timers, which are removed on every way out: the operator's
own end, loading a file, closing the window and switching the extension off.
"""

import contextlib
from dataclasses import dataclass, field
from typing import Any, Protocol

import bpy

from ...core.errors import PerfanimError
from ..viewport import camera_preview, overlay


class Activity(Protocol):
    """A capture or a job: owns a worker process."""

    def close(self) -> None:
        """End the worker process."""

    def keep(self, context: bpy.types.Context) -> str:
        """Write what is to be kept of it, once; return the line that says so, "" when there is nothing."""


@dataclass
class _State:
    activity: Activity | None = None
    timer: Any = None
    messages: dict[str, tuple[str, str]] = field(default_factory=dict)


_state = _State()


def current() -> Activity | None:
    """Return what runs, None when nothing does."""
    return _state.activity


def begin(context: bpy.types.Context, activity: Activity, interval_s: float) -> None:
    """Make `activity` the running one and add its timer to the context's window."""
    end()
    _state.activity = activity
    _state.timer = context.window_manager.event_timer_add(interval_s, window=context.window)


def end() -> None:
    """End whatever runs: remove the timer and what is drawn, close the worker. Safe to call at any time."""
    activity, timer = _state.activity, _state.timer
    _state.activity = _state.timer = None
    if timer is not None:
        bpy.context.window_manager.event_timer_remove(timer)
    if activity is not None:
        activity.close()
        camera_preview.hide()
        overlay.hide()
        redraw_sidebars()


def finish(context: bpy.types.Context) -> str:
    """End whatever runs and keep what it has, as `Activity.keep` does."""
    activity = _state.activity
    end()
    return activity.keep(context) if activity is not None else ""


def set_message(panel: str, text: str, icon: str = "INFO") -> None:
    """Keep what a panel's last operation said, with the icon that goes before it; "" clears it."""
    _state.messages[panel] = (text, icon)


def message(panel: str) -> tuple[str, str]:
    """Return what a panel's last operation said, and the icon that goes before it."""
    return _state.messages.get(panel, ("", "INFO"))


def redraw_sidebars() -> None:
    """Redraw the sidebars of all 3D viewports, not the viewports themselves."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()


@bpy.app.handlers.persistent
def _before_load(*_: object) -> None:
    # the recording is in the data should the file not load; should it load, this data is gone with all else
    with contextlib.suppress(PerfanimError):
        finish(bpy.context)


def register() -> None:
    """Add the handler that ends everything before another file is loaded."""
    _state.messages.clear()
    bpy.app.handlers.load_pre.append(_before_load)


def unregister() -> None:
    """End everything, keep what is recorded, and remove the handler."""
    with contextlib.suppress(PerfanimError):
        finish(bpy.context)
    bpy.app.handlers.load_pre.remove(_before_load)
