"""Motion files of the core as Blender's own importers read them."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.formats.motion.write_motion import write_motion
from perfanim.core.formats.vmc.humanoid import BONES
from perfanim.core.retarget.displayed_joint_names import NAMINGS
from perfanim.core.system.assets import MOTION
from perfanim.perfanim_addon.character.axes import BLENDER_FROM_WORLD

SAME_M = 0.001


@pytest.fixture(scope="module")
def motion() -> Motion:
    return sliced(read_motion(next(MOTION.glob("running-01*.bvh"))), 30, 50)


@pytest.fixture
def wanted(motion: Motion) -> np.ndarray:
    """Joints (F, J, 3) in Blender's world, in an empty scene of the motion's rate."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = round(motion.fps)
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    return positions @ BLENDER_FROM_WORLD.T


def places(objects: list, bone: str, frames: list[float]) -> np.ndarray:
    """World positions (F, 3) of a bone's head, or of an empty of that name."""
    found = []
    for frame in frames:
        bpy.context.scene.frame_set(int(frame))
        depsgraph = bpy.context.evaluated_depsgraph_get()
        armature = next((obj for obj in objects if obj.type == "ARMATURE"), None)
        if armature is None:
            named = next(obj for obj in objects if obj.name == bone)
            found.append(np.array(named.evaluated_get(depsgraph).matrix_world.translation))
        else:
            posed = armature.evaluated_get(depsgraph)
            found.append(np.array(posed.matrix_world @ posed.pose.bones[bone].head))
    return np.array(found)


@pytest.mark.parametrize(("naming", "units", "scale"), [("unreal", "cm", 0.01), ("mixamo", "m", 1.0)])
def test_bvh_joints_are_where_they_were(motion, wanted, tmp_path: Path, naming, units, scale):
    write_motion(motion, tmp_path / "run.bvh", units, naming)
    bpy.ops.import_anim.bvh(filepath=str(tmp_path / "run.bvh"), global_scale=scale)
    frames = list(range(1, motion.frames + 1))
    for joint, name in NAMINGS[naming].items():
        found = places(list(bpy.data.objects), name, frames)
        apart = np.linalg.norm(found - wanted[:, motion.skeleton.index(joint)], axis=1)
        assert apart.max() < SAME_M, joint


def test_a_vrm_animation_is_gltf_whose_bones_are_where_the_joints_were(motion, wanted, tmp_path: Path):
    write_motion(motion, tmp_path / "run.vrma")
    (tmp_path / "run.vrma").rename(tmp_path / "run.glb")  # the importer goes by the ending
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "run.glb"))
    objects, frames = list(bpy.data.objects), list(range(1, motion.frames + 1))
    start = min(round(obj.animation_data.action.frame_range[0]) for obj in objects if obj.animation_data)
    for bone, (joint, _) in BONES.items():
        if bone == "Head":  # it hangs on a second joint of the neck, which humanoids lack
            continue
        found = places(objects, bone[0].lower() + bone[1:], [frame - 1 + start for frame in frames])
        apart = np.linalg.norm(found - wanted[:, motion.skeleton.index(joint)], axis=1)
        assert apart.max() < SAME_M, bone
