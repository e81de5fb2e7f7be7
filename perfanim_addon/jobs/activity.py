"""The running capture or job (at most one) and the last message of each panel.

No Blender data is held except the timer, which is removed at the end of the operator, when a file is loaded, when the
window is closed, or when the extension is disabled.
"""

import contextlib
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Protocol

import bpy

from ...core.errors import PerfanimError
from ..viewport import overlay, picture_overlay


class Activity(Protocol):
    """A capture or a job, with its worker process."""

    def close(self) -> None:
        """End the worker process."""

    def keep(self, context: bpy.types.Context) -> str:
        """Write the result once; return the line to show, or "" if there is no result."""


@dataclass(frozen=True)
class Told:
    """Message of a panel; it goes with the last of what it speaks of.

    Args:
        about: Names of the objects and actions that the message speaks of; none if it speaks of none.
    """

    text: str
    icon: str
    about: tuple[str, ...] = ()

    @property
    def stands(self) -> bool:
        """Whether something of what the message speaks of is still there."""
        objects = (bpy.data.objects.get(name) for name in self.about)
        there = any(obj is not None and bool(obj.users_scene) for obj in objects)
        return not self.about or there or any(name in bpy.data.actions for name in self.about)


@dataclass
class _State:
    activity: Activity | None = None
    timer: Any = None
    messages: dict[str, "Told"] = field(default_factory=dict)


_state = _State()


def current() -> Activity | None:
    """Return the running activity, or None."""
    return _state.activity


def begin(context: bpy.types.Context, activity: Activity, interval_s: float) -> None:
    """Run an activity, with a timer in the context's window."""
    end()
    _state.activity = activity
    _state.timer = context.window_manager.event_timer_add(interval_s, window=context.window)


def end() -> None:
    """End the activity: remove timer and overlays, and close the worker. Safe to call at any time."""
    activity, timer = _state.activity, _state.timer
    _state.activity = _state.timer = None
    if timer is not None:
        bpy.context.window_manager.event_timer_remove(timer)
    picture_overlay.hide()
    if activity is not None:
        activity.close()
    overlay.hide()
    if activity is not None:
        for workspace in bpy.data.workspaces:
            workspace.status_text_set(None)
        redraw_sidebars()


def finish(context: bpy.types.Context) -> str:
    """End the activity and keep its result, as `Activity.keep` does."""
    activity = _state.activity
    end()
    return activity.keep(context) if activity is not None else ""


def set_message(panel: str, text: str, icon: str = "INFO", about: Iterable[str] = ()) -> None:
    """Set the message of a panel, about objects or actions with these names; "" clears it."""
    _state.messages[panel] = Told(text, icon, tuple(about))


def message(panel: str) -> tuple[str, str]:
    """Return the message of a panel and its icon."""
    told = _state.messages.get(panel)
    return (told.text, told.icon) if told is not None and told.stands else ("", "INFO")


def messages() -> tuple[tuple[str, str], ...]:
    """Return the message of each panel that has one, and its icon."""
    return tuple(map(message, _state.messages))


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
    # if loading fails, the current data stays, now with the recording
    with contextlib.suppress(PerfanimError):
        finish(bpy.context)


@bpy.app.handlers.persistent
def _forget_messages(*_: object) -> None:
    """Forget messages about another file, or about what has been undone."""
    _state.messages.clear()


def register() -> None:
    """Add the handlers: they end the activity before another file is loaded, and forget messages about the past."""
    _state.messages.clear()
    bpy.app.handlers.load_pre.append(_before_load)
    for handlers in (bpy.app.handlers.load_post, bpy.app.handlers.undo_post):
        handlers.append(_forget_messages)


def unregister() -> None:
    """End the activity, keep its result, and remove the handler."""
    with contextlib.suppress(PerfanimError):
        finish(bpy.context)
    bpy.app.handlers.load_pre.remove(_before_load)
    for handlers in (bpy.app.handlers.load_post, bpy.app.handlers.undo_post):
        handlers.remove(_forget_messages)
