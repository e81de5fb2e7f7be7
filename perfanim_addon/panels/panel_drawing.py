"""Drawing of text, progress and properties in panels of any width."""

import re

import bpy

from ..jobs import activity
from ..jobs.job import Job

# Width of a character, and of icon, margins and tabs beside the text, in unscaled pixels.
CHARACTER_PX = 6.2
MARGIN_PX = 90.0
ICON_CHARACTERS = 5  # width of an icon and its margin, in characters
LEAST_STATUS = 8  # characters of a status, in any sidebar


def draw_progress(layout: bpy.types.UILayout, fraction: float, text: str) -> None:
    """Draw a progress bar with text."""
    layout.progress(factor=min(max(fraction, 0.0), 1.0), text=text)


def draw_job(layout: bpy.types.UILayout, panel: str) -> None:
    """Draw the progress of this panel's job, with Cancel and Finish Now."""
    job = activity.current()
    if isinstance(job, Job) and job.panel == panel:
        row = layout.row(align=True)
        draw_progress(row, job.fraction, job.text)
        row.operator("perfanim.cancel_job", text="", icon="X")
        if job.finishable:
            layout.operator("perfanim.finish_job", icon="CHECKMARK")


def draw_text(context: bpy.types.Context, layout: bpy.types.UILayout, text: str, icon: str) -> None:
    """Draw a sentence, wrapped to the width of the sidebar; nothing for ""."""
    column = layout.column(align=True)
    text = text[:1].upper() + text[1:]
    for index, line in enumerate(wrapped(text, characters(context))):
        column.label(text=line, icon=icon if index == 0 else "BLANK1")


def characters(context: bpy.types.Context) -> int:
    """Return the number of characters that fit a line of the sidebar beside its icon."""
    unscaled_px = context.region.width / context.preferences.system.ui_scale
    return max(16, int((unscaled_px - MARGIN_PX) / CHARACTER_PX))


def header_status(context: bpy.types.Context, title: str, text: str) -> str:
    """Shorten a status to fit a panel's header beside the title."""
    return shortened(text, max(LEAST_STATUS, characters(context) - len(title) - ICON_CHARACTERS))


def shortened(text: str, width: int) -> str:
    """Return the text, shortened to at most `width` characters."""
    return text if len(text) <= width else text[: width - 1].rstrip(" ,") + "…"


def wrapped(text: str, width: int) -> list[str]:
    """Return the text in lines of at most `width` characters.

    Long words are cut; no-break spaces hold words together.
    """
    lines: list[str] = []
    for word in re.findall(r"[^ \n]+", text):
        if lines and len(lines[-1]) + 1 + len(word) <= width:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
        while len(lines[-1]) > width:
            lines[-1:] = [lines[-1][:width], lines[-1][width:]]
    return lines
