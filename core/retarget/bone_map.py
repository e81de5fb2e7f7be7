"""Bone map of an armature: by a preset, by names or by shape, and checked.

Complete names that agree with the hierarchy decide, else the limb's shape. Trunk and neck go by the hierarchy between
hips, arms and head, as rigs have any number of bones there. Each joint has its certainty and the reason.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

import numpy as np

from ..body.standard_skeleton import JOINT_NAMES
from ..errors import CharacterError
from ..geometry.arrays import Array
from .armature_rest import ArmatureRest
from .bone_name_parser import LIMB_WORDS
from .joint_matching import match_names, match_trunk
from .limb_detection import Limbs, arm_joints, check_upright, cosine, find_limbs, leg_joints

NEEDED = ("root", "lfemur", "rfemur", "lhumerus", "rhumerus")  # without these nobody knows how the character stands
EXPECTED = (
    *NEEDED, "ltibia", "rtibia", "lfoot", "rfoot", "lradius", "rradius", "thorax", "head",
)  # fmt: skip

_UNEVEN = 0.15  # relative difference between left and right from which a limb is doubtful
_ONE_PLACE = 0.02  # of the body's size: bones that begin closer than this begin at the same place
_FEET_TELL = 0.5  # cosine between the feet and the front that the names give, from which the feet contradict them


class MatchState(Enum):
    """How sure a joint's bone is."""

    MAPPED = "mapped"
    MISSING = "missing"
    DOUBTFUL = "doubtful"


@dataclass(frozen=True)
class JointMatch:
    """Bone of one joint, "" when missing, and the reason for the user."""

    bone: str
    state: MatchState
    reason: str = ""


@dataclass(frozen=True)
class BoneMap:
    """A bone for each of the standard skeleton's joints that the armature has.

    Args:
        matches: for every name of `JOINT_NAMES` the match.
        origin: where the map comes from: a preset's name, "names", "names and shape", "shape".
    """

    matches: Mapping[str, JointMatch]
    origin: str

    @property
    def bones(self) -> dict[str, str]:
        """Joint -> bone of all joints that have one."""
        return {joint: match.bone for joint, match in self.matches.items() if match.bone}

    def of_state(self, state: MatchState) -> list[str]:
        """Return the joints of a state."""
        return [joint for joint, match in self.matches.items() if match.state is state]

    @property
    def complete(self) -> bool:
        """Whether all joints that a humanoid has are mapped and none is doubtful."""
        expected = all(self.matches[joint].state is MatchState.MAPPED for joint in EXPECTED)
        return expected and not self.of_state(MatchState.DOUBTFUL)


def identity_bone_map() -> BoneMap:
    """Return the map of an armature with the joints' own names."""
    return BoneMap({joint: JointMatch(joint, MatchState.MAPPED) for joint in JOINT_NAMES}, "names")


def find_bone_map(rest: ArmatureRest, presets: Mapping[str, Mapping[str, str]] | None = None) -> BoneMap:
    """Return the map of an armature.

    Args:
        presets: name -> joint -> bone; one that fits entirely comes before everything else.

    Raises:
        CharacterError: the armature is not a biped, with the reason; or arms, legs and hips are not found.
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
            "no biped is seen in it: neither names nor shape tell " + _listed(missing),
            advice="choose these bones by hand, or another armature",
        )
    _shift_if_named_by_ends(rest, found)
    if not match_trunk(rest, found):
        raise CharacterError("arms and legs have no common parent bone", advice="choose the hips by hand")
    swapped = _swap_if_feet_say_so(rest, found)
    return checked_map(rest, {joint: rest.names[bone] for joint, bone in found.items()}, origin, swapped)


def checked_map(rest: ArmatureRest, bones: Mapping[str, str], origin: str, swapped: bool = False) -> BoneMap:
    """Return the map of given bones with the state of each joint.

    Raises:
        CharacterError: A bone does not exist, a required one is not given, or the armature is not a biped.
    """
    unknown = [bone for bone in bones.values() if bone not in rest.index]
    if unknown:
        raise CharacterError("the armature has no bone " + _listed(unknown), advice="choose another map or bones")
    lacking = [joint for joint in NEEDED if joint not in bones]
    if lacking:
        raise CharacterError("no bone is given for " + _listed(lacking), advice="choose these bones")
    found = {joint: rest.index[bone] for joint, bone in bones.items()}
    _refuse_unless_biped(rest, found)
    doubts = _doubts(rest, found)
    matches = {}
    for joint in JOINT_NAMES:
        if joint not in found:
            matches[joint] = JointMatch("", MatchState.MISSING, _why_missing(joint, found))
        elif joint in doubts:
            matches[joint] = JointMatch(bones[joint], MatchState.DOUBTFUL, doubts[joint])
        else:
            side = "named for the other side; its feet tell which way it faces" if swapped and joint[0] in "lr" else ""
            matches[joint] = JointMatch(bones[joint], MatchState.MAPPED, side if joint[1:] in LIMB_WORDS else "")
    return BoneMap(matches, origin)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def _fitting(rest: ArmatureRest, preset: Mapping[str, str]) -> dict[str, str] | None:
    """Return a preset's bones in this armature, None if it lacks one.

    Fingers, thumbs and toes may be absent: they are often left out of a rig.
    """
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
    """Take limbs without complete names from the shape; hands and toes with them."""
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
    """Move limbs one bone outwards in rigs with bones named by their end joints."""
    size = float(np.max(np.ptp(rest.heads, axis=0)))
    chains: tuple[tuple[str, ...], ...] = (("femur", "tibia", "foot", "toes"), ("humerus", "radius", "hand", "fingers"))
    for chain in chains:
        starts = [rest.heads[found[side + chain[0]]] for side in "lr"]
        if float(np.linalg.norm(starts[0] - starts[1])) > _ONE_PLACE * size:
            continue
        for side in "lr":
            bones = [found.get(side + joint, -1) for joint in chain] + [-1]
            if chain[0] == "humerus":
                found.setdefault(side + "clavicle", bones[0])
            for joint, bone in zip(chain, bones[1:], strict=True):
                found.pop(side + joint, None)
                if bone >= 0:
                    found[side + joint] = bone


def _axes(rest: ArmatureRest, found: Mapping[str, int]) -> tuple[Array, Array]:
    """Return the directions up the trunk and to the left."""
    hips, shoulders = (
        0.5 * (rest.heads[found["l" + joint]] + rest.heads[found["r" + joint]]) for joint in ("femur", "humerus")
    )
    left = sum(rest.heads[found["l" + joint]] - rest.heads[found["r" + joint]] for joint in ("femur", "humerus"))
    return shoulders - hips, np.asarray(left)


def _swap_if_feet_say_so(rest: ArmatureRest, found: dict[str, int]) -> bool:
    """Swap the sides of rigs named as their viewer sees them: feet point backwards."""
    up, left = _axes(rest, found)
    front = np.cross(left, up)
    agreement = []
    for side in "lr":
        if side + "foot" not in found:
            return False
        foot = found[side + "foot"]
        toes = found.get(side + "toes", -1)
        way = (rest.heads[toes] if toes >= 0 else rest.tails[foot]) - rest.heads[foot]
        agreement.append(cosine(way, front))
    if max(agreement) > -_FEET_TELL:
        return False
    sided = {joint: bone for joint, bone in found.items() if joint[1:] in LIMB_WORDS and joint[0] in "lr"}
    for joint in sided:
        del found[joint]
    found |= {("r" if joint[0] == "l" else "l") + joint[1:]: bone for joint, bone in sided.items()}
    return True


def _refuse_unless_biped(rest: ArmatureRest, found: Mapping[str, int]) -> None:
    up, left = _axes(rest, found)
    if float(np.linalg.norm(up)) < 1e-9 or float(np.linalg.norm(np.cross(left, up))) < 1e-9:
        raise CharacterError("shoulders and hips lie at one place", advice="check the bones that are chosen")
    ways = []
    for side in "lr":
        end = next((found[side + joint] for joint in ("foot", "tibia") if side + joint in found), -1)
        if end >= 0:
            ways.append(rest.heads[found[side + "femur"]] - rest.heads[end])
    if ways:
        check_upright(float(np.mean([cosine(way, up) for way in ways])))


def _doubts(rest: ArmatureRest, found: Mapping[str, int]) -> dict[str, str]:
    """Return joint -> why its bone is doubtful."""
    doubts: dict[str, str] = {}
    chains = (("root", "femur", "tibia", "foot", "toes"), ("root", "clavicle", "humerus", "radius", "hand", "fingers"))
    for side in "lr":
        for chain in chains:
            given = [joint if joint == "root" else side + joint for joint in chain]
            given = [joint for joint in given if joint in found]
            for upper, lower in pairwise(given):
                if not rest.is_above(found[upper], found[lower]) and rest.deform[found[lower]]:
                    doubts[lower] = f"does not hang on {rest.names[found[upper]]}"
    used: dict[int, str] = {}
    for joint, bone in found.items():
        if bone in used:
            doubts[joint] = f"is the bone of {used[bone]} too"
        used[bone] = joint
    for upper, lower in (("femur", "tibia"), ("tibia", "foot"), ("humerus", "radius"), ("radius", "hand")):
        if not all(side + joint in found for side in "lr" for joint in (upper, lower)):
            continue
        sizes = [
            float(np.linalg.norm(rest.heads[found[side + lower]] - rest.heads[found[side + upper]])) for side in "lr"
        ]
        if abs(sizes[0] - sizes[1]) > _UNEVEN * max(sizes):
            for side in "lr":
                doubts.setdefault(side + upper, "left and right differ in length")
    _, left = _axes(rest, found)
    for joint in ("tibia", "foot", "radius", "hand"):
        if "l" + joint in found and "r" + joint in found:
            across = rest.heads[found["l" + joint]] - rest.heads[found["r" + joint]]
            if float(across @ left) < 0.0:
                for side in "lr":
                    doubts.setdefault(side + joint, "lies on the other side")
    return doubts


def _why_missing(joint: str, found: Mapping[str, int]) -> str:
    if joint in ("lowerback", "upperback", "lowerneck", "upperneck"):
        return "the rig has fewer bones here; the others take its turn"
    if joint[1:] == "wrist":
        return "the forearm and the hand take its turn"
    return "no bone found"
