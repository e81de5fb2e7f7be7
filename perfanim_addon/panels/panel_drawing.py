"""Drawing text, progress, messages and list rows in panels of any width."""

import re
from dataclasses import dataclass
from typing import Any

import bpy

from ..jobs import activity
from ..jobs.job import Job


@dataclass(frozen=True)
class Widths:
    """Widths in the sidebar, measured with Blender's default font."""

    character_px: float = 6.2  # average width of a character, unscaled
    margin_px: float = 90.0  # icon, margins and tabs next to the text, unscaled
    icon: int = 5  # icon and margin in characters
    status: int = 8  # smallest width of a status in characters
    line: int = 16  # smallest width of a line in characters


_WIDTHS = Widths()


class RowList:
    """Base of lists with one row per item."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property) -> None:  # type: ignore[no-untyped-def]
        self.draw_row(layout, item)

    def draw_row(self, layout: bpy.types.UILayout, item: Any) -> None:
        """Draw an item."""


def draw_progress(layout: bpy.types.UILayout, fraction: float, text: str) -> None:
    """Draw a progress bar with text."""
    layout.progress(factor=min(max(fraction, 0.0), 1.0), text=text)


def job_of(panel: str) -> Job | None:
    """Return the running job of a panel, or None."""
    job = activity.current()
    return job if isinstance(job, Job) and job.panel == panel else None


def draw_outcome(context: bpy.types.Context, layout: bpy.types.UILayout, panel: str) -> None:
    """Draw the job and the message of a panel."""
    draw_job(context, layout, panel)
    draw_text(context, layout, *activity.message(panel))


def draw_job(context: bpy.types.Context, layout: bpy.types.UILayout, panel: str) -> None:
    """Draw the progress of a panel's job, with Cancel and Finish Now; a long text stands whole below the bar."""
    job = job_of(panel)
    if job is not None:
        is_long = len(job.text) > characters(context)
        row = layout.row(align=True)
        draw_progress(row, job.fraction, f"{job.fraction:.0%}" if is_long else job.text)
        row.operator("perfanim.cancel_job", text="", icon="X")
        if is_long:
            draw_text(context, layout, job.text, "BLANK1")
        if job.time_left:
            layout.label(text=job.time_left[:1].upper() + job.time_left[1:], icon="TIME")
        if job.finishable:
            layout.operator("perfanim.finish_job", icon="CHECKMARK")


def draw_text(context: bpy.types.Context, layout: bpy.types.UILayout, text: str, icon: str) -> None:
    """Draw a sentence, wrapped to the width of the sidebar."""
    column = layout.column(align=True)
    text = text[:1].upper() + text[1:]
    for index, line in enumerate(wrapped(text, characters(context))):
        column.label(text=line, icon=icon if index == 0 else "BLANK1")


def characters(context: bpy.types.Context) -> int:
    """Return the number of characters that fit in a line of the sidebar next to an icon."""
    unscaled_px = context.region.width / context.preferences.system.ui_scale
    return max(_WIDTHS.line, int((unscaled_px - _WIDTHS.margin_px) / _WIDTHS.character_px))


def header_status(context: bpy.types.Context, title: str, text: str) -> str:
    """Shorten a status so that it fits in a panel's header next to the title."""
    return shortened(text, max(_WIDTHS.status, characters(context) - len(title) - _WIDTHS.icon))


def shortened(text: str, width: int) -> str:
    """Return the text, shortened to at most `width` characters."""
    return text if len(text) <= width else text[: width - 1].rstrip(" ,") + "…"


def wrapped(text: str, width: int) -> list[str]:
    """Return the text in lines of at most `width` characters.

    Long words are cut, paths behind one of their folders; no-break spaces keep words together.
    """
    lines: list[str] = []
    for word in re.findall(r"[^ \n]+", text):
        if lines and len(lines[-1]) + 1 + len(word) <= width:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
        while len(line := lines[-1]) > width:
            cut = max(line.rfind(mark, 1, width) for mark in "/\\_-") + 1 or width
            lines[-1:] = [line[:cut], line[cut:]]
    return lines
