"""Open an FBX file in Blender, measure its motion, and draw its middle frame.

python -m walks.fbx_picture walk.fbx walk.png
"""

import sys
from pathlib import Path

import bpy
import numpy as np
from perfanim.perfanim_addon.export.stage import add_stage, render, set_up_rendering


def main(arguments: list[str]) -> int:
    """Draw the picture; return 1 where nothing moves."""
    source, target = (Path(argument) for argument in arguments)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.fbx(filepath=str(source))
    scene = bpy.context.scene
    armature = next(obj for obj in scene.objects if obj.type == "ARMATURE")
    first, last = (round(frame) for frame in armature.animation_data.action.frame_range)
    paths = []
    for frame in np.linspace(first, last, 9).round().astype(int).tolist():
        scene.frame_set(frame)
        paths.append([armature.matrix_world @ bone.head for bone in armature.pose.bones])
    points = np.array(paths, dtype=np.float64)
    moved = float(np.max(np.ptp(points, axis=0)))
    sys.stdout.write(
        f"{source.name}: {len(armature.pose.bones)} bones, frames {first} to {last}, moves {moved:.2f} m\n"
    )
    scene.frame_set((first + last) // 2)
    set_up_rendering(scene)
    scene.render.resolution_x, scene.render.resolution_y = 320, 400
    add_stage(scene, points[len(points) // 2], float(points[..., 2].min()))
    render(scene, target)
    return 0 if moved > 0.1 else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
