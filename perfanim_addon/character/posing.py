"""How poses of the performer become those of an armature: straight for the product's own, retargeted for any other."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import bpy
import numpy as np
from numpy.typing import ArrayLike

from ...core.body.skeleton import Skeleton
from ...core.body.standard_skeleton import JOINT_NAMES
from ...core.errors import CharacterError
from ...core.retarget.bone_map import BoneMap, find_bone_map
from ...core.retarget.bone_map_files import read_presets
from ...core.retarget.retargeter import CharacterPose, Retargeter, RootMotion
from ..preferences.paths import user_folder
from .axes import PoseMap
from .bone_map_settings import clear_map, store_map, store_problem, stored_map, stored_root_motion
from .create_character import check_armature, read_rest
from .rig import check_scale, followed_bones, is_constrained, read_armature_rest, switch_to_fk

_SAME_SHARE = 0.003  # of the length of both legs, up to which a bone is as long as the performer's
_LINKED = "make a library override of it (Object > Library Override > Make)"
PRESETS_FOLDER = "bone_maps"  # of the user's


class Posing(Protocol):
    """Turns poses of the performer into bone transforms.

    Args:
        bones: names of the bones that are turned, in the order of `CharacterPose.rotations`.
        located: names of those that are moved, in the order of `CharacterPose.locations`.
    """

    bones: tuple[str, ...]
    located: tuple[str, ...]

    def pose(self, rotations: ArrayLike, root_positions_m: ArrayLike) -> CharacterPose:
        """Return the pose of one frame or of many, as `Retargeter.pose`."""


class ProductPosing:
    """For armatures with the product's bone names: joints are taken as they are.

    Raises:
        CharacterError: bones are missing (named in the message), or its proportions cannot be read.
    """

    def __init__(self, armature_object: bpy.types.Object, skeleton: Skeleton) -> None:
        self.pose_map = PoseMap(skeleton, read_rest(armature_object, skeleton))
        self.bones = skeleton.names
        self.located = skeleton.names[:1]

    def pose(self, rotations: ArrayLike, root_positions_m: ArrayLike) -> CharacterPose:
        """Return the pose."""
        location = self.pose_map.root_location(root_positions_m)
        return CharacterPose(self.pose_map.bone_rotations(rotations), location[..., None, :], None, None)


def find_map(armature_object: bpy.types.Object, presets_folder: Path | None = None) -> BoneMap:
    """Return the bone map of an armature, found anew; presets are the shipped ones and those in a folder.

    Raises:
        CharacterError: it is no biped, or the map cannot be told.
    """
    try:
        return find_bone_map(read_armature_rest(armature_object), read_presets(presets_folder))
    except CharacterError as error:
        raise CharacterError(error.what, where=armature_object.name, advice=error.advice) from error


def fill_map(armature_object: bpy.types.Object) -> None:
    """Find the bone map of an armature and keep it with it, or why there is none; the product's names need none.

    A usable map that is kept already stays: it may have been chosen by hand.
    """
    if armature_object.library is not None:
        return
    if armature_object.perfanim_character.joints and not _problem(armature_object, stored_map):
        return
    if not check_armature(armature_object):
        clear_map(armature_object)
        return
    try:
        store_map(armature_object, find_map(armature_object, user_folder(PRESETS_FOLDER)))
    except CharacterError as error:
        store_problem(armature_object, error.what)


def map_problem(armature_object: bpy.types.Object) -> str:
    """Return why an armature cannot be driven by what is kept with it, "" when it can; quick enough for drawing."""
    if armature_object.library is not None:
        return f"it is linked from another file; {_LINKED}"
    return _problem(armature_object, stored_map) or _problem(armature_object, check_scale)


def _problem(armature_object: bpy.types.Object, check: Callable[[bpy.types.Object], object]) -> str:
    try:
        check(armature_object)
    except CharacterError as error:
        return f"{error.what}; {error.advice}"
    return ""


def _has_proportions(armature_object: bpy.types.Object, skeleton: Skeleton) -> bool:
    """Tell whether an armature has the product's names and the legs of a performer: then the feet need no care."""
    if check_armature(armature_object):
        return False
    heads = read_rest(armature_object, skeleton).heads
    lines = [skeleton.index(side + joint) for side in "lr" for joint in ("tibia", "foot", "toes")]
    above = skeleton.parents[lines]
    mine = np.linalg.norm(heads[lines] - heads[above], axis=-1)
    own = np.linalg.norm(skeleton.offsets_m[lines], axis=-1)
    return bool(np.allclose(mine / np.sum(mine), own / np.sum(own), atol=_SAME_SHARE))


def posing_of(armature_object: bpy.types.Object, skeleton: Skeleton) -> Posing:
    """Return how an armature is posed: by the map that is kept with it, by the product's names, or by a map found.

    Raises:
        CharacterError: it cannot be driven, with the reason.
    """
    if armature_object.library is not None:
        raise CharacterError(
            "is linked from another file and cannot be posed", where=armature_object.name, advice=_LINKED
        )
    kept = stored_map(armature_object)
    root_motion = stored_root_motion(armature_object)
    if kept is None and root_motion is RootMotion.HIPS and _has_proportions(armature_object, skeleton):
        check_scale(armature_object)
        return ProductPosing(armature_object, skeleton)
    bone_map = kept or find_map(armature_object, user_folder(PRESETS_FOLDER))
    return retarget_posing(armature_object, skeleton, bone_map, root_motion)


def bones_of(armature_object: bpy.types.Object) -> dict[str, str]:
    """Return joint -> bone of an armature, as `posing_of` finds them.

    Raises:
        CharacterError: they cannot be told, with the reason.
    """
    kept = stored_map(armature_object)
    if kept is None and not check_armature(armature_object):
        return {joint: joint for joint in JOINT_NAMES}
    return (kept or find_map(armature_object, user_folder(PRESETS_FOLDER))).bones


def retarget_posing(
    armature_object: bpy.types.Object, skeleton: Skeleton, bone_map: BoneMap, root_motion: RootMotion
) -> Retargeter:
    """Return the retargeting onto an armature by a map; inverse kinematics is switched off.

    Raises:
        CharacterError: the armature is stretched or mirrored, constraints hold one of the bones, or the rest pose
            cannot be read.
    """
    check_scale(armature_object)
    armature_object.data.pose_position = "POSE"  # shown in its rest position it would not move
    rest = read_armature_rest(armature_object)
    made = Retargeter(skeleton, rest, bone_map, root_motion)
    _rest_between(armature_object, bone_map.bones["root"], made.bones)
    if is_constrained(armature_object, made.driven):
        switch_to_fk(armature_object, made.driven)
        follows = followed_bones(bpy.context, armature_object, made.driven)
        made = Retargeter(skeleton, rest, bone_map, root_motion, np.asarray(follows))
    return made


def _rest_between(armature_object: bpy.types.Object, hips: str, driven: Sequence[str]) -> None:
    """Bring bones between driven ones to rest: what an earlier action left there would turn all that hangs on them."""
    bones, taken = armature_object.pose.bones, set(driven)
    above = {parent.name for name in driven for parent in bones[name].parent_recursive} - taken
    carriers = {parent.name for parent in bones[hips].parent_recursive}  # they place the character
    for name in above - carriers:
        bones[name].matrix_basis.identity()
