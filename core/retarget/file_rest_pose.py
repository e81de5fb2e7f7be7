"""Joint axes of a file's body in the standard rest pose.

The zero pose of most files is a T or A pose with the world's joint axes. Some files put all bones along one axis, so
that the zero pose is not a body's; for these the axes in the T pose are known from the convention (`_BONES_ALONG_X`).
Trunk, clavicles, neck and head are upright in any such pose and keep their orientation; feet and toes follow the legs;
upper arms and forearms are also turned about the bone, to align the elbow's hinge.
"""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from ..body.joint_angle_frames import angle_frame
from ..body.skeleton import zero_pose_positions
from ..body.source_motion import SourceMotion, frame_range, source_kinematics
from ..body.standard_skeleton import JOINT_NAMES, default_skeleton
from ..errors import SkeletonError
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray
from .rest_alignment import ABOVE, bone_end, facing, limb_turns

_LEFT, _RIGHT = (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)
_UP, _DOWN = (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)
_FRONT = (0.0, 0.0, 1.0)

_ABOVE = {
    **ABOVE,
    "foot": ("tibia", "femur"),
    "toes": ("foot", "tibia", "femur"),
    "fingers": ("hand", "wrist", "radius", "humerus"),
    "thumb": ("wrist", "radius", "humerus"),
}
_HINGED = ("humerus", "radius")

# Local X and Y axes of each joint in a T pose. Bones point along X, away from the body on the left side and towards it
# on the right; knees and elbows turn about Y. Measured in the Bandai-Namco data set, where standing feet point 39.6
# degrees down and their toes 23.
_FOOT_DOWN, _TOES_DOWN = np.radians(39.6), np.radians(23.0)


def _pitched(angle: float, sign: float) -> tuple[float, float, float]:
    return (0.0, -sign * float(np.sin(angle)), sign * float(np.cos(angle)))


_BONES_ALONG_X = {
    "root": (_UP, _RIGHT),
    **dict.fromkeys(("lowerback", "upperback", "thorax", "lowerneck", "upperneck", "head"), (_UP, _FRONT)),
    **dict.fromkeys(("lfemur", "ltibia"), (_DOWN, _LEFT)),
    **dict.fromkeys(("rfemur", "rtibia"), (_UP, _LEFT)),
    "lfoot": (_pitched(_FOOT_DOWN, 1.0), _LEFT),
    "ltoes": (_pitched(_TOES_DOWN, 1.0), _LEFT),
    "rfoot": (_pitched(_FOOT_DOWN, -1.0), _LEFT),
    "rtoes": (_pitched(_TOES_DOWN, -1.0), _LEFT),
    **dict.fromkeys(("lclavicle", "lhumerus", "lradius", "lwrist", "lhand"), (_LEFT, _UP)),
    **dict.fromkeys(("rclavicle", "rhumerus", "rradius", "rwrist", "rhand"), (_LEFT, _DOWN)),
}


def align_rest(source: SourceMotion, found: Mapping[str, int]) -> dict[str, Array]:
    """Return the source-joint-from-world quaternion (4,) of each joint at rest.

    Raises:
        SkeletonError: Neither the zero pose nor the first frame is a standing body, and the axes do not follow a known
            convention.
    """
    joints = tuple(found.items())
    alignment = _align_zero_pose(source.names, joints, source.parents.tobytes(), source.offsets_m.tobytes())
    if alignment is not None:
        return alignment
    positions, world = source_kinematics(frame_range(source, 0, 1))
    if _is_body(positions[0], found):
        return _from_pose(positions[0], world[0], found)
    raise SkeletonError(
        "its rest pose is not a standing body, and its joint axes follow no known convention",
        where=source.where,
        advice="export it with a T pose as the rest pose or the first frame",
    )


@lru_cache(maxsize=64)  # clips of one data set share a few skeletons
def _align_zero_pose(
    names: tuple[str, ...], joints: tuple[tuple[str, int], ...], parents: bytes, offsets_m: bytes
) -> dict[str, Array] | None:
    found = dict(joints)
    parent_of = np.frombuffer(parents, dtype=np.int64)
    offsets = np.frombuffer(offsets_m, dtype=np.float64).reshape(-1, 3)
    zero = zero_pose_positions(parent_of, offsets)
    if _is_body(zero, found):
        return _from_pose(zero, np.tile(rot.identity(), (len(names), 1)), found)
    if _has_bones_along_x(parent_of, offsets, found):
        return _from_bones_along_x(parent_of, offsets, found)
    return None


def _is_body(positions: Array, found: Mapping[str, int], least_height: float = 0.35) -> bool:
    """Return whether a pose is an upright body with its left side on the left.

    Args:
        least_height: Smallest height of the hips above the knees, and of the shoulders above the hips, relative to the
            length of thigh and trunk.
    """
    up, left, front = _body_axes(positions, found)
    if not np.all(np.isfinite(np.stack((up, left, front)))):
        return False
    reach = sum(
        float(np.linalg.norm(positions[found[b]] - positions[found[a]]))
        for a, b in (("lfemur", "ltibia"), ("root", "lhumerus"))
    )
    knees = positions[found["ltibia"]] + positions[found["rtibia"]] - 2.0 * positions[found["root"]]
    shoulders = positions[found["lhumerus"]] + positions[found["rhumerus"]] - 2.0 * positions[found["root"]]
    elbows = positions[found["lradius"]] - positions[found["rradius"]]
    hips = positions[found["lfemur"]] - positions[found["rfemur"]]
    upright = min(-float(knees @ up), float(shoulders @ up)) > least_height * reach
    return upright and float(elbows @ left) > 0.0 and float(hips @ left) > 0.5 * float(np.linalg.norm(hips))


def _body_axes(positions: Array, found: Mapping[str, int]) -> tuple[Array, Array, Array]:
    """Return the directions up, left and front of a pose."""
    middle = 0.5 * (positions[found["lhumerus"]] + positions[found["rhumerus"]])
    up = _unit(middle - 0.5 * (positions[found["lfemur"]] + positions[found["rfemur"]]))
    across = positions[found["lhumerus"]] - positions[found["rhumerus"]]
    across = _unit(across) + _unit(positions[found["lfemur"]] - positions[found["rfemur"]])
    left = _unit(across - up * float(across @ up))
    return up, left, np.cross(left, up)


def _unit(vector: Array) -> Array:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-9 else np.full(3, np.nan)


def _from_pose(positions: Array, world: Array, found: Mapping[str, int]) -> dict[str, Array]:
    up, left, _ = _body_axes(positions, found)
    rest_from_pose = rot.from_matrix(facing(left, up).T)
    orientations = {name: rot.multiply(rest_from_pose, world[joint]) for name, joint in found.items()}
    bones: dict[str, Array] = {}
    for name in found:
        end = bone_end(name, found)
        if end is not None:
            bone = rot.rotate(rest_from_pose, positions[found[end]] - positions[found[name]])
            if np.linalg.norm(bone) > 1e-4:
                bones[name] = _unit(bone)
    return _aligned(orientations, bones)


def _from_bones_along_x(parents: IntArray, offsets_m: Array, found: Mapping[str, int]) -> dict[str, Array]:
    orientations: dict[str, Array] = {}
    for name in found:
        if name in _BONES_ALONG_X:
            x, y = (np.array(axis) for axis in _BONES_ALONG_X[name])
            orientations[name] = rot.from_matrix(np.stack((x, y, np.cross(x, y)), axis=-1))
    bones: dict[str, Array] = {}
    for name in orientations:
        end = bone_end(name, found)
        if end is not None and int(parents[found[end]]) == found[name]:
            bones[name] = _unit(rot.rotate(orientations[name], offsets_m[found[end]]))
    return _aligned(orientations, bones)


def _has_bones_along_x(parents: IntArray, offsets_m: Array, found: Mapping[str, int]) -> bool:
    """Return whether the limbs lie along +X on the left and -X on the right."""
    for side, sign in (("l", 1.0), ("r", -1.0)):
        for bone, end in (("femur", "tibia"), ("tibia", "foot"), ("humerus", "radius"), ("radius", "hand")):
            if side + end not in found:
                continue
            offset = offsets_m[found[side + end]]
            child_of_bone = int(parents[found[side + end]]) == found[side + bone]
            if not child_of_bone or sign * offset[0] < 0.99 * float(np.linalg.norm(offset)):
                return False
    return True


def _aligned(orientations: dict[str, Array], bones: dict[str, Array]) -> dict[str, Array]:
    """Turn each joint from the file's T or A pose to the standard rest pose."""
    default = default_skeleton()
    names = [name for name in JOINT_NAMES if name in orientations]
    wanted = dict(zip(JOINT_NAMES, default.tips_m, strict=True))
    turns = limb_turns(names, bones, wanted, _ABOVE, {})
    rolls = {name: rot.multiply(_hinge_roll(name, turn), turn) for name, turn in turns.items()}
    return {name: rot.conjugate(rot.multiply(rolls[name], orientations[name])) for name in rolls}


def _hinge_roll(name: str, turn: Array) -> Array:
    """Return the rotation about the arm that aligns the elbow's hinge."""
    if name[1:] not in _HINGED:
        return rot.identity()
    side = 1.0 if name[0] == "l" else -1.0
    frame, _ = angle_frame(name)
    wanted = rot.rotate(frame, np.array([1.0, 0.0, 0.0]))
    arm = np.array([side, 0.0, 0.0])
    present = np.array([0.0, -side, 0.0])
    angle = np.arctan2(float(np.cross(present, wanted) @ arm), float(present @ wanted))
    return rot.from_rotation_vector(angle * arm)
