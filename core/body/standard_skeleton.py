"""The standard skeleton: the CMU database's joints in their T rest pose.

The rest pose has the arms along +-x with the palms down and the legs spread by 20 degrees, as in that database, so that
database's motion needs no conversion. The joints without degrees of freedom (lhipjoint, rhipjoint) are part of the
offsets.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from ..geometry.arrays import Array
from ..system.assets import JOINTS
from ..system.files import read_toml
from .skeleton import Skeleton

DEFAULT_HEIGHT_M = 1.75
_REFERENCE_HEIGHT_M = 1.75

TABLES = read_toml(JOINTS)  # one row per joint; for limbs only the left side's

_MIDDLE = ("root", "lowerback", "upperback", "thorax", "lowerneck", "upperneck", "head")
_LEG = ("femur", "tibia", "foot", "toes")
_ARM = ("clavicle", "humerus", "radius", "wrist", "hand", "fingers", "thumb")

JOINT_NAMES: tuple[str, ...] = (
    "root",
    *(f"{side}{name}" for side in "lr" for name in _LEG),
    *_MIDDLE[1:],
    *(f"{side}{name}" for side in "lr" for name in _ARM),
)
SPINE_JOINTS = _MIDDLE[1:]


def mirrored_name(name: str) -> str:
    """Return the name of the other side's joint ("lfemur" -> "rfemur"); names of joints in the middle are unchanged."""
    other = {"l": "r", "r": "l"}.get(name[0], "") + name[1:]
    return other if other in JOINT_NAMES else name


def default_skeleton(height_m: float = DEFAULT_HEIGHT_M) -> Skeleton:
    """Return the standard skeleton scaled to a height from head to sole, metres."""
    parts = {name: _joint_of(name) for name in JOINT_NAMES}
    scale = height_m / _REFERENCE_HEIGHT_M
    return Skeleton(
        names=JOINT_NAMES,
        parents=np.array([JOINT_NAMES.index(parent) if parent else -1 for parent, _, _ in parts.values()]),
        offsets_m=scale * np.array([offset for _, offset, _ in parts.values()]),
        tips_m=scale * np.array([tip for _, _, tip in parts.values()]),
    )


def facts_of(joint: str) -> dict[str, Any]:
    """Return a joint's row in `TABLES`; both sides share one row."""
    rows: dict[str, dict[str, Any]] = TABLES["joint"]
    return rows[joint] if joint in rows else rows[joint[1:]]


def joint_label(joint: str) -> str:
    """Return a joint's label, such as "Thigh L" for "lfemur"."""
    label = str(facts_of(joint)["label"])
    return label if joint in TABLES["joint"] else f"{label} {joint[0].upper()}"


def _joint_of(name: str) -> tuple[str, Array, Array]:
    row, side = facts_of(name), "" if name in _MIDDLE else name[0]
    mirror = np.array([-1.0 if side == "r" else 1.0, 1.0, 1.0])
    parent = row["parent"] if row["parent"] in ("", *_MIDDLE) else side + row["parent"]
    return parent, mirror * np.array(row["offset_m"]), mirror * np.array(row["tip_m"])


def scaled(skeleton: Skeleton, factors: Array | float) -> Skeleton:
    """Return the skeleton with its offsets and tips multiplied by factors."""
    per_joint = np.broadcast_to(np.asarray(factors, dtype=np.float64), (len(skeleton),))[:, None]
    return replace(skeleton, offsets_m=skeleton.offsets_m * per_joint, tips_m=skeleton.tips_m * per_joint)
