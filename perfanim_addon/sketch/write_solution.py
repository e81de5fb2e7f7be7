"""Solved sketches written as actions; each action stores its sketch."""

import json
import re
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...core.body.skeleton import Skeleton
from ...core.body.standard_skeleton import JOINT_NAMES, joint_label
from ...core.errors import CharacterError, SettingsError, counted
from ...core.sketch.sketch_file import Sketch
from ...core.sketch.sketch_messages import SolvedSketch, settings_from, sketch_from
from ...core.sketch.solve_sketch import SketchSettings
from ...core.system.files import reading
from ...core.system.schema import table_of
from ..animation.actions import write_action
from ..animation.keyframes import KeyBounds
from ..capture.capture_space import CaptureSpace
from ..character.own_body import own_skeleton
from ..character.part_bones import bones_of_parts
from ..character.retarget_plans import plan_for
from ..settings.capture_settings import settings
from ..settings.result_settings import placement
from .controls import EDITING, STORED


@dataclass(frozen=True)
class SketchBody:
    """A character's own skeleton and capture space."""

    skeleton: Skeleton
    space: CaptureSpace

    @classmethod
    def of(cls, armature_object: bpy.types.Object) -> "SketchBody":
        """Return the skeleton and space of a character; CharacterError if it cannot be driven."""
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
        chosen: Settings of the solver.
        bounds: Bounds for key reduction; None for those of the result settings.
        ends_only: Key only the first and last frame; `refill_action` keys the rest step by step.

    Raises:
        CharacterError: The character cannot be animated.
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
    return f"{counted(len(sketch.frames), 'frame')} in {name}; {outcome_text(solved)}"


def keep_sketch(action: bpy.types.Action, sketch: Sketch, chosen: SketchSettings) -> None:
    """Store a sketch and its settings with an action."""
    action[STORED] = json.dumps({"sketch": table_of(sketch), "settings": table_of(chosen)})


def kept_sketch(action: bpy.types.Action | None) -> tuple[Sketch, SketchSettings]:
    """Return the sketch and settings of an action; CharacterError if it has none, SettingsError if they are damaged."""
    if action is None or STORED not in action:
        advice = "in the Action Editor, choose an action made by Solve Sketch"
        raise CharacterError("the character's action has no sketch", advice=advice)
    with reading(action.name, SettingsError, "add the controls again", "the sketch of the action is damaged"):
        table = json.loads(action[STORED])
        return sketch_from(table["sketch"]), settings_from(table["settings"])


def outcome_text(solved: SolvedSketch) -> str:
    """Return a sentence that lists the unmet keys, or else the clips that the motion is drawn from."""
    count, listed = len(solved.unmet), EDITING.listed
    if not count:
        drawn = list(dict.fromkeys(solved.drawn_from))
        more = f" and {len(drawn) - listed} more" if len(drawn) > listed else ""
        return f"all keys are met; drawn from {', '.join(drawn[:listed])}{more}"
    texts = []
    for joint, frame, off_m, reason in sorted(solved.unmet, key=lambda key: -key[2])[:listed]:
        off = f"{off_m:.1f} m" if off_m >= 1.0 else f"{100.0 * off_m:.1f} cm"
        why = re.sub(rf"\b({'|'.join(JOINT_NAMES)})\b", lambda found: joint_label(found[0]), reason)
        texts.append(f"{joint_label(joint)} in frame {frame} is {off} off ({why})")
    more = f"; and {count - listed} more" if count > listed else ""
    return f"{count} key{'s are' if count > 1 else ' is'} not met: {'; '.join(texts)}{more}"
