"""The file of the body network, which finds people without markers: its state, and the buttons that bring it."""

from functools import lru_cache
from pathlib import Path

import bpy

from ...core.errors import PerfanimError
from ...core.vision.people.network_file import body_network_file, read_network


def problem() -> str:
    """Return why the body network cannot be used, or ""; fast enough for drawing."""
    path = body_network_file()
    try:
        facts = path.stat()
    except OSError:
        return "the body network is not there yet"
    return _problem_of(path, (facts.st_mtime_ns, facts.st_size))


@lru_cache(maxsize=1)
def _problem_of(path: Path, _stamp: tuple[int, int]) -> str:
    try:
        read_network(path)
    except PerfanimError as error:
        return str(error)
    return ""


def draw(layout: bpy.types.UILayout) -> None:
    """Draw the state and the buttons."""
    wrong = problem()
    layout.label(text=wrong or "The body network is there", icon="ERROR" if wrong else "CHECKMARK")
    if hasattr(bpy.types, "PERFANIM_OT_get_body_network"):  # missing if a library is broken
        draw_buttons(layout).operator("perfanim.cancel_job", text="", icon="X")


def draw_buttons(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """Draw the buttons that bring the network, and return their row."""
    row = layout.row(align=True)
    row.operator("perfanim.get_body_network", icon="URL")
    row.operator("perfanim.open_body_network", text="", icon="FILE_FOLDER")
    return row
