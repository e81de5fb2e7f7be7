"""Operators for the Sketch Motion panel."""

from functools import lru_cache
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core.body.body_size import standing_root_m
from ...core.body.calibration_poses import hanging
from ...core.body.skeleton import forward_kinematics
from ...core.database.store import open_database
from ...core.errors import PerfanimError, SettingsError, counted
from ...core.sketch.sketch_messages import solution_from
from ...core.system.files import exists
from ...core.system.schema import table_of
from ...core.worker.requests import SketchRequest
from ..animation.keyframes import KeyBounds
from ..capture.armature_driver import ArmatureDriver
from ..capture.performer_targets import add_character
from ..character.create_character import find_armature
from ..character.selection import select_only
from ..preferences import preferences
from ..preferences.property_kinds import dynamic_choice, string, switch
from ..settings import readiness
from ..settings.capture_settings import settings
from ..sketch import control_colours, follow_rig, hips_path, live_sketch
from ..sketch.controls import STORED, add_controls, controls_of, key_controls, set_keys
from ..sketch.read_controls import read_controls
from ..sketch.write_solution import SketchBody, kept_sketch, write_solution
from .character_operators import performer_skeleton
from .database_operators import SolvingOperator, is_starter_missing
from .operator_bases import RunningOperator, UndoOperator, need, report_error

PANEL = live_sketch.KEY
_CONTROLS = "choose at least one control, such as the hands or the hips"
_KEY = "move one, press I to key it, go to another frame, move and key it there, then click Solve Sketch"
_NO_STARTER = "Click Solve Sketch once: it builds the starter database"


def _character(context: bpy.types.Context) -> bpy.types.Object:
    """Return the chosen character, or a new one that stands with closed legs.

    In the rest pose the legs are spread and the hips are lower: keys there would make a walk crouch.
    """
    chosen = settings(context)
    if chosen.armature is None:
        skeleton = performer_skeleton(chosen)
        name, rotations = add_character(context, skeleton), hanging(skeleton)
        lowest_m = forward_kinematics(skeleton, rotations, np.zeros(3))[0][:, 1].min()
        up_m = skeleton.rest_positions_m[:, 1].min() - lowest_m
        ArmatureDriver(name, skeleton).apply(rotations, standing_root_m(skeleton) + np.array([0.0, up_m, 0.0]))
    return chosen.armature


def _missing_controls(context: bpy.types.Context) -> str:
    armature = settings(context).armature
    return "" if armature is not None and controls_of(armature) else "Add controls first"


class _SketchOperator(UndoOperator):
    """Base of the operators for a character's sketch."""

    panel = PANEL
    missing_input = need(lambda context: settings(context).armature, "Choose a character")


class _ControlsOperator(_SketchOperator):
    """Base of the operators for a sketch with controls."""

    missing_input = staticmethod(_missing_controls)


class PERFANIM_OT_add_controls(UndoOperator, bpy.types.Operator):
    """Add empties at the character's joints, to be keyed; a missing character is added"""

    bl_label = "Add Controls"
    panel = PANEL
    from_action: switch(
        "Key from Animation",
        "Key the controls where the character's rough action has keys, to make that action natural; "
        "earlier keys of the controls are removed",
    )

    def run(self, context: bpy.types.Context) -> str:
        armature = _character(context)
        joints = armature.perfanim_sketch.chosen_joints
        if not joints:
            raise SettingsError("no control is chosen", advice=_CONTROLS)
        names = add_controls(context, armature, SketchBody.of(armature).space, joints)
        if self.from_action:
            keyed = counted(key_controls(context, armature), "frame")
            return f"{counted(len(controls_of(armature)), 'control')} keyed in {keyed}"
        return f"{counted(len(names), 'control')} added: {_KEY}" if names else f"the chosen controls exist: {_KEY}"


class PERFANIM_OT_follow_rig(_SketchOperator, bpy.types.Operator):
    """Make controls follow the bones of a roughly animated rig.
    This is the selected rig, or else a wire copy of the character with its rough action"""

    bl_label = "Follow Rough Rig"

    def run(self, context: bpy.types.Context) -> str:
        armature = settings(context).armature
        joints = armature.perfanim_sketch.chosen_joints
        if not joints and not controls_of(armature):
            raise SettingsError("no control is chosen", advice=_CONTROLS)
        others = [each for each in context.selected_objects if each.type == "ARMATURE" and each != armature]
        rig = others[0] if others else follow_rig.rough_copy(context, armature)
        selected = list(context.selected_objects)
        add_controls(context, armature, SketchBody.of(armature).space, joints)
        count = follow_rig.follow(armature, rig)
        select_only(context, [rig, *selected])
        following = "1 control follows" if count == 1 else f"{count} controls follow"
        return f"{following} {rig.name}: pose and key its bones, then click Solve Sketch or Live"


class PERFANIM_OT_draw_hips_path(_ControlsOperator, bpy.types.Operator):
    """Draw the hips' path with the mouse: a curve on the floor, seen from above"""

    bl_label = "Draw Hips Path"

    def run(self, context: bpy.types.Context) -> str:
        hips_path.add_path(context, settings(context).armature)
        return "draw with the left mouse button, then click Follow Curve"


class PERFANIM_OT_follow_curve(_ControlsOperator, bpy.types.Operator):
    """Make the selected control, or else the hips, follow the selected curve"""

    bl_label = "Follow Curve"

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        has_curve = any(each.type == "CURVE" for each in context.selected_objects)
        return _missing_controls(context) or ("" if has_curve else "Select a curve, and a control to follow it")

    def run(self, context: bpy.types.Context) -> str:
        armature, selected = settings(context).armature, context.selected_objects
        controls = controls_of(armature)
        path = next(each for each in selected if each.type == "CURVE")
        control = next((each for each in controls.values() if each in selected), controls.get("root"))
        if control is None:
            raise SettingsError("no control is selected", advice="select the control with the curve, or add the hips")
        first, last = hips_path.follow(context, armature, control, path)
        return f"{control.name} follows {path.name} in frames {first} to {last}"


class PERFANIM_OT_take_up_sketch(_SketchOperator, bpy.types.Operator):
    """Restore controls, keys and settings from the sketch that the action was solved from"""

    bl_label = "Restore Sketch"

    def run(self, context: bpy.types.Context) -> str:
        armature = settings(context).armature
        animation, last = armature.animation_data, armature.perfanim_sketch.action
        active = animation.action if animation is not None else None
        action = active if active is not None and STORED in active else last
        sketch, chosen = kept_sketch(action)
        space = SketchBody.of(armature).space
        add_controls(context, armature, space, [control.joint for control in sketch.controls])
        set_keys(armature, sketch, space)
        armature.perfanim_sketch.take_over(chosen)
        armature.perfanim_sketch.free_height = any(each.height_is_free for each in sketch.controls)
        armature.perfanim_sketch.action = action
        return f"{counted(sum(len(each.frames) for each in sketch.controls), 'key')} of {action.name} restored"


class _SolvesSketch(SolvingOperator):
    """Base of Solve Sketch and Bake."""

    bl_options = {"REGISTER", "UNDO"}
    panel = PANEL
    missing_input = staticmethod(_missing_controls)

    def request(self, context: bpy.types.Context) -> SketchRequest:
        armature = settings(context).armature
        body = SketchBody.of(armature)
        self._armature = armature.name
        self._sketch = read_controls(context, armature, body.space)
        self._chosen = armature.perfanim_sketch.solver_settings()
        return SketchRequest(
            skeleton=body.skeleton,
            database=str(readiness.database_path(settings(context))),
            sketch=table_of(self._sketch),
            settings=table_of(self._chosen),
        )

    def bounds(self, context: bpy.types.Context) -> KeyBounds | None:
        """Return the bounds for key reduction; None for those of the result settings."""
        return None

    def on_result(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        solved = solution_from({"number": 0, **summary})
        armature = find_armature(self._armature)
        return write_solution(context, armature, self._sketch, self._chosen, solved, self.bounds(context))


class PERFANIM_OT_solve_sketch(_SolvesSketch, bpy.types.Operator):
    """Solve the whole body from the keyed controls, and put it onto the character"""

    bl_label = "Solve Sketch"
    title = "Solving the sketch"


class PERFANIM_OT_bake_sketch(_SolvesSketch, bpy.types.Operator):
    """Solve into an action with few keys, within the tolerances of Fewer Keys"""

    bl_label = "Bake"
    title = "Baking the sketch"

    def bounds(self, context: bpy.types.Context) -> KeyBounds:
        chosen = context.scene.perfanim_result
        return KeyBounds(chosen.reduce_deg, chosen.reduce_mm)


class PERFANIM_OT_live_sketch(RunningOperator, bpy.types.Operator):
    """Solve again whenever controls, keys or settings change; click again to stop"""

    bl_label = "Live"

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        if live_sketch.current() is not None:
            return ""
        return _missing_controls(context) or (_NO_STARTER if is_starter_missing(context) else "")

    def execute(self, context: bpy.types.Context) -> set[str]:
        if live_sketch.current() is not None:
            live_sketch.current().finish()
            live_sketch.end()
            return {"FINISHED"}
        try:
            chosen = settings(context)
            database = str(readiness.database_path(chosen))
            live_sketch.begin(context, chosen.armature.name, database, preferences.worker_python(context))
        except PerfanimError as error:
            return report_error(self, PANEL, error)
        return {"FINISHED"}


def _behaviours_in(database: Path) -> list[str]:
    """Return the names of a database's behaviours in order, each group with the same first word after that word.

    Raises:
        PerfanimError: The database is damaged.
    """
    names = sorted(filter(None, open_database(database).behaviours))
    return list(dict.fromkeys(each for name in names for each in (name.split()[0], name)))


@lru_cache(maxsize=2)
def _behaviour_items(database: Path, _changed_ns: int) -> list[tuple[str, str, str]]:
    try:
        return [(name, name, "") for name in _behaviours_in(database)]
    except PerfanimError:
        return []


def _listed(context: bpy.types.Context | None) -> list[tuple[str, str, str]]:
    path = readiness.database_path(settings(context or bpy.context))
    return _behaviour_items(path, path.stat().st_mtime_ns) if exists(path) else []


class PERFANIM_OT_add_behaviour(_SketchOperator, bpy.types.Operator):
    """Choose a behaviour of the database to draw from; if none is chosen, all are used"""

    bl_label = "Add Behaviour"
    bl_property = "behaviour"
    behaviour: dynamic_choice("Behaviour", "Behaviour to draw from, and all whose names begin with it", _listed)

    @classmethod
    def missing_input(cls, context: bpy.types.Context) -> str:
        return super().missing_input(context) or (_NO_STARTER if is_starter_missing(context) else "")

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        try:
            _behaviours_in(readiness.database_path(settings(context)))
        except PerfanimError as error:
            return report_error(self, self.panel, error)
        context.window_manager.invoke_search_popup(self)
        return {"FINISHED"}

    def run(self, context: bpy.types.Context) -> None:
        chosen = settings(context).armature.perfanim_sketch
        chosen.behaviours = ", ".join(dict.fromkeys((*chosen.chosen_behaviours, self.behaviour)))


class PERFANIM_OT_remove_behaviour(_SketchOperator, bpy.types.Operator):
    """Stop drawing from this behaviour"""

    bl_label = "Remove Behaviour"
    behaviour: string("Behaviour", "Behaviour to remove")

    def run(self, context: bpy.types.Context) -> None:
        chosen = settings(context).armature.perfanim_sketch
        chosen.behaviours = ", ".join(name for name in chosen.chosen_behaviours if name != self.behaviour)


class PERFANIM_OT_show_motion_paths(_ControlsOperator, bpy.types.Operator):
    """Show or hide Blender's motion paths of the controls, as they are keyed now"""

    bl_label = "Motion Paths"

    def run(self, context: bpy.types.Context) -> None:
        controls: list[Any] = list(controls_of(settings(context).armature).values())
        are_shown = any(each.motion_path is not None for each in controls)
        with context.temp_override(selected_editable_objects=controls, active_object=controls[0], object=controls[0]):
            if are_shown:
                bpy.ops.object.paths_clear(only_selected=True)
            else:
                bpy.ops.object.paths_calculate(display_type="RANGE", range="KEYS_ALL")


register = control_colours.handler.add


def unregister() -> None:
    """End live solving, and remove the colours of controls."""
    live_sketch.end()
    control_colours.handler.remove()
