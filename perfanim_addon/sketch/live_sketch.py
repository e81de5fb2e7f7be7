"""Live solving of a sketch while its controls are edited.

Blender's handler only notes a change. A timer reads the keys, sends them to the worker, shows the newest solution in
the current frame, and fills the action's curves a few at a time, so that Blender never waits.
"""

import time
from collections.abc import Iterator
from typing import Any

import bpy
import numpy as np

from ...core.errors import PerfanimError, SettingsError
from ...core.sketch.sketch_file import Sketch
from ...core.sketch.sketch_messages import SolvedSketch, solution_from
from ...core.system.schema import table_of
from ...core.worker.client import WorkerClient
from ...core.worker.protocol import MessageKind
from ...core.worker.requests import SketchEdit, SketchRequest
from ..animation.action_placement import fit_strips
from ..animation.actions import is_keyed_in_each_frame, refill_action
from ..capture.armature_driver import ArmatureDriver
from ..character.create_character import find_armature
from ..jobs import activity
from ..settings.capture_settings import settings
from .controls import EDITING, controls_of
from .read_controls import read_controls
from .write_solution import SketchBody, keep_sketch, outcome_text, write_solution

KEY = "sketch"  # panel that shows the messages


class LiveSketch:
    """One character's sketch, solved in its own worker after each edit.

    It holds only names, because undo replaces Blender's data. PerfanimError if the character cannot be driven or no
    control has a key.
    """

    def __init__(self, context: bpy.types.Context, armature: str, database: str, python: str | None) -> None:
        self.armature = armature
        found = find_armature(armature)
        self.body = SketchBody.of(found)
        self._driver = ArmatureDriver(armature, self.body.skeleton, settings(context).body_parts)
        self.noted = False
        self.shown = 0  # number of solutions shown
        self._number = self._answered = 0
        self._seen = {each.joint: each for each in read_controls(context, found, self.body.space).controls}
        self._sent: dict[str, Any] = {}
        self._sketches: dict[int, Sketch] = {}
        self._filling: Iterator[None] | None = None
        self._filled = "", 0  # name and address of the action that is filled
        self._kept = ""  # part of the message, about an action that is left unchanged
        fields = self._next_fields(context, *self._read(context))
        request = SketchRequest(live=True, skeleton=self.body.skeleton, database=database, **fields)
        self._client = WorkerClient(request, python)

    def _read(self, context: bpy.types.Context) -> tuple[Sketch, dict[str, Any]]:
        """Return the sketch, and the part of the request that holds it and the settings."""
        found = find_armature(self.armature)
        sketch = read_controls(context, found, self.body.space, dragged=True, seen=self._seen)
        chosen = found.perfanim_sketch.solver_settings()
        return sketch, {"sketch": table_of(sketch), "settings": table_of(chosen)}

    def _next_fields(self, context: bpy.types.Context, sketch: Sketch, table: dict[str, Any]) -> dict[str, Any]:
        """Return the fields of the next request."""
        self._number, self._sent = self._number + 1, table
        self._sketches[self._number] = sketch
        return {"number": self._number, "frame": context.scene.frame_current, **table}

    def tick(self, context: bpy.types.Context) -> None:
        """Send a noted edit and show the newest solution, without waiting; PerfanimError if the worker died."""
        if self.noted and self._client.connected:
            self.noted = False
            try:
                sketch, table = self._read(context)
            except SettingsError as error:  # the next edit may fix it
                activity.set_message(KEY, str(error), "ERROR")
            else:
                if table != self._sent:
                    self._client.request_again(SketchEdit(**self._next_fields(context, sketch, table)))
        newest = None
        for message in self._client.poll():
            if message.kind is MessageKind.ERROR:
                raise message.error()
            if message.kind is MessageKind.RESULT:
                newest = message
        if newest is not None:
            self._show(context, solution_from(newest.json()))
        elif self._filling is not None:
            self._fill()

    def _show(self, context: bpy.types.Context, solved: SolvedSketch) -> None:
        """Show a solution in the current frame; write a whole solution to the action."""
        self._answered = solved.number if solved.whole else self._answered
        if solved.error:
            activity.set_message(KEY, solved.error, "ERROR")
            activity.redraw_sidebars()
            return
        sketch, found = self._sketches[solved.number], find_armature(self.armature)
        self._sketches = {number: each for number, each in self._sketches.items() if number >= solved.number}
        at = int(np.clip(context.scene.frame_current - sketch.frames[0], 0, len(solved.rotations) - 1))
        self._driver.apply(solved.rotations[at], solved.root_positions_m[at])
        self.shown += 1
        if not solved.whole:
            return
        chosen, action = found.perfanim_sketch.solver_settings(), found.perfanim_sketch.action
        if action is None or (self._filling is None and not is_keyed_in_each_frame(action)):
            self._kept = f"; {action.name} is kept with its few keys" if action is not None else ""
            write_solution(context, found, sketch, chosen, solved, ends_only=True)
            action = found.perfanim_sketch.action
        keep_sketch(action, sketch, chosen)
        if found.animation_data is not None:
            fit_strips(found.animation_data, action, sketch.frames)
        self._filled = action.name, action.as_pointer()
        motion = solved.rotations, solved.root_positions_m, self._driver.plan
        self._filling = refill_action(found, action, sketch.frames, *motion)
        activity.set_message(KEY, outcome_text(solved) + self._kept, "ERROR" if solved.unmet else "INFO")
        activity.redraw_sidebars()

    def _fill(self) -> None:
        name, pointer = self._filled
        action = bpy.data.actions.get(name)
        if action is None or action.as_pointer() != pointer:  # the action was deleted meanwhile
            self._filling = None
        limit_s = time.perf_counter() + EDITING.slice_s
        while self._filling is not None and time.perf_counter() < limit_s:
            if next(self._filling, self) is self:
                self._filling = None

    def finish(self) -> None:
        """Fill all remaining curves now."""
        while self._filling is not None:
            self._fill()

    @property
    def idle(self) -> bool:
        """Whether all edits are solved and shown."""
        return not self.noted and self._filling is None and self._answered == self._number

    @property
    def worker_id(self) -> int:
        """Process id of the worker."""
        return self._client.process_id

    def close(self) -> None:
        """End the worker."""
        self._client.close()


_running: list[LiveSketch] = []  # at most one


def current() -> LiveSketch | None:
    """Return the running live sketch, or None."""
    return _running[0] if _running else None


def begin(context: bpy.types.Context, armature: str, database: str, python: str | None) -> None:
    """Start solving edits of a character's sketch; errors are those of `LiveSketch`."""
    end()
    _running.append(LiveSketch(context, armature, database, python))
    for handlers, handler in _handlers():
        handlers.append(handler)
    bpy.app.timers.register(_tick, first_interval=EDITING.tick_s)


def end() -> None:
    """Stop solving edits; safe at any time."""
    while _running:
        _running.pop().close()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    for handlers, handler in _handlers():
        if handler in handlers:
            handlers.remove(handler)


def _handlers() -> tuple[tuple[Any, Any], ...]:
    known = bpy.app.handlers
    undone = ((each, _after_undo) for each in (known.undo_post, known.redo_post))
    return (known.depsgraph_update_post, _note), (known.load_pre, _before_load), *undone


def _note(_scene: bpy.types.Scene, graph: bpy.types.Depsgraph) -> None:
    live = current()
    if live is None or live.noted:
        return
    found = bpy.data.objects.get(live.armature)
    if found is None:
        live.noted = True
        return
    names = {live.armature}  # an edit of the sketch's settings updates the armature
    for control in controls_of(found).values():
        targets = [getattr(each, "target", None) for each in control.constraints]
        for each in (control, *(target for target in targets if target is not None)):
            action = each.animation_data.action if each.animation_data is not None else None
            names |= {data.name for data in (each, each.data, action) if data is not None}
    live.noted = any(update.id.name in names for update in graph.updates)


@bpy.app.handlers.persistent
def _after_undo(*_: object) -> None:
    live = current()
    if live is not None:  # Blender's data was replaced
        live._filling, live._sent, live.noted = None, {}, True


@bpy.app.handlers.persistent
def _before_load(*_: object) -> None:
    end()


def _tick() -> float | None:
    live = current()
    if live is None:
        return None
    try:
        live.tick(bpy.context)
    except PerfanimError as error:
        activity.set_message(KEY, str(error), "ERROR")
        activity.redraw_sidebars()
        end()
        return None
    return EDITING.tick_s
