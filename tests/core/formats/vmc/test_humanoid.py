"""Our motion told in the bones of a humanoid, and back."""

import numpy as np
import pytest
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.motion import Motion
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import JOINT_NAMES, default_skeleton
from perfanim.core.errors import SkeletonError, TakeError
from perfanim.core.formats.vmc.humanoid import BONES, BonePoses, bone_poses, motion_of_bones
from perfanim.core.geometry import rotations as rot


def standing(**turns):
    """The default body for two frames in the T pose of humanoids, turned in some joints."""
    skeleton = default_skeleton()
    rotations = t_pose(skeleton)
    for joint, vector in turns.items():
        index = skeleton.index(joint)
        rotations[index] = rot.multiply(rot.from_rotation_vector(np.array(vector)), rotations[index])
    return Motion("still", 60.0, skeleton, np.stack([rotations] * 2), np.full((2, 3), [0.0, 0.95, 0.0]))


def test_names_are_unitys_and_every_bone_hangs_on_one_before_it():
    names = list(BONES)
    assert len(names) == 22
    assert {"Hips", "Spine", "UpperChest", "LeftUpperArm", "RightLowerLeg", "LeftToes", "RightHand"} < set(names)
    assert all(joint in JOINT_NAMES for joint, _ in BONES.values())
    assert all(above in names[:at] for at, (_, above) in enumerate(BONES.values()) if above)


def test_the_t_pose_turns_no_bone_but_the_arm_bones_roll():
    """Upper arms may roll: where the elbow's hinge lies in a T pose differs, the arms' direction does not."""
    poses = bone_poses(standing())
    arm = np.array([any(word in name for word in ("UpperArm", "LowerArm", "Hand")) for name in poses.names])
    angles = rot.angle_between(poses.rotations[0], rot.identity((len(poses.names),)))
    assert np.all(angles[~arm] < 1e-6)
    rolls = np.abs(rot.to_rotation_vector(poses.rotations[0][arm]))
    assert np.all(rolls[:, 1:] < 1e-6)
    assert poses.positions_m[0, poses.names.index("LeftLowerLeg")] == pytest.approx([0.0, -0.425, 0.0], abs=1e-3)


def test_a_bent_knee_turns_the_lower_leg_about_the_left():
    thigh = default_skeleton().tips_m[JOINT_NAMES.index("lfemur")]
    hinge = np.cross(thigh, [0.0, 0.0, -1.0])  # in the rest pose, whose legs are spread
    poses = bone_poses(standing(ltibia=0.8 * hinge / np.linalg.norm(hinge)))
    turn = poses.rotations[0, poses.names.index("LeftLowerLeg")]
    assert rot.to_rotation_vector(turn) == pytest.approx([0.8, 0.0, 0.0], abs=1e-6)


def test_there_and_back_keeps_every_bone(truth):
    again = motion_of_bones(bone_poses(truth), "again", truth.fps)
    joints = [JOINT_NAMES.index(joint) for joint, _ in BONES.values()]
    positions, world = forward_kinematics(truth.skeleton, truth.rotations, truth.root_positions_m)
    positions_again, world_again = forward_kinematics(again.skeleton, again.rotations, again.root_positions_m)
    # the way back gives a turn of the forearm to the wrist
    radii = [JOINT_NAMES.index(side + "radius") for side in "lr"]
    kept = [joint for joint in joints if joint not in radii]
    assert rot.angle_between(world[:, kept], world_again[:, kept]).max() < 1e-6
    # the head hangs on the neck by a second joint, which humanoids lack
    rigid = [joint for joint in joints if JOINT_NAMES[joint] != "head"]
    assert np.abs(positions[:, rigid] - positions_again[:, rigid]).max() < 1e-6


def test_humanoids_may_lack_bones(truth):
    poses = bone_poses(truth)
    lacking = ("UpperChest", "LeftShoulder", "RightShoulder", "LeftToes", "RightToes")
    kept = [at for at, name in enumerate(poses.names) if name not in lacking]
    fewer = BonePoses(tuple(poses.names[at] for at in kept), poses.positions_m[:, kept], poses.rotations[:, kept])
    again = motion_of_bones(fewer, "again", truth.fps)
    assert again.skeleton.names == JOINT_NAMES
    assert np.all(np.isfinite(again.rotations))


def test_bones_that_come_without_positions_have_the_average_bodys_lengths(truth):
    poses = bone_poses(truth)
    only_hips = poses.positions_m.copy()
    only_hips[:, 1:] = 0.0
    again = motion_of_bones(BonePoses(poses.names, only_hips, poses.rotations), "turns", truth.fps)
    assert again.skeleton.offsets_m == pytest.approx(default_skeleton().offsets_m, abs=1e-3)
    assert again.root_positions_m == pytest.approx(truth.root_positions_m)
    assert rot.angle_between(bone_poses(again).rotations[:, 7], poses.rotations[:, 7]).max() < 1e-3


def test_what_makes_no_body_is_refused(truth):
    poses = bone_poses(truth)
    with pytest.raises(TakeError, match="no Hips bone"):
        motion_of_bones(BonePoses(poses.names[1:], poses.positions_m[:, 1:], poses.rotations[:, 1:]), "legs", 30.0)
    with pytest.raises(SkeletonError, match="lfemur"):
        motion_of_bones(BonePoses(poses.names[:6], poses.positions_m[:, :6], poses.rotations[:, :6]), "trunk", 30.0)
