"""Alignment of the panels when one of them grows by itself.

Blender moves the panels below a growing one only after drawing it, so the growing panel covers the next heading for a
moment. When a panel appears or disappears, Blender aligns all panels before it draws them. Therefore two empty panels
alternate.
"""

from dataclasses import dataclass

import bpy

from ..capture.live_capture import further_performers, running_capture
from ..jobs import activity
from ..preferences.sidebar_tab import SidebarPanel
from ..settings.performer_refinement import offer

_Content = tuple[object, ...]


@dataclass
class _Drawn:
    """Last content of a sidebar, and the number of its current empty panel."""

    content: _Content = ()
    number: int = 0


_sidebars: dict[int, _Drawn] = {}


def content() -> _Content:
    """Return everything that makes panels grow without an action by the user."""
    capture = running_capture()
    if capture is None or capture.run is None:
        shown = bpy.context.window_manager.perfanim_takes  # filled after it was drawn
        return type(activity.current()), activity.messages(), len(shown.entries), shown.active
    run, changes = capture.run, offer.refined.changes if offer.refined is not None else ()
    return run.statistics.waiting > 1, len(further_performers(capture)), run.notices, changes


class _Empty(SidebarPanel):
    """Panel without a height; always one of the two is present."""

    bl_label = ""
    bl_options = {"HIDE_HEADER"}
    number: int

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.region is None:
            return False
        drawn = _sidebars.setdefault(context.region.as_pointer(), _Drawn())
        if (now := content()) != drawn.content:
            drawn.content, drawn.number = now, 1 - drawn.number
        return drawn.number == cls.number

    def draw(self, context: bpy.types.Context) -> None:
        """Draw nothing."""


class PERFANIM_PT_alignment(_Empty, bpy.types.Panel):
    """Empty panel that alternates with the next one."""

    number = 0


class PERFANIM_PT_alignment_next(_Empty, bpy.types.Panel):
    """Empty panel that alternates with the one above."""

    number = 1


def unregister() -> None:
    """Forget the sidebars."""
    _sidebars.clear()
