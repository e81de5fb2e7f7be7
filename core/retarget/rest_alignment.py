"""Alignment of any body at rest with the standard rest pose: facing and limbs.

Each limb is turned the shortest way, together with the limb above it, until its bones point as in the standard rest
pose.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from ..errors import CharacterError
from ..geometry import rotations as rot
from ..geometry.arrays import Array

# limb joint -> joints at the end of its bone, in order of preference
BONE_ENDS: dict[str, tuple[str, ...]] = {
    "femur": ("tibia",),
    "tibia": ("foot",),
    "humerus": ("radius",),
    "radius": ("wrist", "hand"),
    "wrist": ("hand",),
    "hand": ("fingers",),
}
# limb joint -> joints that it follows, in order of preference
ABOVE = {
    "tibia": ("femur",),
    "radius": ("humerus",),
    "wrist": ("radius", "humerus"),
    "hand": ("wrist", "radius", "humerus"),
}


def bone_end(name: str, joints: Mapping[str, int]) -> str | None:
    """Return the joint at the end of a limb joint's bone, or None if it is missing."""
    return next((name[0] + end for end in BONE_ENDS.get(name[1:], ()) if name[0] + end in joints), None)


def limb_turns(
    names: Iterable[str],
    directions: Mapping[str, Array],
    wanted: Mapping[str, Array],
    above: Mapping[str, tuple[str, ...]],
    fixed: Mapping[str, Array],
) -> dict[str, Array]:
    """Return joint -> rotation (4,) from a rest pose to the standard one.

    Args:
        names: Joints, parents first.
        directions, wanted: Directions of bones in the rest pose and in the standard one.
        above: Limb joint -> limb joints that it follows, in order of preference.
        fixed: Rotations of joints that do not follow others.
    """
    turns: dict[str, Array] = {}
    for name in names:
        followed = (turns[name[0] + kind] for kind in above.get(name[1:], ()) if name[0] + kind in turns)
        turn = fixed[name] if name in fixed else next(followed, rot.identity())
        if name in directions:
            turn = rot.multiply(rot.between(rot.rotate(turn, directions[name]), wanted[name]), turn)
        turns[name] = turn
    return turns


def up_and_left(heads: Array, joints: Mapping[str, int]) -> tuple[Array, Array]:
    """Return vectors from the hips to the shoulders and from right to left, in the unit of the positions."""
    thighs, arms = (heads[[joints["l" + name], joints["r" + name]]] for name in ("femur", "humerus"))
    return arms.mean(axis=0) - thighs.mean(axis=0), thighs[0] - thighs[1] + arms[0] - arms[1]


def facing(left: Array, up: Array, snap_rad: float = np.radians(25.0)) -> Array:
    """Return the rotation (3, 3) with columns left, up, forward of a body.

    Args:
        snap_rad: Angle within which the result becomes axis-aligned: a lean (hips in front of or behind the head) is
            posture, not a rotation of the body.

    Raises:
        CharacterError: The directions are parallel.
    """
    if np.linalg.norm(np.cross(left, up)) < 1e-6 * max(float(np.linalg.norm(up)), 1e-30):
        advice = "check the names and positions of the bones"
        raise CharacterError("left and right of the rest pose are unclear", advice=advice)
    up, cosine = up / np.linalg.norm(up), np.cos(snap_rad)
    if np.max(np.abs(up)) > cosine:
        up = _nearest_axes(up)
    forward = np.cross(left, up)
    forward = forward / np.linalg.norm(forward)
    measured = np.stack((np.cross(up, forward), up, forward), axis=1)
    aligned = _nearest_axes(measured)
    return aligned if np.sum(aligned * measured) > 1.0 + 2.0 * cosine else measured  # the trace gives the angle


def _nearest_axes(vectors: Array) -> Array:
    """Return the coordinate axes within 37 degrees of unit vectors, or 0 where there is none."""
    return np.where(np.abs(vectors) > 0.8, np.sign(vectors), 0.0)
