"""Names of the joints in other programs.

Each naming has a name for all of the standard skeleton's joints. A joint between two of the target's bones (the twist
of the forearm, the second joint of the neck) has a name in its manner: programs in search of the target's bones find
these and pass over that one.
"""

from collections.abc import Mapping
from dataclasses import replace

from ..body.motion import Motion
from ..body.standard_skeleton import JOINT_NAMES
from ..errors import SettingsError

OWN = "cmu"  # the standard skeleton's joints have the names of the CMU Motion Capture Database

_SIDE_WORDS = {"l": "left", "r": "right"}


def _named(middle: Mapping[str, str], limbs: Mapping[str, str], sides: Mapping[str, str]) -> dict[str, str]:
    """Return joint -> name, `{side}` in limbs' names replaced by `sides`."""
    sided = {key + joint: name.format(side=sides[key]) for key in "lr" for joint, name in limbs.items()}
    found = {**middle, **sided}
    return {joint: found[joint] for joint in JOINT_NAMES}


NAMINGS: dict[str, dict[str, str]] = {
    OWN: {name: name for name in JOINT_NAMES},
    # the mannequin of Unreal Engine 5, with five spine bones that bend as three
    "unreal": _named(
        {
            "root": "pelvis", "lowerback": "spine_01", "upperback": "spine_03", "thorax": "spine_05",
            "lowerneck": "neck_01", "upperneck": "neck_02", "head": "head",
        },
        {
            "femur": "thigh_{side}", "tibia": "calf_{side}", "foot": "foot_{side}", "toes": "ball_{side}",
            "clavicle": "clavicle_{side}", "humerus": "upperarm_{side}", "radius": "lowerarm_{side}",
            "wrist": "lowerarm_twist_01_{side}", "hand": "hand_{side}", "fingers": "middle_01_{side}",
            "thumb": "thumb_01_{side}",
        },
        {"l": "l", "r": "r"},
    ),
    # humanoid bones of VRM 1.0
    "vrm": _named(
        {
            "root": "hips", "lowerback": "spine", "upperback": "chest", "thorax": "upperChest",
            "lowerneck": "neck", "upperneck": "neck2", "head": "head",
        },
        {
            "femur": "{side}UpperLeg", "tibia": "{side}LowerLeg", "foot": "{side}Foot", "toes": "{side}Toes",
            "clavicle": "{side}Shoulder", "humerus": "{side}UpperArm", "radius": "{side}LowerArm",
            "wrist": "{side}LowerArmTwist", "hand": "{side}Hand", "fingers": "{side}MiddleProximal",
            "thumb": "{side}ThumbMetacarpal",
        },
        _SIDE_WORDS,
    ),
    "mixamo": _named(
        {
            "root": "mixamorig:Hips", "lowerback": "mixamorig:Spine", "upperback": "mixamorig:Spine1",
            "thorax": "mixamorig:Spine2", "lowerneck": "mixamorig:Neck", "upperneck": "mixamorig:Neck1",
            "head": "mixamorig:Head",
        },
        {
            "femur": "mixamorig:{side}UpLeg", "tibia": "mixamorig:{side}Leg", "foot": "mixamorig:{side}Foot",
            "toes": "mixamorig:{side}ToeBase", "clavicle": "mixamorig:{side}Shoulder",
            "humerus": "mixamorig:{side}Arm", "radius": "mixamorig:{side}ForeArm",
            "wrist": "mixamorig:{side}ForeArmTwist", "hand": "mixamorig:{side}Hand",
            "fingers": "mixamorig:{side}HandMiddle1", "thumb": "mixamorig:{side}HandThumb1",
        },
        {key: word.title() for key, word in _SIDE_WORDS.items()},
    ),
}  # fmt: skip


def naming_of(name: str) -> dict[str, str]:
    """Return joint -> name of a naming; SettingsError names those there are."""
    if name not in NAMINGS:
        raise SettingsError(f"there is no naming {name!r}", advice="namings: " + ", ".join(NAMINGS))
    return NAMINGS[name]


def rename_joints(motion: Motion, naming: str) -> Motion:
    """Return a motion with its joints renamed."""
    names = naming_of(naming)
    skeleton = motion.skeleton
    return replace(motion, skeleton=replace(skeleton, names=tuple(names[name] for name in skeleton.names)))
