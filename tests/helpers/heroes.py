"""A character under another product's names, and motion to put on it."""

from pathlib import Path

import bpy
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.retarget.displayed_joint_names import NAMINGS
from perfanim.core.system.assets import MOTION
from perfanim.perfanim_addon.character.create_character import create_character

MIXAMO = {
    "root": "Hips", "lowerback": "Spine", "upperback": "Spine1", "thorax": "Spine2", "lowerneck": "Neck",
    "upperneck": "Neck1", "head": "Head", "clavicle": "Shoulder", "humerus": "Arm", "radius": "ForeArm",
    "hand": "Hand", "fingers": "HandMiddle1", "thumb": "HandThumb1", "femur": "UpLeg", "tibia": "Leg",
    "foot": "Foot", "toes": "ToeBase",
}  # fmt: skip


def clip(name: str, frames: int = 60) -> Motion:
    return sliced(read_motion(MOTION / f"{name}.bvh"), 0, frames)


def at_24_fps(motion: Motion) -> Motion:
    """A .blend keeps the rate of its scene: slower, each frame falls on one of the scene's."""
    return Motion(motion.name, 24.0, motion.skeleton, motion.rotations, motion.root_positions_m)


def save_hero(path: Path) -> None:
    """Write the product's character, called Hero, with Mixamo's names to a .blend; what is open is lost."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    name = create_character(bpy.context, default_skeleton(), "Hero")
    for bone in bpy.data.objects[name].data.bones:
        joint = next(joint for joint, own in NAMINGS["blender"].items() if own == bone.name)
        side = {"l": "Left", "r": "Right"}.get(joint[0], "") if joint[1:] in MIXAMO else ""
        bone.name = "mixamorig:" + side + MIXAMO.get(joint if not side else joint[1:], joint)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))


def open_hero(path: Path) -> bpy.types.Object:
    """Open that .blend; return Hero."""
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.data.objects["Hero"]
