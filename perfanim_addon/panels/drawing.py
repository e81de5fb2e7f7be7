"""Text, progress and properties in panels of any width."""

from typing import Any

import bpy

from ..jobs import activity
from ..jobs.job import Job

# Width of a character, and of what a line has beside its text (icon, margins, tabs), in unscaled pixels.
CHARACTER_PX = 6.2
MARGIN_PX = 90.0


def draw_props(layout: bpy.types.UILayout, chosen: Any, *names: str) -> None:
    """Draw properties of a group, one below the other."""
    for name in names:
        layout.prop(chosen, name)


def draw_progress(layout: bpy.types.UILayout, fraction: float, text: str) -> None:
    """Draw a bar with text."""
    layout.progress(factor=min(max(fraction, 0.0), 1.0), text=text)


def draw_job(layout: bpy.types.UILayout, panel: str) -> None:
    """Draw the progress of a job of this panel, its Cancel and, where it has one, Finish Now."""
    job = activity.current()
    if isinstance(job, Job) and job.panel == panel:
        row = layout.row(align=True)
        draw_progress(row, job.fraction, job.text)
        row.operator("perfanim.cancel_job", text="", icon="X")
        if job.finishable:
            layout.operator("perfanim.finish_job", icon="CHECKMARK")


def draw_text(context: bpy.types.Context, layout: bpy.types.UILayout, text: str, icon: str) -> None:
    """Draw a sentence over as many lines as it takes in a sidebar of this width; nothing for ""."""
    column = layout.column(align=True)
    text = text[:1].upper() + text[1:]
    for index, line in enumerate(wrapped(text, characters(context))):
        column.label(text=line, icon=icon if index == 0 else "BLANK1")


def characters(context: bpy.types.Context) -> int:
    """Return how many characters a line of the sidebar has room for beside its icon and margins."""
    unscaled_px = context.region.width / context.preferences.system.ui_scale
    return max(16, int((unscaled_px - MARGIN_PX) / CHARACTER_PX))


def shortened(text: str, width: int) -> str:
    """Return the text, cut to at most `width` characters: a longer one would lie over what stands before it."""
    return text if len(text) <= width else text[: width - 1].rstrip(" ,") + "…"


def wrapped(text: str, width: int) -> list[str]:
    """Return the text cut into lines of at most `width` characters; long paths are cut wherever it must be."""
    lines: list[str] = []
    for word in text.split():
        if lines and len(lines[-1]) + 1 + len(word) <= width:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
        while len(lines[-1]) > width:
            lines[-1:] = [lines[-1][:width], lines[-1][width:]]
    return lines
