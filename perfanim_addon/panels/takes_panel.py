"""Takes panel, and the recovery offer below the Capture panel."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy

from ...core.errors import PerfanimError, counted
from ...core.formats.take_file.append_notes import append_notes
from ...core.formats.take_file.take_reader import TakeSummary, summarise
from ...core.formats.take_file.take_setup import MOST_STARS
from ...core.session.verdict import GOOD
from ...core.solver.settings import SolveSettings
from .. import take_library
from ..capture.live_capture import running_capture
from ..jobs import activity
from ..preferences.property_kinds import collection, draw_props, property_column, string, switch, whole_number
from ..preferences.sidebar_tab import SidebarPanel
from ..settings import result_settings
from ..settings.performer_refinement import offer
from . import panel_drawing
from .capture_panel import PERFANIM_PT_capture

KEY, IMPORT_KEY = "takes", "import"
_wanted = [""]  # file of the take to select when the list is next filled


def _note(name: str, default: Any) -> dict[str, Any]:
    """Return the getter and setter of a property that is stored as a note in the take's file."""

    def get(item: "PERFANIM_PG_take") -> Any:
        return getattr(item.summary.notes, name) if item.summary is not None else default

    def write(item: "PERFANIM_PG_take", value: Any) -> None:
        try:
            append_notes(item.path, replace(summarise(item.path).notes, **{name: value}))
        except PerfanimError as error:
            activity.set_message(KEY, str(error), "ERROR")
        take_library.forget()

    return {"get": get, "set": write}


class PERFANIM_PG_take(bpy.types.PropertyGroup):
    """A take in the list; its facts and notes are read from its file."""

    path: string("File", "File of the take")
    title: string("Name", "Name of the take", **_note("name", ""))
    notes: string("Notes", "Notes about the take", **_note("notes", ""))
    rating: whole_number("Rating", "Stars, 0 to 5", 0, 0, MOST_STARS, **_note("rating", 0))

    @property
    def summary(self) -> TakeSummary | None:
        """Facts from the file; None once it is gone."""
        return next((take for take in take_library.listed() if str(take.path) == self.path), None)


class PERFANIM_PG_takes(bpy.types.PropertyGroup):
    """List of the takes in the user's folder."""

    attached_to = (bpy.types.WindowManager, "perfanim_takes")
    entries: collection("Takes", "The takes in the folder", PERFANIM_PG_take)
    active: bpy.props.IntProperty(name="Take", description="Take shown below the list")
    this_file: switch("This File", "List only takes that were captured in this file, or first put on a character in it")


class PERFANIM_UL_takes(panel_drawing.RowList, bpy.types.UIList):
    """List with name, stars and length of one take per row; a double click edits the name."""

    bl_idname = "PERFANIM_UL_takes"

    def draw_row(self, layout: bpy.types.UILayout, item: PERFANIM_PG_take) -> None:
        row, take = layout.row(), item.summary
        if take is None or not take.complete:
            row.label(text=item.title, icon="ERROR")
        else:
            row.prop(item, "title", text="", emboss=False, icon="ERROR" if why_not_good(take) else "REC")
        facts = row.row()
        facts.alignment = "RIGHT"  # no wider than its text, to leave space for long names
        facts.label(text=f"{'★' * item.rating}  {_length(take)}" if take and take.complete else "cut off")


class PERFANIM_PT_takes(SidebarPanel, bpy.types.Panel):
    """Panel for the recorded takes."""

    bl_label = "Takes"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        if running_capture() is not None:
            layout.label(text="Takes are listed after the capture")
            return
        layout.operator("perfanim.import_takes", text="Import...", icon="IMPORT")
        shown = _list(context)
        if not take_library.listed():
            layout.label(text="Every capture is kept here")
        else:
            if bpy.data.filepath:
                layout.prop(shown, "this_file")
            layout.template_list("PERFANIM_UL_takes", "", shown, "entries", shown, "active", rows=4)
            if not shown.entries:
                layout.label(text="No take of this file yet")
        panel_drawing.draw_outcome(context, layout, IMPORT_KEY)
        panel_drawing.draw_job(context, layout, KEY)  # above the take's settings, so that it is on small screens
        text, icon = activity.message(KEY)
        is_error = icon == "ERROR"
        panel_drawing.draw_text(context, layout, text if is_error else "", icon)
        if 0 <= shown.active < len(shown.entries):
            _draw_take(context, layout, shown.entries[shown.active])
        # the result of a button below it, so that no button moves away
        panel_drawing.draw_text(context, layout, "" if is_error else text, icon)
        _draw_room(layout, len(take_library.listed()))


def _draw_take(context: bpy.types.Context, layout: bpy.types.UILayout, item: PERFANIM_PG_take) -> None:
    take = item.summary
    if take is None:
        return
    if not take.complete:
        layout.operator("perfanim.recover_take", icon="FILE_REFRESH").path = item.path
        layout.operator("perfanim.delete_take", icon="TRASH").path = item.path
        return
    column = layout.column(align=True)
    for text in (take.created.replace("T", " ")[:16], size_of(take), origin_of(take)):
        panel_drawing.draw_text(context, column, text, "BLANK1")
    if why_not_good(take):
        panel_drawing.draw_text(context, column, why_not_good(take), "ERROR")
    column = property_column(layout)
    draw_props(column, item, "rating", "notes")
    layout.operator("perfanim.play_take", icon="ARMATURE_DATA").path = item.path
    header, body = layout.panel("perfanim_result", default_closed=True)
    header.label(text="Placing and Keys")
    if body is not None:
        result_settings.draw(body, context)
    row = layout.row(align=True)
    row.operator("perfanim.solve_take", icon="FILE_REFRESH").path = item.path
    row.operator_menu_enum("perfanim.export_take", "kind", text="Export", icon="EXPORT").path = item.path
    row.operator("perfanim.delete_take", text="", icon="TRASH").path = item.path
    layout.operator("perfanim.refine_performer", icon="USER").path = item.path
    _draw_refined(context, layout, item.path)


def why_not_good(take: TakeSummary) -> str:
    """Return the verdict on a take's solve, or "" if it is good or unknown."""
    return take.notes.verdict if take.notes.verdict != GOOD else ""


def _draw_refined(context: bpy.types.Context, layout: bpy.types.UILayout, path: str) -> None:
    """Draw how refining with a take changes the performer and, except during a capture, the buttons Use and Keep."""
    found = offer.refined
    if found is None or found.take != path:
        return
    column = layout.column(align=True)
    for text in (f"{found.subject.name}, refined with this take:", *found.changes):
        # no line break between a number and its sign or unit
        panel_drawing.draw_text(context, column, text.replace("± ", "±\u00a0").replace(" %", "\u00a0%"), "BLANK1")
    if running_capture() is not None:
        return  # the body does not change during a capture
    row = column.row(align=True)
    row.operator("perfanim.use_refined_performer", text="Use", icon="CHECKMARK")
    row.operator("perfanim.refuse_refined_performer", text="Keep", icon="X")


def _draw_room(layout: bpy.types.UILayout, count: int) -> None:
    listed, gone = take_library.disk_space()
    if count or gone:
        text = f"{counted(count, 'take')}, {take_library.size_text(listed)}"
        text += f"; deleted {take_library.size_text(gone)}" if gone else ""
        layout.label(text=text, icon="DISK_DRIVE")
        row = layout.row(align=True)
        row.operator("perfanim.clean_up_takes", text="Free Disk Space")
        if gone:
            row.operator_menu_enum("perfanim.restore_take", "take", icon="LOOP_BACK")


def draw_offer(panel: bpy.types.Panel, context: bpy.types.Context) -> None:
    """Draw the offers to recover a take and to refine the performer; during a capture, the refinement so far."""
    captured = offer.capture
    if running_capture() is not None:
        _draw_refined(context, panel.layout, captured)
        return
    if captured:
        panel.layout.operator("perfanim.refine_performer", text="Refine Performer with This Capture").path = captured
        _draw_refined(context, panel.layout, captured)
    cut = take_library.cut_off()
    if cut:
        count = "A capture was" if len(cut) == 1 else f"{len(cut)} captures were"
        panel_drawing.draw_text(context, panel.layout, f"{count} cut off", "ERROR")
        operator = "perfanim.play_take" if cut[0].complete else "perfanim.recover_take"
        button = panel.layout.operator(operator, text=f"Recover {cut[0].notes.name}", icon="FILE_REFRESH")
        button.path = str(cut[0].path)
    if captured or cut:
        panel_drawing.draw_job(context, panel.layout, KEY)


def _list(context: bpy.types.Context) -> PERFANIM_PG_takes:
    """Return the list; schedule `_fill` after drawing if it has to change."""
    shown = context.window_manager.perfanim_takes
    # a new take may be listed already, but not selected yet
    waits = bool(_wanted[0]) or [item.path for item in shown.entries] != _paths()
    if waits and not bpy.app.timers.is_registered(_fill):
        bpy.app.timers.register(_fill)
    return shown


def _paths() -> list[str]:
    chosen = bpy.context.window_manager.perfanim_takes.this_file
    return [str(take.path) for take in (take_library.in_project() if chosen else take_library.listed())]


def _fill() -> None:
    """Fill the list from the folder."""
    shown, paths = bpy.context.window_manager.perfanim_takes, _paths()
    chosen, _wanted[0] = _wanted[0] or active_path(bpy.context), ""
    shown.entries.clear()
    for path in paths:
        shown.entries.add().path = path
    shown.active = paths.index(chosen) if chosen in paths else 0
    activity.redraw_sidebars()


def _length(take: TakeSummary) -> str:
    return f"{int(take.duration_s) // 60}:{int(take.duration_s) % 60:02d}"


def size_of(take: TakeSummary) -> str:
    """Return the number of frames and the disk space of a take."""
    return f"{counted(take.frames, 'frame')}, {take_library.size_text(take_library.size([take.path]))}"


def origin_of(take: TakeSummary) -> str:
    """Return performers, markers, method and database of a take, and its character."""
    texts = (
        " and ".join(take.performers),
        f"markers {take.marker_set}" if take.marker_set else "",
        f"method {take.method or SolveSettings().method}" if take.performers else "no performer yet: click Solve Again",
        f"database {take.database}" if take.database else "",
        f"on {take.notes.character}" if take.notes.character else "",
    )
    return ", ".join(text for text in texts if text)


def active_path(context: bpy.types.Context) -> str:
    """Return the file of the take selected in the list, or "" if none is."""
    shown = context.window_manager.perfanim_takes
    return str(shown.entries[shown.active].path) if 0 <= shown.active < len(shown.entries) else ""


def choose(path: Path) -> None:
    """Select a new take in the list."""
    _wanted[0] = str(path)
    take_library.forget()


@bpy.app.handlers.persistent
def _after_save(*_: object) -> None:
    take_library.claim()


@bpy.app.handlers.persistent
def _after_load(*_: object) -> None:
    take_library.disown()


def register() -> None:
    """Add the offers to the Capture panel, and the handlers that tell the takes of the open file."""
    PERFANIM_PT_capture.append(draw_offer)
    bpy.app.handlers.save_post.append(_after_save)
    bpy.app.handlers.load_post.append(_after_load)


def unregister() -> None:
    """Undo `register`."""
    PERFANIM_PT_capture.remove(draw_offer)
    bpy.app.handlers.save_post.remove(_after_save)
    bpy.app.handlers.load_post.remove(_after_load)
    if bpy.app.timers.is_registered(_fill):
        bpy.app.timers.unregister(_fill)
