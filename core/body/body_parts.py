"""Parts of the body by their everyday names."""

from .standard_skeleton import JOINT_NAMES, SPINE_JOINTS

_SIDED = {
    "arm": ("clavicle", "humerus", "radius"),
    "hand": ("wrist", "hand", "fingers", "thumb"),
    "leg": ("femur", "tibia"),
    "foot": ("foot", "toes"),
}
PARTS: dict[str, tuple[str, ...]] = {"torso": SPINE_JOINTS[:3], "head": SPINE_JOINTS[3:]} | {
    f"{side} {part}": tuple(side[0] + joint for joint in joints)
    for side in ("left", "right")
    for part, joints in _SIDED.items()
}
PART_JOINTS = {part: [JOINT_NAMES.index(joint) for joint in joints] for part, joints in PARTS.items()}
FOOT_JOINTS = PARTS["left foot"] + PARTS["right foot"]
