"""Bone map of an armature, found by a preset, by names or by shape, and checked.

A limb is found by its names if they are complete and agree with the hierarchy, otherwise by its shape. Trunk and neck
are found by the hierarchy between hips, arms and head, because rigs have any number of bones there.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

import numpy as np

from ..body.standard_skeleton import JOINT_NAMES, joint_label
from ..errors import CharacterError
from .armature_rest import ArmatureRest
from .bone_name_parser import LIMB_WORDS
from .displayed_joint_names import BLENDER, OWN, naming_of
from .joint_matching import match_names, match_trunk
from .limb_detection import Limbs, arm_joints, check_upright, cosine, find_limbs, leg_joints
from .rest_alignment import up_and_left

NEEDED = ("root", "lfemur", "rfemur", "lhumerus", "rhumerus")  # these show the character's up and left directions
EXPECTED = (
    *NEEDED, "ltibia", "rtibia", "lfoot", "rfoot", "lradius", "rradius", "thorax", "head",
)  # fmt: skip


class MatchState(Enum):
    """State of a joint's bone; the values appear in reports."""

    MAPPED = "mapped"
    MISSING = "missing"
    SUSPECT = "doubtful"


@dataclass(frozen=True)
class JointMatch:
    """Bone of one joint, "" if it is missing, its state, and the reason for the state in words."""

    bone: str
    state: MatchState
    reason: str = ""


@dataclass(frozen=True)
class BoneMap:
    """Bones of the standard skeleton's joints in an armature.

    Args:
        matches: Match for every name of `JOINT_NAMES`.
        origin: Source of the map: a preset's name, "names", "names and shape" or "shape".
    """

    matches: Mapping[str, JointMatch]
    origin: str

    @property
    def bones(self) -> dict[str, str]:
        """Joint -> bone, for all joints that have one."""
        return {joint: match.bone for joint, match in self.matches.items() if match.bone}

    def of_state(self, state: MatchState) -> list[str]:
        """Return the joints in a state."""
        return [joint for joint, match in self.matches.items() if match.state is state]

    @property
    def complete(self) -> bool:
        """Whether all joints of a humanoid are mapped and none is suspect."""
        expected = all(self.matches[joint].state is MatchState.MAPPED for joint in EXPECTED)
        return expected and not self.of_state(MatchState.SUSPECT)


def own_bone_map(bones: Collection[str]) -> BoneMap | None:
    """Return the map of a new character with these bones, or None if they are not those of a new character.

    Characters of early versions have the names of the standard joints.
    """
    for naming in (BLENDER, OWN):
        names = naming_of(naming)
        if set(names.values()) <= set(bones):
            return BoneMap({joint: JointMatch(name, MatchState.MAPPED) for joint, name in names.items()}, "names")
    return None


def find_bone_map(rest: ArmatureRest, presets: Mapping[str, Mapping[str, str]] | None = None) -> BoneMap:
    """Return the map of an armature.

    Args:
        presets: Name -> joint -> bone; the first that matches completely is used.

    Raises:
        CharacterError: The armature is not a biped, or arms, legs or hips are not found.
    """
    for name, preset in (presets or {}).items():
        if (bones := _fitting(rest, preset)) is not None:
            return checked_map(rest, bones, name)
    found, by_name = match_names(rest)
    limbs = find_limbs(rest) if not all(by_name.values()) else None
    if limbs is not None:
        _fill_limbs(rest, found, by_name, limbs)
    origin = "names" if all(by_name.values()) else "names and shape" if any(by_name.values()) else "shape"
    missing = [joint for joint in NEEDED if joint not in found and joint != "root"]
    if missing:
        raise CharacterError(
            "the armature is not recognised as a biped: neither names nor shape reveal " + _listed(missing),
            advice="choose these bones by hand, or another armature",
        )
    _shift_if_named_by_ends(rest, found)
    if not match_trunk(rest, found):
        raise CharacterError("arms and legs have no common parent bone", advice="choose the hips by hand")
    swapped = _swap_sides_if_backwards(rest, found)
    return checked_map(rest, {joint: rest.names[bone] for joint, bone in found.items()}, origin, swapped)


def checked_map(rest: ArmatureRest, bones: Mapping[str, str], origin: str, swapped: bool = False) -> BoneMap:
    """Return the map of chosen bones with the state of each joint.

    Raises:
        CharacterError: A bone does not exist, a required one is not given, or the armature is not a biped.
    """
    unknown = [bone for bone in bones.values() if bone not in rest.index]
    if unknown:
        raise CharacterError("the armature has no bone " + _listed(unknown), advice="choose another map or bones")
    lacking = [joint for joint in NEEDED if joint not in bones]
    if lacking:
        raise CharacterError(
            "no bone is given for " + _listed([joint_label(joint) for joint in lacking]),
            advice="choose a bone for each",
        )
    found = {joint: rest.index[bone] for joint, bone in bones.items()}
    _check_biped(rest, found)
    suspect = _suspect_joints(rest, found)
    matches = {}
    for joint in JOINT_NAMES:
        if joint not in found:
            matches[joint] = JointMatch("", MatchState.MISSING, _why_missing(joint, found))
        elif joint in suspect:
            matches[joint] = JointMatch(bones[joint], MatchState.SUSPECT, suspect[joint])
        else:
            side = "named for the other side, but the feet show the front" if swapped and joint[0] in "lr" else ""
            matches[joint] = JointMatch(bones[joint], MatchState.MAPPED, side if joint[1:] in LIMB_WORDS else "")
    return BoneMap(matches, origin)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def _fitting(rest: ArmatureRest, preset: Mapping[str, str]) -> dict[str, str] | None:
    """Return a preset's bones in this armature, or None if bones other than fingers, thumbs and toes are missing."""
    bare = {name.split(":")[-1]: name for name in reversed(rest.names)}
    bones = {}
    for joint, bone in preset.items():
        name = bone if bone in rest.index else bare.get(bone.split(":")[-1])
        if name is not None:
            bones[joint] = name
        elif joint[1:] not in ("fingers", "thumb", "toes"):
            return None
    return bones


def _fill_limbs(rest: ArmatureRest, found: dict[str, int], by_name: dict[str, bool], limbs: Limbs) -> None:
    """Replace limbs not completely found by name, with their hands and toes, by those found by shape."""
    for kind, chains, find_joints, joints in (
        ("leg", limbs.legs, leg_joints, ("femur", "tibia", "foot", "toes")),
        ("arm", limbs.arms, arm_joints, ("clavicle", "humerus", "radius", "wrist", "hand", "fingers", "thumb")),
    ):
        if by_name["l" + kind] and by_name["r" + kind]:
            continue
        for side in "lr":
            for joint in joints:
                found.pop(side + joint, None)
            found |= {side + joint: bone for joint, bone in find_joints(rest, chains[side]).items()}


def _shift_if_named_by_ends(rest: ArmatureRest, found: dict[str, int]) -> None:
    """Move limbs one bone outwards in rigs whose bones are named after the joint at their end."""
    size = float(np.max(np.ptp(rest.heads, axis=0)))
    chains: tuple[tuple[str, ...], ...] = (("femur", "tibia", "foot", "toes"), ("humerus", "radius", "hand", "fingers"))
    for chain in chains:
        starts = [rest.heads[found[side + chain[0]]] for side in "lr"]
        if float(np.linalg.norm(starts[0] - starts[1])) > 0.02 * size:  # the limbs start apart, as they should
            continue
        for side in "lr":
            bones = [found.get(side + joint, -1) for joint in chain] + [-1]
            if chain[0] == "humerus":
                found.setdefault(side + "clavicle", bones[0])
            for joint, bone in zip(chain, bones[1:], strict=True):
                found.pop(side + joint, None)
                if bone >= 0:
                    found[side + joint] = bone


def _swap_sides_if_backwards(rest: ArmatureRest, found: dict[str, int]) -> bool:
    """Swap the sides of rigs named from the viewer's side, whose feet would point backwards."""
    up, left = up_and_left(rest.heads, found)
    front = np.cross(left, up)
    agreement = []
    for side in "lr":
        if side + "foot" not in found:
            return False
        foot = found[side + "foot"]
        toes = found.get(side + "toes", -1)
        way = (rest.heads[toes] if toes >= 0 else rest.tails[foot]) - rest.heads[foot]
        agreement.append(cosine(way, front))
    if max(agreement) > -0.5:  # cosine
        return False
    sided = {joint: bone for joint, bone in found.items() if joint[1:] in LIMB_WORDS and joint[0] in "lr"}
    for joint in sided:
        del found[joint]
    found |= {("r" if joint[0] == "l" else "l") + joint[1:]: bone for joint, bone in sided.items()}
    return True


def _check_biped(rest: ArmatureRest, found: Mapping[str, int]) -> None:
    up, left = up_and_left(rest.heads, found)
    if float(np.linalg.norm(up)) < 1e-9 or float(np.linalg.norm(np.cross(left, up))) < 1e-9:
        raise CharacterError("shoulders and hips are at the same position", advice="check the chosen bones")
    ways = []
    for side in "lr":
        end = next((found[side + joint] for joint in ("foot", "tibia") if side + joint in found), -1)
        if end >= 0:
            ways.append(rest.heads[found[side + "femur"]] - rest.heads[end])
    if ways:
        check_upright(float(np.mean([cosine(way, up) for way in ways])))


def _suspect_joints(rest: ArmatureRest, found: Mapping[str, int], uneven: float = 0.15) -> dict[str, str]:
    """Return joint -> reason why its bone is suspect.

    Args:
        uneven: Relative difference in length between left and right above which bones are suspect.
    """
    suspect: dict[str, str] = {}
    chains = (("root", "femur", "tibia", "foot", "toes"), ("root", "clavicle", "humerus", "radius", "hand", "fingers"))
    for side in "lr":
        for chain in chains:
            given = [joint if joint == "root" else side + joint for joint in chain]
            given = [joint for joint in given if joint in found]
            for upper, lower in pairwise(given):
                if not rest.is_above(found[upper], found[lower]) and rest.deform[found[lower]]:
                    suspect[lower] = f"is not below {rest.names[found[upper]]} in the hierarchy"
    used: dict[int, str] = {}
    for joint, bone in found.items():
        if bone in used:
            suspect[joint] = f"is also the bone of {used[bone]}"
        used[bone] = joint
    for upper, lower in (("femur", "tibia"), ("tibia", "foot"), ("humerus", "radius"), ("radius", "hand")):
        if not all(side + joint in found for side in "lr" for joint in (upper, lower)):
            continue
        sizes = [
            float(np.linalg.norm(rest.heads[found[side + lower]] - rest.heads[found[side + upper]])) for side in "lr"
        ]
        if abs(sizes[0] - sizes[1]) > uneven * max(sizes):
            for side in "lr":
                suspect.setdefault(side + upper, "left and right differ in length")
    _, left = up_and_left(rest.heads, found)
    for joint in ("tibia", "foot", "radius", "hand"):
        if "l" + joint in found and "r" + joint in found:
            across = rest.heads[found["l" + joint]] - rest.heads[found["r" + joint]]
            if float(across @ left) < 0.0:
                for side in "lr":
                    suspect.setdefault(side + joint, "is on the other side of the body")
    return suspect


def _why_missing(joint: str, found: Mapping[str, int]) -> str:
    if joint in ("lowerback", "upperback", "lowerneck", "upperneck"):
        return "the armature has fewer bones here; they take the joint's rotation"
    if joint[1:] == "wrist":
        return "forearm and hand take the joint's rotation"
    return "no bone found"
