"""Bones of a VMC humanoid (Unity's HumanBodyBones), and motion of these bones.

When all rotations of a humanoid are zero, it stands in a T pose with straight legs, and the axes of all bones are the
world's. Our rest pose spreads the legs, so orientations are converted as for a file's skeleton (`align_rest`).
Everything here is in our axes; `vmc_packets` converts them to Unity's.
"""

from dataclasses import dataclass

import numpy as np

from ...body.calibration_poses import t_pose
from ...body.motion import Motion
from ...body.skeleton import Skeleton, forward_kinematics
from ...body.source_motion import SourceMotion, source_of_motion
from ...body.standard_skeleton import JOINT_NAMES, default_skeleton
from ...errors import TakeError
from ...geometry import rotations as rot
from ...geometry.arrays import Array, IntArray
from ...retarget.file_joints import match_joints
from ...retarget.file_rest_pose import align_rest
from ...retarget.to_standard_skeleton import to_standard_skeleton

# bone: (our joint, parent bone), parents first
_TRUNK = {
    "Hips": ("root", ""),
    "Spine": ("lowerback", "Hips"),
    "Chest": ("upperback", "Spine"),
    "UpperChest": ("thorax", "Chest"),
    "Neck": ("lowerneck", "UpperChest"),
    "Head": ("head", "Neck"),
}
_LIMBS = {
    "UpperLeg": ("femur", "Hips"),
    "LowerLeg": ("tibia", "UpperLeg"),
    "Foot": ("foot", "LowerLeg"),
    "Toes": ("toes", "Foot"),
    "Shoulder": ("clavicle", "UpperChest"),
    "UpperArm": ("humerus", "Shoulder"),
    "LowerArm": ("radius", "UpperArm"),
    "Hand": ("hand", "LowerArm"),
}
BONES: dict[str, tuple[str, str]] = {
    **_TRUNK,
    **{
        side + bone: (side[0].lower() + joint, above if above in _TRUNK else side + above)
        for side in ("Left", "Right")
        for bone, (joint, above) in _LIMBS.items()
    },
}


@dataclass(frozen=True)
class BonePoses:
    """Poses of a humanoid.

    Args:
        names: Names (B,) among `BONES`, in their order.
        positions_m: Positions (F, B, 3) in the parent's axes; the hips' in the world.
        rotations: Rotations (F, B, 4) relative to the parent and the T pose; the hips' in the world.
    """

    names: tuple[str, ...]
    positions_m: Array
    rotations: Array


class Humanoid:
    """Standard skeleton as a humanoid with the same bone lengths, without fingers and thumbs."""

    def __init__(self, skeleton: Skeleton) -> None:
        self._skeleton = skeleton
        self._joints = [skeleton.index(joint) for joint, _ in BONES.values()]
        names, self._parents = tuple(BONES), _parents(tuple(BONES))
        self._offsets = _t_pose_offsets(skeleton, self._joints, self._parents)
        still = _source("T pose", 1.0, names, self._offsets, rot.identity((1, len(names))), np.zeros((1, 3)))
        bone_from_joint = align_rest(still, match_joints(still))
        self._joint_from_bone = rot.conjugate([bone_from_joint[joint] for joint, _ in BONES.values()])

    def poses(self, rotations: Array, root_positions_m: Array) -> BonePoses:
        """Return humanoid poses from the rotations (F, J, 4) and root positions (F, 3) of a `Motion`."""
        world = np.array(rotations, dtype=np.float64)
        for level in self._skeleton.levels:
            above = self._skeleton.parents[level]
            world[:, level] = rot.multiply(world[:, above], world[:, level])
        bones = rot.multiply(world[:, self._joints], self._joint_from_bone)
        local = bones.copy()
        local[:, 1:] = rot.multiply(rot.conjugate(bones[:, self._parents[1:]]), bones[:, 1:])
        positions = np.tile(self._offsets, (len(rotations), 1, 1))
        positions[:, 0] = root_positions_m
        return BonePoses(tuple(BONES), positions, local)


def bone_poses(motion: Motion) -> BonePoses:
    """Return a motion of the standard skeleton as humanoid poses; see `Humanoid`."""
    return Humanoid(motion.skeleton).poses(motion.rotations, motion.root_positions_m)


def motion_of_bones(poses: BonePoses, name: str, fps: float) -> Motion:
    """Return humanoid poses as a motion of the standard skeleton.

    If a program sends only rotations, with all bones at the origin, average bone lengths are used.

    Raises:
        TakeError: The hips are missing.
        SkeletonError: A thigh, shank, upper arm or forearm is missing, or the body is not upright.
    """
    if "Hips" not in poses.names:
        raise TakeError("has no Hips bone", where=name, advice="set the other program to send all bones")
    offsets = np.median(poses.positions_m, axis=0)
    offsets[0] = 0.0
    if np.max(np.abs(offsets)) < 1e-6:
        joints = [JOINT_NAMES.index(BONES[bone][0]) for bone in poses.names]
        offsets = _t_pose_offsets(default_skeleton(), joints, _parents(poses.names))
    return to_standard_skeleton(_source(name, fps, poses.names, offsets, poses.rotations, poses.positions_m[:, 0]))


def _t_pose_offsets(skeleton: Skeleton, joints: list[int], parents: IntArray) -> Array:
    """Return offsets (B, 3) of bones from their parents in the T pose, 0 for the hips."""
    positions, _ = forward_kinematics(skeleton, t_pose(skeleton), np.zeros(3))
    starts = positions[joints]
    offsets = starts - starts[parents]
    offsets[0] = 0.0
    return offsets


def _parents(names: tuple[str, ...]) -> IntArray:
    """Return the index (B,) of the nearest ancestor that is present, or -1 for the hips."""
    found = []
    for name in names:
        above = BONES[name][1]
        while above and above not in names:
            above = BONES[above][1]
        found.append(names.index(above) if above else -1)
    return np.array(found)


def _source(
    name: str, fps: float, names: tuple[str, ...], offsets_m: Array, rotations: Array, hips_m: Array
) -> SourceMotion:
    skeleton = Skeleton(names, _parents(names), offsets_m, np.zeros((len(names), 3)))
    return source_of_motion(Motion(name, fps, skeleton, rotations, hips_m), name)
