"""Alignment of the panels at the moment when one of them grows by itself.

Blender moves the panels below one that grows only after it was drawn, so it lies over the next heading for a picture
or more. Where a panel comes or goes, all are aligned before they are drawn: so two empty panels take turns.
"""

from dataclasses import dataclass

import bpy

from ..capture.live_capture import LiveCapture, further_performers
from ..jobs import activity
from ..preferences.sidebar_tab import SidebarPanel
from ..settings import performer_refinement

_Content = tuple[object, ...]


@dataclass
class _Drawn:
    """Last content of a sidebar, and number of its empty panel."""

    content: _Content = ()
    number: int = 0


_sidebars: dict[int, _Drawn] = {}


def content() -> _Content:
    """Return everything that makes panels grow without the user's doing."""
    running = activity.current()
    run = running.run if isinstance(running, LiveCapture) else None
    if run is None:
        return type(running), activity.messages()
    refined = performer_refinement.refined()
    changes = refined.changes if refined is not None else ()
    return type(running), run.statistics.waiting > 1, len(further_performers(running)), run.notice, changes


class _Empty(SidebarPanel):
    """Panel without a height.

    One of the two is always there, so that the others keep their places.
    """

    bl_label = ""
    bl_options = {"HIDE_HEADER"}
    number: int

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether this one is there.

        It is the other one than before if the content has changed.
        """
        if context.region is None:
            return False
        drawn = _sidebars.setdefault(context.region.as_pointer(), _Drawn())
        if (now := content()) != drawn.content:
            drawn.content, drawn.number = now, 1 - drawn.number
        return drawn.number == cls.number

    def draw(self, context: bpy.types.Context) -> None:
        """Draw nothing."""


class PERFANIM_PT_alignment(_Empty, bpy.types.Panel):
    """Empty panel that takes turns with the next one."""

    number = 0


class PERFANIM_PT_alignment_next(_Empty, bpy.types.Panel):
    """Empty panel that takes turns with the one above."""

    number = 1


def unregister() -> None:
    """Forget the sidebars."""
    _sidebars.clear()
