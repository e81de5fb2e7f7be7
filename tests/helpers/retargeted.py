"""How a character of others moves, as Blender evaluates it, compared with the performer."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from perfanim.core.body.motion import Motion
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.soles import upright_foot
from perfanim.core.geometry import rotations as rot
from perfanim.perfanim_addon.character.axes import BLENDER_FROM_WORLD

LIMBS = (("humerus", "radius"), ("radius", "hand"), ("hand", "fingers"), ("foot", "toes"))
_STANDS_M_S = 0.15
_SPREAD_RAD = np.radians(15.0)


@dataclass(frozen=True)
class Played:
    """What was measured of a motion on a character.

    Args:
        direction_deg: limb -> (F,) angle between where it points and where the performer's does.
        slide_cm_s: mean horizontal speed of the feet while the performer's stand, in the performer's centimetres.
        own_slide_cm_s: of the performer's feet then.
        standing: how many frames of a foot these are.
        turn_deg: most that a bone turns from one frame to the next.
        own_turn_deg: most that a joint of the performer does.
        arms_down_deg: how far the upper arms hang in the character's rest pose: 0 a T pose.
    """

    direction_deg: dict[str, np.ndarray]
    slide_cm_s: float
    own_slide_cm_s: float
    standing: int
    turn_deg: float
    own_turn_deg: float
    arms_down_deg: float


def played(
    armature_object: bpy.types.Object, frames: int, bones: Iterable[str], first: int = 1
) -> dict[str, np.ndarray]:
    """Matrices (F, 4, 4) of evaluated bones in the scene, one frame of the motion after the other."""
    scene = bpy.context.scene
    found: dict[str, list[np.ndarray]] = {name: [] for name in bones}
    for frame in range(first, first + frames):
        scene.frame_set(frame)
        posed = armature_object.evaluated_get(bpy.context.evaluated_depsgraph_get())
        for name in found:
            found[name].append(np.array(posed.matrix_world @ posed.pose.bones[name].matrix))
    return {name: np.array(matrices) for name, matrices in found.items()}


def turned(matrices: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Rotations (F, 3, 3) in the scene since the rest pose."""
    both = [m[..., :3, :3] / np.linalg.norm(m[..., :3, :3], axis=-2, keepdims=True) for m in (matrices, rest)]
    return both[0] @ np.swapaxes(both[1], -1, -2)


def measured(done: dict[str, Any], motion: Motion) -> Played:
    """Measure what `retarget_file` has done; its scene is open, at one frame of the motion a frame."""
    armature_object = bpy.data.objects[done["armature"]]
    bones = done["mapped"]
    found = played(armature_object, motion.frames, bones.values())
    rest = {b.name: np.array(armature_object.matrix_world @ b.matrix_local) for b in armature_object.data.bones}
    since = {joint: turned(found[bone], rest[bone]) for joint, bone in bones.items()}
    positions, world = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    directions, hanging = {}, []
    for side in "lr":
        for start, end in LIMBS:
            if side + start not in bones or side + end not in bones:
                continue
            way = rest[bones[side + end]][:3, 3] - rest[bones[side + start]][:3, 3]
            own = motion.skeleton.rest_positions_m
            own = own[motion.skeleton.index(side + end)] - own[motion.skeleton.index(side + start)]
            if start == "humerus":
                hanging.append(np.degrees(np.arctan2(-way[2], np.hypot(way[0], way[1]))))
            if start == "foot":  # ankles are of different height: what is flat on the floor is compared
                upright = upright_foot(motion.skeleton, side)
                flat = rot.rotate(upright, own) * [1.0, 0.0, 1.0]
                own = rot.rotate(rot.conjugate(upright), flat)
                leg = rest[bones[side + "foot"]][:3, 3] - rest[bones[side + "femur"]][:3, 3]
                lean = rot.between(leg * [1.0, 0.0, 1.0], np.array([0.0, 0.0, -1.0]))
                # spread legs have tilted feet, as in the product's own rest pose
                level = lean if rot.angle_between(lean, rot.identity()) > _SPREAD_RAD else rot.identity()
                way = rot.rotate(rot.conjugate(level), rot.rotate(level, way) * [1.0, 1.0, 0.0])
            mine = since[side + start] @ way
            theirs = rot.rotate(world[:, motion.skeleton.index(side + start)], own) @ BLENDER_FROM_WORLD.T
            cosine = np.sum(mine * theirs, axis=-1) / np.linalg.norm(mine, axis=-1) / np.linalg.norm(theirs, axis=-1)
            directions[side + start] = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    kind = "toes" if "ltoes" in bones else "foot"
    scale = done["scale"] * float(np.mean(np.array(armature_object.matrix_world.to_scale())))
    own_feet = positions[:, [motion.skeleton.index(side + kind) for side in "lr"]] @ BLENDER_FROM_WORLD.T
    feet = np.stack([found[bones[side + kind]][:, :3, 3] for side in "lr"], axis=1) / scale
    standing = np.linalg.norm(np.diff(own_feet, axis=0), axis=-1) * motion.fps < _STANDS_M_S
    own_speed, speed = (
        np.linalg.norm(np.diff(each, axis=0)[..., :2], axis=-1) * motion.fps for each in (own_feet, feet)
    )
    return Played(
        directions,
        100.0 * float(np.mean(speed[standing])),
        100.0 * float(np.mean(own_speed[standing])),
        int(np.count_nonzero(standing)),
        max(_fastest(rot.from_matrix(matrices)) for matrices in since.values()),
        _fastest(world),
        float(np.mean(hanging)) if hanging else float("nan"),
    )


def _fastest(turns: np.ndarray) -> float:
    return float(np.degrees(np.max(rot.angle_between(turns[1:], turns[:-1]))))
