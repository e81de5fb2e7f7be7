"""Retarget plans for Blender's armatures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ...core.body.skeleton import Skeleton
from ...core.errors import CharacterError
from ...core.retarget.armature_rest import ArmatureRest
from ...core.retarget.bone_map import BoneMap, find_bone_map
from ...core.retarget.bone_map_files import read_presets
from ...core.retarget.character_fit import Adjustments, CharacterFit
from ...core.retarget.retargeter import RetargetPlan, RootMotion, plan_retarget
from ..preferences.paths import user_folder
from .armature_reading import LIMITS, check_scale, followed_bones, is_constrained, read_armature_rest, switch_to_fk
from .bone_map_settings import (
    clear_map,
    store_map,
    store_problem,
    stored_adjustments,
    stored_map,
    stored_root_motion,
)
from .create_character import own_map
from .foot_skin import foot_skins

_LINKED = "make a library override of it (Object > Library Override > Make)"
PRESETS_FOLDER = "bone_maps"  # user folder


def find_map(armature_object: bpy.types.Object, presets_folder: Path | None = None) -> BoneMap:
    """Find the bone map of an armature, using shipped presets and those in a folder; CharacterError if none fits."""
    try:
        return find_bone_map(read_armature_rest(armature_object), read_presets(presets_folder))
    except CharacterError as error:
        raise CharacterError(error.what, where=armature_object.name, advice=error.advice) from error


def fill_map(armature_object: bpy.types.Object) -> None:
    """Find and store the bone map of an armature, or store the problem.

    A usable stored map is kept, because it may have been chosen by hand.
    """
    if armature_object.library is not None:
        return
    if armature_object.perfanim_character.joints and not _problem(armature_object, stored_map):
        return
    if own_map(armature_object) is not None:
        clear_map(armature_object)
        return
    try:
        store_map(armature_object, find_map(armature_object, user_folder(PRESETS_FOLDER)))
    except CharacterError as error:
        store_problem(armature_object, error.what)


def map_problem(armature_object: bpy.types.Object) -> str:
    """Return the reason why an armature cannot be driven, or ""; fast enough for drawing."""
    if armature_object.library is not None:
        return f"it is linked from another file; {_LINKED}"
    if not armature_object.users_scene:
        return "it was deleted from the scene; choose another, or none for a new character"
    return _problem(armature_object, stored_map) or _problem(armature_object, check_scale)


def _problem(armature_object: bpy.types.Object, check: Callable[[bpy.types.Object], object]) -> str:
    try:
        check(armature_object)
    except CharacterError as error:
        return f"{error.what}; {error.advice}"
    return ""


def _has_proportions(rest: ArmatureRest, own: BoneMap, skeleton: Skeleton) -> bool:
    """Return whether a new character has the performer's leg proportions."""
    heads = rest.heads[[rest.index[own.bones[name]] for name in skeleton.names]]
    lines = [skeleton.index(side + joint) for side in "lr" for joint in ("tibia", "foot", "toes")]
    above = skeleton.parents[lines]
    mine = np.linalg.norm(heads[lines] - heads[above], axis=-1)
    own = np.linalg.norm(skeleton.offsets_m[lines], axis=-1)
    return bool(np.allclose(mine / np.sum(mine), own / np.sum(own), atol=LIMITS.same_share))


def plan_for(armature_object: bpy.types.Object, skeleton: Skeleton) -> RetargetPlan:
    """Plan the retargeting to an armature with its stored map or a found one; CharacterError if it cannot be driven."""
    if armature_object.library is not None:
        raise CharacterError(
            "is linked from another file and cannot be posed", where=armature_object.name, advice=_LINKED
        )
    kept = stored_map(armature_object)
    root_motion = stored_root_motion(armature_object)
    if kept is None and root_motion is RootMotion.HIPS:
        rest, own = read_armature_rest(armature_object), own_map(armature_object)
        if own and _has_proportions(rest, own, skeleton) and stored_adjustments(armature_object) == Adjustments():
            check_scale(armature_object)
            return plan_retarget(skeleton, rest, own, same_body=True)
    return plan_with_map(armature_object, skeleton, map_of(armature_object), root_motion)


def map_of(armature_object: bpy.types.Object) -> BoneMap:
    """Return the bone map of an armature: the stored one, or else one that is found; CharacterError without a map."""
    known = stored_map(armature_object) or own_map(armature_object)
    return known or find_map(armature_object, user_folder(PRESETS_FOLDER))


def character_fit(armature_object: bpy.types.Object, rest: ArmatureRest, bones: Mapping[str, str]) -> CharacterFit:
    """Return the skin of a character's feet and its corrections."""
    return CharacterFit(foot_skins(armature_object, rest, bones), stored_adjustments(armature_object))


def bones_of(armature_object: bpy.types.Object) -> dict[str, str]:
    """Return joint -> bone of an armature, using the same maps as `plan_for`; CharacterError without a map."""
    return map_of(armature_object).bones


def plan_with_map(
    armature_object: bpy.types.Object,
    skeleton: Skeleton,
    bone_map: BoneMap,
    root_motion: RootMotion,
    adjustments: Adjustments | None = None,
) -> RetargetPlan:
    """Plan the retargeting to an armature with a map, and switch its IK off; CharacterError if it cannot be driven.

    Args:
        adjustments: Corrections of each pose; None for those kept with the character.
    """
    check_scale(armature_object)
    armature_object.data.pose_position = "POSE"  # in Rest Position it would not move
    rest = read_armature_rest(armature_object)
    fit = character_fit(armature_object, rest, bone_map.bones)
    fit = fit if adjustments is None else replace(fit, adjustments=adjustments)
    plan = plan_retarget(skeleton, rest, bone_map, root_motion, fit=fit)
    _rest_between(armature_object, bone_map.bones["root"], plan.bones)
    if is_constrained(armature_object, plan.driven):
        switch_to_fk(armature_object, plan.driven)
        follows = followed_bones(bpy.context, armature_object, plan.driven)
        plan = plan_retarget(skeleton, rest, bone_map, root_motion, np.asarray(follows), fit=fit)
    return plan


def _rest_between(armature_object: bpy.types.Object, hips: str, driven: Sequence[str]) -> None:
    """Reset the bones between driven ones, which earlier actions may have posed."""
    bones, taken = armature_object.pose.bones, set(driven)
    above = {parent.name for name in driven for parent in bones[name].parent_recursive} - taken
    carriers = {parent.name for parent in bones[hips].parent_recursive}  # these place the character and keep their pose
    for name in above - carriers:
        bones[name].matrix_basis.identity()
