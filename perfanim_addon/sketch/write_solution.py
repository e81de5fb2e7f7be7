"""Solved sketches as actions, and the sketch that stays with its action."""

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...core.body.skeleton import Skeleton
from ...core.body.standard_skeleton import JOINT_NAMES
from ...core.errors import CharacterError, SettingsError
from ...core.sketch.sketch_file import Sketch
from ...core.sketch.sketch_messages import SolvedSketch, settings_from, settings_table, sketch_from, sketch_table
from ...core.sketch.solve_sketch import SketchSettings
from ...core.system.files import reading
from ..animation.actions import write_action
from ..animation.keyframes import KeyBounds
from ..capture.capture_space import CaptureSpace
from ..character.bone_map_settings import joint_label
from ..character.part_bones import bones_of_parts
from ..character.posing import plan_for
from ..settings.capture_settings import settings
from ..settings.result_settings import placement
from .controls import STORED
from .own_skeleton import own_skeleton

_LISTED = 3  # unmet keys in the panel


@dataclass(frozen=True)
class SketchBody:
    """A character's own skeleton, and its place in the scene."""

    skeleton: Skeleton
    space: CaptureSpace

    @classmethod
    def of(cls, armature_object: bpy.types.Object) -> "SketchBody":
        """Return a character's; CharacterError for one that cannot be driven."""
        skeleton = own_skeleton(armature_object)
        return cls(skeleton, CaptureSpace(armature_object, plan_for(armature_object, skeleton)))


def write_solution(
    context: bpy.types.Context,
    armature_object: bpy.types.Object,
    sketch: Sketch,
    chosen: SketchSettings,
    solved: SolvedSketch,
    bounds: KeyBounds | None = None,
    ends_only: bool = False,
) -> str:
    """Write a solved sketch as an action of its character; return the line to show.

    Args:
        chosen: settings that it was solved with.
        bounds: of the reduction of keys; None as the settings of results have it.
        ends_only: key only the first and the last frame: `refill_action` does the rest in pieces.

    Raises:
        CharacterError: the character cannot be animated.
    """
    skeleton = own_skeleton(armature_object)
    only = bones_of_parts(armature_object, plan_for(armature_object, skeleton), settings(context).body_parts)
    how = placement(context, armature_object, only)
    how = replace(how, bounds=bounds) if bounds is not None else how
    rows = np.unique((0, len(sketch.frames) - 1)) if ends_only else slice(None)
    name = write_action(
        armature_object.name,
        sketch.frames[rows],
        solved.rotations[rows],
        solved.root_positions_m[rows],
        skeleton,
        name=f"{armature_object.name} sketch",
        placement=how,
    )
    action = bpy.data.actions[name]
    keep_sketch(action, sketch, chosen)
    armature_object.perfanim_sketch.action = action
    if settings(context).extend_scene:
        context.scene.frame_end = max(context.scene.frame_end, int(np.ceil(sketch.frames[-1])))
    return f"{len(sketch.frames)} frames in {name}; {outcome_text(solved)}"


def keep_sketch(action: bpy.types.Action, sketch: Sketch, chosen: SketchSettings) -> None:
    """Store a sketch and its settings with an action."""
    action[STORED] = json.dumps({"sketch": sketch_table(sketch), "settings": settings_table(chosen)})


def kept_sketch(action: bpy.types.Action | None) -> tuple[Sketch, SketchSettings]:
    """Return the sketch and settings of an action.

    Raises:
        CharacterError: the action has none.
        SettingsError: it is damaged.
    """
    if action is None or STORED not in action:
        advice = "choose an action that Solve Sketch has made, in the Action editor"
        raise CharacterError("the character's action has no sketch", advice=advice)
    with reading(action.name, SettingsError, "add the controls again", "the sketch of the action is damaged"):
        table = json.loads(action[STORED])
        return sketch_from(table["sketch"]), settings_from(table["settings"])


def outcome_text(solved: SolvedSketch) -> str:
    """Return the unmet keys in plain words, else the clips that it is drawn from."""
    if not solved.unmet:
        drawn = list(dict.fromkeys(solved.drawn_from))
        more = f" and {len(drawn) - _LISTED} more" if len(drawn) > _LISTED else ""
        return f"all keys are met; drawn from {', '.join(drawn[:_LISTED])}{more}"
    farthest = sorted(solved.unmet, key=lambda key: -key[2])
    texts = [
        f"{joint_label(j)} in frame {frame} is {_length(m)} off ({_in_words(why)})" for j, frame, m, why in farthest
    ]
    more = f"; and {len(texts) - _LISTED} more" if len(texts) > _LISTED else ""
    count = len(texts)
    return f"{count} key{'s are' if count > 1 else ' is'} not met: {'; '.join(texts[:_LISTED])}{more}"


def _in_words(reason: str) -> str:
    """Return the solver's reason with the labels of joints."""
    return re.sub(rf"\b({'|'.join(JOINT_NAMES)})\b", lambda found: joint_label(found[0]), reason)


def _length(metres: float) -> str:
    return f"{metres:.1f} m" if metres >= 1.0 else f"{100.0 * metres:.1f} cm"


def joints_of(sketch: Sketch) -> Iterable[str]:
    """Return the joints with controls in a sketch."""
    return [control.joint for control in sketch.controls]
