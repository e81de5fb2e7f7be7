"""Files of takes: deleted, had back, cleaned up."""

from pathlib import Path

import bpy

from ...core.errors import PerfanimError, TakeError
from ...core.formats.take_file.reading import summarise
from ...core.formats.take_file.setup import MOST_STARS
from .. import take_library
from ..jobs import activity
from ..panels.takes import KEY as PANEL
from . import common


class _Idle:
    """What may be done only while nothing runs."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while nothing runs."""
        return common.idle(cls)


def _told(text: str) -> set[str]:
    activity.set_message(PANEL, text)
    return {"FINISHED"}


class PERFANIM_OT_delete_take(_Idle, bpy.types.Operator):
    """Take the take out of the list; its Actions stay, and Restore brings it back until Clean Up removes it"""

    bl_idname = "perfanim.delete_take"
    bl_label = "Delete Take"
    path: bpy.props.StringProperty(name="Take", description="File of the take", options={"HIDDEN", "SKIP_SAVE"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Move the file."""
        try:
            name = summarise(self.path).notes.name
            take_library.delete(Path(self.path))
        except PerfanimError as error:
            return common.failed(self, PANEL, error)
        return _told(f"{name} deleted: Restore brings it back")


_deleted: list[tuple[str, str, str]] = []  # Blender keeps no reference to a dynamic enumeration's strings


def _deleted_items(_self: object, _context: object) -> list[tuple[str, str, str]]:
    _deleted[:] = [(str(take.path), take.notes.name, f"Of {take.created[:16]}") for take in take_library.deleted()]
    return _deleted


class PERFANIM_OT_restore_take(bpy.types.Operator):
    """Bring a deleted take back into the list"""

    bl_idname = "perfanim.restore_take"
    bl_label = "Restore"
    take: bpy.props.EnumProperty(name="Take", description="Which one", items=_deleted_items)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Needs one."""
        if not common.idle(cls):
            return False
        if not take_library.are_deleted():
            cls.poll_message_set("No take is deleted")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Move the file back."""
        try:
            name = summarise(self.take).notes.name
            take_library.restore(Path(self.take))
        except PerfanimError as error:
            return common.failed(self, PANEL, error)
        return _told(f"{name} is back")


class PERFANIM_OT_clean_up_takes(_Idle, bpy.types.Operator):
    """Show how much room takes need, and remove for good what is no longer wanted"""

    bl_idname = "perfanim.clean_up_takes"
    bl_label = "Clean Up Takes"
    deleted: bpy.props.BoolProperty(
        name="Deleted Takes", description="Deleted takes, and cut files whose content was recovered", default=True
    )
    old: bpy.props.BoolProperty(
        name="Old Takes",
        description="Takes of the list that are older and have no more stars than below",
        default=False,
    )
    days: bpy.props.IntProperty(name="Older Than (Days)", description="Age of old takes", default=90, min=0, max=10_000)
    stars: bpy.props.IntProperty(
        name="Stars at Most", description="Takes with more stars are kept", default=0, min=0, max=MOST_STARS
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Show what would go, and ask."""
        take_library.forget()
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw what there is, what is chosen, and what would go."""
        layout = self.layout
        listed, _ = take_library.room()
        layout.label(text=f"{len(take_library.listed())} takes, {take_library.size_text(listed)}")
        layout.prop(self, "deleted")
        layout.prop(self, "old")
        column = layout.column()
        column.enabled = self.old
        column.prop(self, "days")
        column.prop(self, "stars")
        going = self._going()
        layout.label(
            text=f"Removed for good: {len(going)} files, {take_library.size_text(take_library.size(going))}",
            icon="ERROR",
        )

    def _going(self) -> list[Path]:
        old = [take.path for take in take_library.unloved(self.days, self.stars)] if self.old else []
        return [*(take_library.gone() if self.deleted else []), *old]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remove."""
        going = self._going()
        try:
            if not going:
                raise TakeError("nothing is chosen that could be removed")
            freed = take_library.remove(going)
        except PerfanimError as error:
            return common.failed(self, PANEL, error)
        return _told(f"{len(going)} files removed, {take_library.size_text(freed)} free")


_CLASSES = (PERFANIM_OT_delete_take, PERFANIM_OT_restore_take, PERFANIM_OT_clean_up_takes)

register, unregister = bpy.utils.register_classes_factory(_CLASSES)
