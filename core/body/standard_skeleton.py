"""The standard skeleton: the CMU database's joints in their T rest pose.

The rest pose has the arms along +-x with the palms down and the legs spread by 20 degrees, as in that database, so
its motion needs no conversion. The joints without degrees of freedom (lhipjoint, rhipjoint) are part of the offsets.
"""

from dataclasses import replace

import numpy as np

from ..geometry.arrays import Array
from .skeleton import Skeleton

DEFAULT_HEIGHT_M = 1.75
_REFERENCE_HEIGHT_M = 1.75

_SIN20, _COS20 = 0.3420, 0.9397

# joint: (parent, offset from the parent, bone from the joint to its end), metres, left side, for 1.75 m of height.
# Segment lengths follow usual anthropometric shares of the height (thigh and shank 0.245 each, upper arm 0.172, ...).
_MIDDLE: dict[str, tuple[str, tuple[float, float, float], tuple[float, float, float]]] = {
    "root": ("", (0.0, 0.0, 0.0), (0.0, 0.05, 0.0)),
    "lowerback": ("root", (0.0, 0.0, 0.0), (0.0, 0.118, -0.008)),
    "upperback": ("lowerback", (0.0, 0.118, -0.008), (0.0, 0.118, 0.0)),
    "thorax": ("upperback", (0.0, 0.118, 0.0), (0.0, 0.119, 0.004)),
    "lowerneck": ("thorax", (0.0, 0.119, 0.004), (0.0, 0.086, 0.010)),
    "upperneck": ("lowerneck", (0.0, 0.086, 0.010), (0.0, 0.086, -0.006)),
    "head": ("upperneck", (0.0, 0.086, -0.006), (0.0, 0.090, 0.0)),
}
_LEG: dict[str, tuple[str, tuple[float, float, float], tuple[float, float, float]]] = {
    "femur": ("root", (0.085, -0.098, 0.040), (0.425 * _SIN20, -0.425 * _COS20, 0.0)),
    "tibia": ("femur", (0.425 * _SIN20, -0.425 * _COS20, 0.0), (0.425 * _SIN20, -0.425 * _COS20, 0.0)),
    "foot": ("tibia", (0.425 * _SIN20, -0.425 * _COS20, 0.0), (0.013, -0.036, 0.130)),
    "toes": ("foot", (0.013, -0.036, 0.130), (0.0, 0.0, 0.068)),
}
_ARM: dict[str, tuple[str, tuple[float, float, float], tuple[float, float, float]]] = {
    "clavicle": ("thorax", (0.0, 0.119, 0.004), (0.185, 0.045, -0.020)),
    "humerus": ("clavicle", (0.185, 0.045, -0.020), (0.295, 0.0, 0.0)),
    "radius": ("humerus", (0.295, 0.0, 0.0), (0.210, 0.0, 0.0)),
    "wrist": ("radius", (0.210, 0.0, 0.0), (0.080, 0.0, 0.0)),
    "hand": ("wrist", (0.080, 0.0, 0.0), (0.045, 0.0, 0.0)),
    "fingers": ("hand", (0.045, 0.0, 0.0), (0.060, 0.0, 0.0)),
    "thumb": ("wrist", (0.080, 0.0, 0.0), (0.042, 0.0, 0.042)),
}

JOINT_NAMES: tuple[str, ...] = (
    "root",
    *(f"{side}{name}" for side in "lr" for name in _LEG),
    *(name for name in _MIDDLE if name != "root"),
    *(f"{side}{name}" for side in "lr" for name in _ARM),
)
SPINE_JOINTS: tuple[str, ...] = ("lowerback", "upperback", "thorax", "lowerneck", "upperneck", "head")


def mirrored_name(name: str) -> str:
    """Return the other side's joint ("lfemur" -> "rfemur"); middle ones stay."""
    other = {"l": "r", "r": "l"}.get(name[0], "") + name[1:]
    return other if other in JOINT_NAMES else name


def default_skeleton(height_m: float = DEFAULT_HEIGHT_M) -> Skeleton:
    """Return the standard skeleton at a height (head to sole), in metres."""
    parts = {name: _joint_of(name) for name in JOINT_NAMES}
    scale = height_m / _REFERENCE_HEIGHT_M
    return Skeleton(
        names=JOINT_NAMES,
        parents=np.array([JOINT_NAMES.index(parent) if parent else -1 for parent, _, _ in parts.values()]),
        offsets_m=scale * np.array([offset for _, offset, _ in parts.values()]),
        tips_m=scale * np.array([tip for _, _, tip in parts.values()]),
    )


def _joint_of(name: str) -> tuple[str, Array, Array]:
    if name in _MIDDLE:
        parent, offset, tip = _MIDDLE[name]
        return parent, np.array(offset), np.array(tip)
    side, base = name[0], name[1:]
    parent, offset, tip = (_LEG | _ARM)[base]
    mirror = np.array([1.0 if side == "l" else -1.0, 1.0, 1.0])
    return (parent if parent in _MIDDLE else side + parent), mirror * np.array(offset), mirror * np.array(tip)


def scaled(skeleton: Skeleton, factors: Array | float) -> Skeleton:
    """Return the skeleton with offsets and tips multiplied by factors."""
    per_joint = np.broadcast_to(np.asarray(factors, dtype=np.float64), (len(skeleton),))[:, None]
    return replace(skeleton, offsets_m=skeleton.offsets_m * per_joint, tips_m=skeleton.tips_m * per_joint)
