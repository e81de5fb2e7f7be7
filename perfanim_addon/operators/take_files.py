"""Operators for the files of takes: delete, restore, clean up."""

from pathlib import Path

import bpy

from ...core.errors import TakeError, counted
from ...core.formats.take_file.take_reader import summarise
from ...core.formats.take_file.take_setup import MOST_STARS
from .. import take_library
from ..panels.takes_panel import KEY as PANEL
from ..preferences.property_kinds import HIDDEN, draw_props, dynamic_choice, string, switch, whole_number
from .operator_bases import PanelOperator, need


class _FileOperator(PanelOperator):
    """Base of the operators for files of takes; they do not need a scene."""

    needs_scene = False
    panel = PANEL


class PERFANIM_OT_delete_take(_FileOperator, bpy.types.Operator):
    """Move the take to the trash, until Restore or Free Disk Space; its actions stay"""

    bl_label = "Delete Take"
    path: string("Take", "File of the take", options=HIDDEN)

    def run(self, context: bpy.types.Context) -> str:
        name = summarise(self.path).notes.name
        take_library.delete(Path(self.path))
        return f"{name} deleted: Restore brings it back"


def _deleted(_context: object) -> list[tuple[str, str, str]]:
    return [(str(take.path), take.notes.name, f"From {take.created[:16]}") for take in take_library.deleted()]


class PERFANIM_OT_restore_take(_FileOperator, bpy.types.Operator):
    """Bring a deleted take back into the list"""

    bl_label = "Restore"
    take: dynamic_choice("Take", "Take to restore", _deleted)
    missing_input = need(lambda _context: take_library.are_deleted(), "There are no deleted takes")

    def run(self, context: bpy.types.Context) -> str:
        name = summarise(self.take).notes.name
        take_library.restore(Path(self.take))
        return f"{name} restored"


class PERFANIM_OT_clean_up_takes(_FileOperator, bpy.types.Operator):
    """Show the disk space of the takes, and permanently remove deleted or old ones"""

    bl_label = "Free Disk Space"
    deleted: switch("Deleted Takes", "Deleted takes, and damaged files that were recovered", default=True)
    old: switch("Old Takes", "Listed takes that are older, and have no more stars, than set below")
    days: whole_number("Older Than (Days)", "Age above which a take is old", 90, 0, 10_000)
    stars: whole_number("Maximum Stars", "Takes with more stars are kept", 0, 0, MOST_STARS)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        take_library.forget()
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        listed, _ = take_library.disk_space()
        layout.label(text=f"{counted(len(take_library.listed()), 'take')}, {take_library.size_text(listed)}")
        draw_props(layout, self, "deleted", "old")
        column = layout.column()
        column.enabled = self.old
        draw_props(column, self, "days", "stars")
        files = self._files()
        size = take_library.size_text(take_library.size(files))
        layout.label(text=f"To be removed permanently: {counted(len(files), 'file')}, {size}", icon="ERROR")

    def _files(self) -> list[Path]:
        old = [take.path for take in take_library.low_rated(self.days, self.stars)] if self.old else []
        return [*(take_library.in_trash() if self.deleted else []), *old]

    def run(self, context: bpy.types.Context) -> str:
        files = self._files()
        if not files:
            raise TakeError("nothing is selected for removal", advice="enable Deleted Takes or Old Takes")
        freed = take_library.remove(files)
        return f"{counted(len(files), 'file')} removed, {take_library.size_text(freed)} freed"
