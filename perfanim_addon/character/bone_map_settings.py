"""Bone map stored with an armature object: a bone per joint, and the root motion."""

from collections.abc import Callable
from typing import Any

import bpy

from ...core.body.standard_skeleton import JOINT_NAMES
from ...core.errors import CharacterError
from ...core.retarget.bone_map import BoneMap, JointMatch, MatchState, checked_map
from ...core.retarget.character_fit import Adjustments
from ...core.retarget.retargeter import RootMotion
from ..preferences.property_kinds import HIDDEN, choice, collection, number, string
from .armature_reading import read_armature_rest

_ROOT_MOTIONS = (
    ("HIPS", "Hips", "The hips receive the whole root motion"),
    ("ROOT_BONE", "Root Bone", "The topmost bone above the hips receives the motion along the floor, or else the hips"),
    ("OBJECT", "Object", "The armature object receives the motion along the floor, as its delta transform"),
)


adjusted_listeners: list[Callable[[bpy.types.Object], None]] = []  # called with a character whose adjustments changed


def _adjusted(self: Any, _context: object) -> None:
    """Show the changed adjustments on the character's animation."""
    for listener in adjusted_listeners:
        listener(self.id_data)


def _edited(self: Any, _context: object) -> None:
    """Check the map again after the user has chosen a bone."""
    armature_object = self.id_data
    if not armature_object.perfanim_character.filling:
        check_kept_map(armature_object)


class PERFANIM_PG_joint(bpy.types.PropertyGroup):
    """A joint, named by the property `name`, and its bone."""

    bone: string("Bone", "Bone that stands for this joint; empty for none", update=_edited)
    state: string("MatchState", "How certain the match of joint and bone is")
    reason: string("Reason", "Why the bone is doubtful or missing")


class PERFANIM_PG_character(bpy.types.PropertyGroup):
    """Bone map and root motion of an armature."""

    attached_to = (bpy.types.Object, "perfanim_character")
    joints: collection("Joints", "Which bone stands for which joint", PERFANIM_PG_joint)
    active: bpy.props.IntProperty(name="Joint", description="Joint to choose a bone for")
    origin: string("Origin", "How the bones were found")
    problem: string("Problem", "Why the armature cannot be driven")
    filling: bpy.props.BoolProperty(options=HIDDEN)
    root_motion: choice("Root Motion", "Bone or object that receives the root motion", _ROOT_MOTIONS)
    hip_height: number(
        "Hip Height (mm)", "Height added to the hips; the feet stay on the floor", 0.0, -300.0, 300.0, update=_adjusted
    )
    shoulder: number("Shoulders (°)", "Angle by which the shoulders are raised", 0.0, -30.0, 30.0, update=_adjusted)
    arm_spread: number(
        "Arm Spread (°)", "Angle by which the arms are moved away from the body", 0.0, -45.0, 45.0, update=_adjusted
    )
    foot_pitch: number(
        "Foot Pitch (°)",
        "Angle by which the toes are raised; the soles stay on the floor",
        0.0,
        -30.0,
        30.0,
        update=_adjusted,
    )


def store_map(armature_object: bpy.types.Object, found: BoneMap) -> None:
    """Store a map with an armature object."""
    kept = armature_object.perfanim_character
    kept.filling = True
    kept.joints.clear()
    for joint in JOINT_NAMES:
        entry = kept.joints.add()
        match = found.matches[joint]
        entry.name, entry.bone, entry.state, entry.reason = joint, match.bone, match.state.value, match.reason
    kept.origin, kept.problem = found.origin, ""
    kept.filling = False


def store_problem(armature_object: bpy.types.Object, problem: str) -> None:
    """Store an empty map, to be filled in by hand, and the reason why no map was found."""
    missing = {joint: JointMatch("", MatchState.MISSING) for joint in JOINT_NAMES}
    store_map(armature_object, BoneMap(missing, ""))
    armature_object.perfanim_character.problem = problem


def clear_map(armature_object: bpy.types.Object) -> None:
    """Remove the map stored with an armature."""
    kept = armature_object.perfanim_character
    kept.joints.clear()
    kept.problem = ""


def check_kept_map(armature_object: bpy.types.Object) -> None:
    """Check the stored map again: the state of each joint, or the problem."""
    kept = armature_object.perfanim_character
    bones = {entry.name: entry.bone for entry in kept.joints if entry.bone}
    try:
        store_map(armature_object, checked_map(read_armature_rest(armature_object), bones, "chosen by hand"))
    except CharacterError as error:
        kept.problem = error.what


def stored_map(armature_object: bpy.types.Object) -> BoneMap | None:
    """Return the map stored with an armature, or None if there is none; CharacterError if it cannot be used."""
    kept = getattr(armature_object, "perfanim_character", None)
    if kept is None:
        return None
    if kept.problem:
        raise CharacterError(
            kept.problem, where=armature_object.name, advice="choose its bones, or another armature, under Character"
        )
    if not kept.joints:
        return None
    missing = [e.bone for e in kept.joints if e.bone and e.bone not in armature_object.data.bones]
    if missing:
        raise CharacterError(
            "its bone map names bones that it no longer has: " + ", ".join(missing[:4]),
            where=armature_object.name,
            advice="click Find Bones under Character",
        )
    matches = {e.name: JointMatch(e.bone, MatchState(e.state), e.reason) for e in kept.joints}
    return BoneMap(matches, kept.origin)


def stored_adjustments(armature_object: bpy.types.Object) -> Adjustments:
    """Return the corrections that are kept with a character."""
    kept = getattr(armature_object, "perfanim_character", None)
    if kept is None:
        return Adjustments()
    return Adjustments(0.001 * kept.hip_height, kept.shoulder, kept.arm_spread, kept.foot_pitch)


def stored_root_motion(armature_object: bpy.types.Object) -> RootMotion:
    """Return the bone or object that receives a character's root motion."""
    kept = getattr(armature_object, "perfanim_character", None)
    return RootMotion.HIPS if kept is None else RootMotion[kept.root_motion]
