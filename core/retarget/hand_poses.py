"""Presets for the fingers of any character, as turns of its finger bones.

Cameras do not see the fingers of a performer with markers on the hands, so they are posed by presets. Each finger bends
about the axis across its palm, measured from the straight finger, so that rest poses with bent fingers give the same
hand.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..errors import CharacterError
from ..geometry import rotations as rot
from ..geometry.arrays import Array
from .armature_rest import ArmatureRest
from .bone_name_parser import parse_bone_name
from .character_rest_pose import across_hand
from .driven_bones import neighbour_names

_PHALANGES = 3
_STIFF = 0.5  # bend of a stiff finger, relative to the sum of a whole finger's joints, that looks alike
_Angles = tuple[float, float, float]


@dataclass(frozen=True)
class HandPose:
    """Bend of each finger's phalanges towards the palm, degrees, from the knuckle outwards; chosen by eye.

    Args:
        fingers: First and last finger, index and little finger; those between are interpolated.
        thumb: Bend of the thumb's bones across the palm.
    """

    index: _Angles
    little: _Angles
    thumb: _Angles
    middle: _Angles | None = None  # where the middle finger is not between the others

    def angles_deg(self, count: int) -> Array:
        """Return the bend (count, 3) of a hand's fingers, index first."""
        rows = np.linspace(self.middle or self.index, self.little, max(count, 1))
        if self.middle is not None:
            rows[0] = self.index
        return rows


HAND_POSES: Mapping[str, HandPose] = {
    "relaxed": HandPose((15.0, 25.0, 12.0), (30.0, 35.0, 20.0), (8.0, 12.0, 12.0)),
    "fist": HandPose((75.0, 95.0, 60.0), (85.0, 95.0, 60.0), (25.0, 35.0, 45.0)),
    "flat": HandPose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "grip": HandPose((50.0, 60.0, 35.0), (60.0, 65.0, 40.0), (25.0, 25.0, 25.0)),
    "point": HandPose((5.0, 5.0, 5.0), (85.0, 95.0, 60.0), (25.0, 35.0, 45.0), middle=(80.0, 95.0, 60.0)),
}


def finger_turns(rest: ArmatureRest, bones: Mapping[str, str], side: str, pose: HandPose) -> dict[str, Array]:
    """Return the rotation (4,) of each finger bone of a hand in a pose, relative to rest, in the bone's axes.

    Args:
        bones: Joint -> bone of the character.
        side: "l" or "r".

    Raises:
        CharacterError: No finger bone of the hand is mapped.
    """
    joints = {joint: rest.index[bone] for joint, bone in bones.items()}
    hand, first = joints.get(side + "hand", -1), joints.get(side + "fingers", -1)
    across = across_hand(rest, joints, rest.heads, side) if hand >= 0 else None
    if first < 0 or across is None:
        raise CharacterError(
            f"no bones of the {'left' if side == 'l' else 'right'} hand's fingers and thumb are mapped",
            advice="choose a bone for Fingers and for Thumb",
        )
    along = _unit(rest.heads[first] - rest.heads[hand])
    if not np.any(across):  # the thumb begins at the wrist
        across = _directions(rest, [joints[side + "thumb"]])[0]
    across = _unit(across - along * (across @ along))
    palm = np.cross(along, across) * (1.0 if side == "l" else -1.0)
    names = [rest.names[first], *neighbour_names(rest.names[first])]
    starts = [rest.index[name] for name in names if name in rest.index]
    starts.sort(key=lambda bone: -float(rest.heads[bone] @ across))
    turns: dict[str, Array] = {}
    for start, angles_deg in zip(starts, pose.angles_deg(len(starts)), strict=True):
        turns |= _bent(rest, _phalanges(rest, start), palm, along, angles_deg)
    if side + "thumb" in joints:
        chain = _phalanges(rest, joints[side + "thumb"])
        way = _directions(rest, chain)[0]
        turns |= _bent(rest, chain, palm - across, way, np.array(pose.thumb))
    return turns


def _bent(rest: ArmatureRest, chain: list[int], towards: Array, straight: Array, angles_deg: Array) -> dict[str, Array]:
    """Return the turns of a finger's bones.

    Args:
        towards: Direction (3,) in which the finger bends.
        straight: Direction (3,) of the finger's first bone if it is not bent.
        angles_deg: Wanted bend (3,); the last bone of a finger with fewer bones bends for those that it lacks.
    """
    wanted = np.array(angles_deg[: len(chain)])
    if len(chain) < _PHALANGES:
        wanted[-1] = min(_STIFF * float(np.sum(angles_deg[len(chain) - 1 :])), 90.0)
    ways = _directions(rest, chain)
    # a finger may point sideways: its bend is measured in its own plane
    axis = _unit(np.cross(ways[0], towards))
    before = _unit(straight - axis * (straight @ axis))
    turns = {}
    for bone, way, angle_deg in zip(chain, ways, wanted, strict=True):
        flat = _unit(way - axis * (way @ axis))
        bent_rad = float(np.arctan2(np.cross(before, flat) @ axis, before @ flat))
        turns[rest.names[bone]] = rot.from_rotation_vector(
            rest.axes[bone].T @ axis * (np.radians(angle_deg) - bent_rad)
        )
        before = flat
    return turns


def _phalanges(rest: ArmatureRest, start: int) -> list[int]:
    """Return the bones of a finger, from its first one outwards."""
    chain = [start]
    while len(chain) < _PHALANGES:
        following = [bone for bone in rest.children[chain[-1]] if not parse_bone_name(rest.names[bone]).helper]
        if not following:
            break
        chain.append(following[0])
    return chain


def _directions(rest: ArmatureRest, chain: list[int]) -> list[Array]:
    """Return the unit direction (3,) of each bone of a finger."""
    ends = [*rest.heads[chain[1:]], rest.tails[chain[-1]]]
    return [_unit(end - rest.heads[bone]) for bone, end in zip(chain, ends, strict=True)]


def _unit(vector: Array) -> Array:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-9))
