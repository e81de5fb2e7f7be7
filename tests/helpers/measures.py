"""What a retargeted character does, computed from its bones as Blender does, and compared with the performer."""

import numpy as np
from perfanim.core.body.motion import Motion
from perfanim.core.body.motion_metrics import CONTACT
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.soles import upright_foot
from perfanim.core.body.window_filters import smallest
from perfanim.core.geometry import rotations as rot
from perfanim.core.retarget.armature_rest import ArmatureRest
from perfanim.core.retarget.character_rest_pose import bone_direction
from perfanim.core.retarget.rest_alignment import BONE_ENDS
from perfanim.core.retarget.retargeter import CharacterPose, RetargetPlan

LIMBS = ("femur", "tibia", "humerus", "radius", "hand")


def pose_bones(rest: ArmatureRest, made: RetargetPlan, pose: CharacterPose) -> tuple[np.ndarray, np.ndarray]:
    """Heads (F, B, 3) and rotations (F, B, 4) of all bones in the object's parent space: Blender's own rules."""
    frames = len(pose.rotations)
    count = len(rest)
    basis, location = rot.identity((frames, count)), np.zeros((frames, count, 3))
    for place, name in enumerate(made.bones):
        basis[:, rest.index[name]] = pose.rotations[:, place]
    for place, name in enumerate(made.located):
        location[:, rest.index[name]] = pose.locations[:, place]
    axes = rot.from_matrix(rest.axes)
    heads, turns = np.zeros((frames, count, 3)), np.zeros((frames, count, 4))
    for bone in range(count):
        parent = int(rest.parents[bone])
        if parent >= 0:
            back = rot.conjugate(axes[parent])
            turn = rot.multiply(turns[:, parent], rot.multiply(back, axes[bone]))
            head = heads[:, parent] + rot.rotate(
                turns[:, parent], rot.rotate(back, rest.heads[bone] - rest.heads[parent])
            )
        else:
            turn, head = np.broadcast_to(axes[bone], (frames, 4)), np.broadcast_to(rest.heads[bone], (frames, 3))
        moved = rot.rotate(turn, location[:, bone]) if rest.local_location[bone] else location[:, bone]
        if rest.connected[bone] and parent >= 0:
            moved = np.zeros(3)
        heads[:, bone] = head + moved
        turns[:, bone] = rot.multiply(turn, basis[:, bone])
    if pose.object_rotation is None:
        return heads, turns
    heads = rot.rotate(pose.object_rotation[:, None], heads) + pose.object_location[:, None]
    return heads, rot.multiply(pose.object_rotation[:, None], turns)


def to_performer(made: RetargetPlan, heads: np.ndarray) -> np.ndarray:
    """Points of the armature in the performer's axes and metres."""
    return heads @ made.alignment.armature_from_world / made.alignment.units_per_metre


def direction_errors_deg(
    motion: Motion, rest: ArmatureRest, made: RetargetPlan, turns: np.ndarray
) -> dict[str, np.ndarray]:
    """(F,) angle between where a bone points and where the performer's does, by joint, degrees.

    Feet point as their rest pose's heading does, flat on the floor: ankles are of different height.
    """
    _, world = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    frame, heads = made.alignment.armature_from_world, made.alignment.heads_m
    tails = rest.tails @ frame / made.alignment.units_per_metre
    axes = rot.from_matrix(rest.axes)
    errors = {}
    for side in "lr":
        for kind in (*LIMBS, "foot"):
            name = side + kind
            if name not in made.joints:
                continue
            bone, joint = made.joints[name], motion.skeleton.index(name)
            if kind == "foot":
                if side + "toes" not in made.joints:
                    continue
                upright = upright_foot(motion.skeleton, side)
                own = rot.rotate(upright, motion.skeleton.offsets_m[motion.skeleton.index(side + "toes")])
                own = rot.rotate(rot.conjugate(upright), own * [1.0, 0.0, 1.0])
                way = (heads[made.joints[side + "toes"]] - heads[bone]) * [1.0, 0.0, 1.0]
            else:
                way = bone_direction(name, rest, made.joints, heads, tails)
                if way is None:
                    continue
                ends = [side + end for end in BONE_ENDS[kind] if side + end in made.joints]
                end = ends[0] if ends else None
                positions = motion.skeleton.rest_positions_m
                own = positions[motion.skeleton.index(end)] - positions[joint] if end else motion.skeleton.tips_m[joint]
            moved = rot.multiply(turns[:, bone], rot.conjugate(axes[bone]))
            mine = rot.rotate(moved, frame @ way) @ frame
            theirs = rot.rotate(world[:, joint], own)
            cosine = np.sum(mine * theirs, axis=-1) / np.linalg.norm(mine, axis=-1) / np.linalg.norm(theirs, axis=-1)
            errors[name] = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return errors


def slides_cm_s(motion: Motion, made: RetargetPlan, heads: np.ndarray) -> tuple[float, float]:
    """Mean horizontal speed of what the feet stand on while the performer's stand, character's and performer's.

    The balls of the feet, or the ankles of a character that has no toes; in the performer's centimetres per second.
    """
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    ball = [motion.skeleton.index(side + "toes") for side in "lr"]
    velocity = np.diff(positions[:, ball], axis=0) * motion.fps
    height = 0.5 * (positions[1:, ball, 1] + positions[:-1, ball, 1])
    low = height < smallest(height, round(motion.fps)) + CONTACT.height_m
    contact = low & (np.linalg.norm(velocity, axis=-1) < CONTACT.speed_m_s)
    kind = "toes" if "ltoes" in made.joints else "foot"
    own = np.diff(positions[:, [motion.skeleton.index(side + kind) for side in "lr"]], axis=0) * motion.fps
    mine = np.diff(to_performer(made, heads[:, [made.joints[side + kind] for side in "lr"]]), axis=0) * motion.fps
    speed = [100.0 * float(np.mean(np.linalg.norm(v[..., [0, 2]], axis=-1)[contact])) for v in (mine, own)]
    return speed[0], speed[1]
