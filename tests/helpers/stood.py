"""Where the feet of a character of others are, as Blender evaluates its meshes, compared with the performer's."""

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from perfanim.core.body.motion import Motion
from perfanim.core.body.motion_metrics import CONTACT
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.geometry.arrays import runs
from retargeted import played

_FOOT_M = 0.5  # farther than this from the ankle, a vertex is not the foot's; large shoes reach 0.45 m


@dataclass(frozen=True)
class Stood:
    """What was measured, in the performer's millimetres.

    Args:
        soles_mm: (F, 2) height of the lowest point of each foot above the floor.
        slide_mm: farthest that the ball of a foot comes from its mean place while the performer's stands.
        own_slide_mm: the same of the performer.
        standing: (F, 2) frames in which the performer's feet stand.
    """

    soles_mm: np.ndarray
    slide_mm: float
    own_slide_mm: float
    standing: np.ndarray


def stood(done: dict[str, Any], motion: Motion, first: int = 1) -> Stood:
    """Measure what `retarget_file` has done; its scene is open, at one frame of the motion a frame from the `first`."""
    armature_object = bpy.data.objects[done["armature"]]
    bones = done["mapped"]
    scale = done["scale"] * _world_scale(done)
    feet = [bones[side + "foot"] for side in "lr"]
    matrices = played(armature_object, motion.frames, feet, first)
    ankles = np.stack([matrices[foot][:, :3, 3] for foot in feet], axis=1)
    floor = float(armature_object.matrix_world.translation.z)
    ends = done.get("ends") or _ends(armature_object, feet)
    soles = np.array(
        [_lowest(armature_object, ends, first + frame, ankles[frame], scale) for frame in range(motion.frames)]
    )
    own = scale / done["scale"]
    balls = [
        (matrices[foot] @ [*(ball / own), 1.0])[:, :3]
        for foot, ball in zip(feet, done.get("balls") or _balls(done), strict=True)
    ]
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    own_balls = positions[:, [motion.skeleton.index(side + "toes") for side in "lr"]]
    speed = np.linalg.norm(np.diff(own_balls, axis=0, prepend=own_balls[:1]), axis=-1) * motion.fps
    standing = (speed < CONTACT.speed_m_s) & (own_balls[..., 1] < own_balls[..., 1].min(axis=0) + CONTACT.height_m)
    return Stood(
        1000.0 * (soles - floor) / scale,
        1000.0 * _drift(np.stack(balls, axis=1)[..., :2] / scale, standing),
        1000.0 * _drift(own_balls[..., [0, 2]], standing),
        standing,
    )


def read_back(done: dict[str, Any], fps: float) -> tuple[dict[str, Any], int]:
    """Open what `retarget_file` has written as FBX or glTF; return its report for that scene, and its first frame."""
    before = _world_scale(done)
    # the formats keep no tails of bones and, without a mesh, no rest pose: the points that are looked at come along
    ends = _ends(bpy.data.objects[done["armature"]], [done["mapped"][side + "foot"] for side in "lr"])
    balls = _balls(done)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = round(fps)
    is_fbx = done["out"].endswith(".fbx")
    if is_fbx:
        bpy.ops.import_scene.fbx(filepath=done["out"], anim_offset=0.0)
    else:
        bpy.ops.import_scene.gltf(filepath=done["out"])
    again = done | {"armature": next(obj.name for obj in bpy.data.objects if obj.type == "ARMATURE")}
    if is_fbx:
        _disconnect(bpy.data.objects[again["armature"]])
    return again | {"scale": done["scale"] * before / _world_scale(again), "ends": ends, "balls": balls}, int(is_fbx)


def _balls(done: dict[str, Any]) -> list[np.ndarray]:
    """For each foot the place of its ball in the bone's axes, in units of the scene."""
    armature_object, bones, own = bpy.data.objects[done["armature"]], done["mapped"], _world_scale(done)
    found = []
    for side in "lr":
        rest = np.array(armature_object.matrix_world @ armature_object.data.bones[bones[side + "foot"]].matrix_local)
        toes = bones.get(side + "toes")
        place = (
            np.array(armature_object.matrix_world @ armature_object.data.bones[toes].head_local)
            if toes
            else rest[:3, 3] + done["scale"] * own * np.array([0.0, -0.13, -0.04])
        )
        found.append(own * (np.linalg.inv(rest) @ np.append(place, 1.0))[:3])
    return found


def _disconnect(armature_object: bpy.types.Object) -> None:
    """Free the hips that Blender's FBX importer connects to the bone above, as docs/export.md advises."""
    bpy.context.view_layer.objects.active = armature_object
    bpy.ops.object.mode_set(mode="EDIT")
    for bone in armature_object.data.edit_bones:
        bone.use_connect = False
    bpy.ops.object.mode_set(mode="OBJECT")


def _world_scale(done: dict[str, Any]) -> float:
    return float(np.mean(np.array(bpy.data.objects[done["armature"]].matrix_world.to_scale())))


def _drift(places: np.ndarray, standing: np.ndarray) -> float:
    worst = 0.0
    for foot in range(2):
        for start, stop in runs(standing[:, foot]):
            way = places[start:stop, foot] - places[start:stop, foot].mean(axis=0)
            worst = max(worst, float(np.linalg.norm(way, axis=-1).max()))
    return worst


def _ends(armature_object: bpy.types.Object, feet: list[str]) -> list[list[tuple[str, np.ndarray]]]:
    """For each foot the ends of its bones: bone, and place in the bone's axes, in units of the scene."""
    scale, found = float(np.mean(np.array(armature_object.matrix_world.to_scale()))), []
    for name in feet:
        foot = armature_object.data.bones[name]
        below = [(bone.name, end) for bone in foot.children_recursive for end in (bone.head_local, bone.tail_local)]
        ends = [(name, foot.head_local), *(below or [(name, foot.tail_local)])]
        axes = {bone: np.linalg.inv(np.array(armature_object.data.bones[bone].matrix_local)) for bone, _ in ends}
        found.append([(bone, scale * (axes[bone] @ [*end, 1.0])[:3]) for bone, end in ends])
    return found


def _lowest(
    armature_object: bpy.types.Object,
    ends: list[list[tuple[str, np.ndarray]]],
    frame: int,
    ankles: np.ndarray,
    scale: float,
) -> list[float]:
    """Heights in the scene of the lowest points of both feet: of the meshes, or else of the bones."""
    bpy.context.scene.frame_set(frame)
    graph = bpy.context.evaluated_depsgraph_get()
    points = []
    for mesh_object in bpy.context.scene.objects:
        if mesh_object.type == "MESH" and mesh_object.find_armature() == armature_object and mesh_object.vertex_groups:
            evaluated = mesh_object.evaluated_get(graph)
            mesh = evaluated.to_mesh()
            places = np.empty(3 * len(mesh.vertices), dtype=np.float32)
            mesh.vertices.foreach_get("co", places)
            world = np.array(evaluated.matrix_world)
            points.append(places.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3])
            evaluated.to_mesh_clear()
    if points:
        every = np.concatenate(points)
        away = np.linalg.norm(every[:, None] - ankles, axis=-1)
        near = [(away[:, foot] < _FOOT_M * scale) & (away[:, foot] <= away[:, 1 - foot]) for foot in range(2)]
        if min(np.count_nonzero(each) for each in near) > 20:  # else the mesh is something else, and the bones stand
            return [float(every[each, 2].min()) for each in near]
    posed = armature_object.evaluated_get(graph)
    own = float(np.mean(np.array(posed.matrix_world.to_scale())))
    moved = {name: np.array(posed.matrix_world @ posed.pose.bones[name].matrix) for foot in ends for name, _ in foot}
    return [min(float((moved[name] @ [*(place / own), 1.0])[2]) for name, place in foot) for foot in ends]
