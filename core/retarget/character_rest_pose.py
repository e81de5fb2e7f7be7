"""Alignment of a character's rest pose with the standard rest pose: facing, size, limbs.

Trunk, clavicles, neck and head are upright in any rest pose and keep the character's own shape. Soles are flat, so feet
are turned about the vertical, and tilted like those of the standard rest pose, whose legs are spread. Hands are also
turned about the forearm until the palms face down.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..body.skeleton import Skeleton
from ..body.soles import upright_foot
from ..errors import CharacterError
from ..geometry import rotations as rot
from ..geometry.arrays import Array
from .armature_rest import ArmatureRest
from .bone_name_parser import parse_bone_name
from .character_fit import PLAIN_FIT, CharacterFit
from .limb_detection import cosine
from .rest_alignment import ABOVE, BONE_ENDS, bone_end, facing, limb_turns, up_and_left

_HAND_ABOVE = ("hand", "wrist", "radius")  # joints that fingers and thumb follow


@dataclass(frozen=True)
class RestAlignment:
    """A character's rest pose in world axes, with the performer's leg length.

    Args:
        armature_from_world: Rotation (3, 3).
        units_per_metre: Armature units per metre of the performer, from the lengths of the legs.
        heads_m: Bone heads (B, 3) in world axes, in the performer's metres.
        turns: Joint -> rotation (4,) of its bone from the character's rest pose to the standard one.
    """

    armature_from_world: Array
    units_per_metre: float
    heads_m: Array
    turns: dict[str, Array]


def align_character(
    skeleton: Skeleton,
    rest: ArmatureRest,
    joints: Mapping[str, int],
    same_body: bool = False,
    fit: CharacterFit = PLAIN_FIT,
) -> RestAlignment:
    """Return the alignment of a character's rest pose with the standard one.

    Args:
        joints: Joint -> bone index, at least for hips, thighs and upper arms.
        same_body: The character has the performer's proportions: hands follow the forearms, feet keep their direction.
        fit: Its skin shows whether the feet of spread legs are flat; its foot pitch raises the toes.

    Raises:
        CharacterError: Left and right are unclear, or the legs have no length.
    """
    up, left = up_and_left(rest.heads, joints)
    frame = facing(left, up)
    scale = _leg_lengths(skeleton, rest, joints)
    heads = rest.heads @ frame / scale
    tails = rest.tails @ frame / scale
    pitch = rot.from_rotation_vector(np.radians([-fit.adjustments.foot_pitch_deg, 0.0, 0.0]))
    feet = {}
    for side in "" if same_body else "lr":
        if side + "foot" in joints:
            skin_m = fit.skins[side].points @ frame / scale if side in fit.skins else np.empty((0, 3))
            levelling = _levelling(joints, heads, side, skin_m)
            feet[side + "foot"] = _foot_turn(skeleton, joints, heads, side, pitch, levelling)
    turns = _turns(skeleton, rest, joints, heads, tails, feet, same_body)
    return RestAlignment(frame, scale, heads, turns)


def _leg_lengths(skeleton: Skeleton, rest: ArmatureRest, joints: Mapping[str, int]) -> float:
    """Return armature units per metre, the ratio of leg lengths."""
    character, own = 0.0, 0.0
    for side, (upper, lower) in product("lr", (("femur", "tibia"), ("tibia", "foot"))):
        if side + upper in joints and side + lower in joints:
            character += float(np.linalg.norm(rest.heads[joints[side + lower]] - rest.heads[joints[side + upper]]))
            own += float(np.linalg.norm(skeleton.offsets_m[skeleton.index(side + lower)]))
    if character <= 0.0 or own <= 0.0:
        raise CharacterError("the legs have no length", advice="check the bones chosen for shins and feet")
    return character / own


def _turns(
    skeleton: Skeleton,
    rest: ArmatureRest,
    joints: Mapping[str, int],
    heads: Array,
    tails: Array,
    feet: Mapping[str, Array],
    same_body: bool,
) -> dict[str, Array]:
    names = [name for name in skeleton.names if name in joints]
    followed = {**ABOVE, "toes": ("foot",), "fingers": _HAND_ABOVE, "thumb": _HAND_ABOVE}
    directions: dict[str, Array] = {}
    for name in names:
        if name[1:] in BONE_ENDS and not (same_body and name[1:] == "hand"):
            direction = bone_direction(name, rest, joints, heads, tails)
            if direction is not None:
                directions[name] = direction
    wanted = {name: _wanted(skeleton, name, joints) for name in directions}
    turns = limb_turns(names, directions, wanted, followed, feet)
    for side in () if same_body else "lr":
        _face_palm_down(skeleton, rest, joints, heads, turns, side)
    return turns


def _wanted(skeleton: Skeleton, name: str, joints: Mapping[str, int]) -> Array:
    """Return the vector from a joint to the end of its bone in the standard rest pose."""
    end = bone_end(name, {joint: bone for joint, bone in joints.items() if joint in skeleton.names})
    positions = skeleton.rest_positions_m
    joint = skeleton.index(name)
    return positions[skeleton.index(end)] - positions[joint] if end is not None else skeleton.tips_m[joint]


def bone_direction(
    name: str, rest: ArmatureRest, joints: Mapping[str, int], heads: Array, tails: Array
) -> Array | None:
    """Return the direction of a limb's bone at rest, or None if unknown.

    The tail of the last bone, which importers guess, is used if it roughly continues the previous bone.
    """
    side, kind, bone = name[0], name[1:], joints[name]
    end = bone_end(name, joints)
    if end is not None:
        way = heads[joints[end]] - heads[bone]
        return way if float(np.linalg.norm(way)) > 1e-6 else None
    above = next((joints[side + j] for j in ABOVE.get(kind, ()) if side + j in joints), None)
    way = tails[bone] - heads[bone]
    if above is None or cosine(way, heads[bone] - heads[above]) > 0.5:
        return way
    return None


def _levelling(joints: Mapping[str, int], heads: Array, side: str, skin_m: Array) -> Array:
    """Return the rotation (4,) that makes a foot at rest flat: none, or that which makes the leg upright.

    Args:
        skin_m: Points (P, 3) of the foot's mesh. The flat foot is the one whose ankle is nearer to its lowest point.
    """
    ankle = heads[joints[side + "foot"]]
    leg = ankle - heads[joints[side + "femur"]]
    if len(skin_m) == 0:
        return rot.identity()
    ways = (rot.identity(), rot.between([leg[0], leg[1], 0.0], [0.0, -1.0, 0.0]))
    lowest = [float(np.min(rot.rotate(way, skin_m - ankle)[:, 1])) for way in ways]
    return ways[int(np.argmax(lowest))]


def _foot_turn(
    skeleton: Skeleton, joints: Mapping[str, int], heads: Array, side: str, pitch: Array, levelling: Array
) -> Array:
    """Return the rotation from the character's foot to the tilted one of the standard rest pose."""
    upright = upright_foot(skeleton, side)
    turn = rot.multiply(rot.conjugate(upright), pitch)
    if side + "toes" not in joints:
        return rot.multiply(turn, levelling)
    way = rot.rotate(levelling, heads[joints[side + "toes"]] - heads[joints[side + "foot"]])
    wanted = rot.rotate(upright, skeleton.offsets_m[skeleton.index(side + "toes")])
    angle = np.arctan2(wanted[0], wanted[2]) - np.arctan2(way[0], way[2])
    return rot.multiply(rot.multiply(turn, rot.from_rotation_vector(np.array([0.0, angle, 0.0]))), levelling)


def _face_palm_down(
    skeleton: Skeleton, rest: ArmatureRest, joints: Mapping[str, int], heads: Array, turns: dict[str, Array], side: str
) -> None:
    """Turn the hand, by at most 110 degrees, until the thumb faces forward, and the forearm by half as much."""
    hand = side + "hand"
    if hand not in joints:
        return
    across = across_hand(rest, joints, heads, side)
    if across is None:
        return
    along = _wanted(skeleton, hand, joints)
    along = along / np.linalg.norm(along)
    across = rot.rotate(turns[hand], across)
    across = across - along * float(across @ along)
    forward = np.array([0.0, 0.0, 1.0]) - along * along[2]
    angle = float(np.arctan2(np.cross(across, forward) @ along, across @ forward))
    if float(np.linalg.norm(across)) < 1e-6 or abs(angle) > np.radians(110.0):
        return
    for joint, share in ((hand, 1.0), (side + "fingers", 1.0), (side + "thumb", 1.0), (side + "radius", 0.5)):
        if joint in turns:
            turns[joint] = rot.multiply(rot.from_rotation_vector(share * angle * along), turns[joint])


def across_hand(rest: ArmatureRest, joints: Mapping[str, int], heads: Array, side: str) -> Array | None:
    """Return the direction across the palm towards the thumb, or None if there are no fingers."""
    index, little = (_knuckle(rest, joints[side + "hand"], side, words) for words in (("index",), ("pinky", "little")))
    if index >= 0 and little >= 0:
        return heads[index] - heads[little]
    if side + "thumb" in joints:
        return heads[joints[side + "thumb"]] - heads[joints[side + "hand"]]
    return None


def _knuckle(rest: ArmatureRest, hand: int, side: str, words: tuple[str, ...]) -> int:
    """Return the first bone below the hand with one of the words in its name, or -1 if there is none."""
    return next(
        (
            bone
            for bone in range(hand + 1, len(rest))
            if any(word in parse_bone_name(rest.names[bone]).words for word in words)
            and parse_bone_name(rest.names[bone]).side in (side, "")
            and rest.is_above(hand, bone)
        ),
        -1,
    )
