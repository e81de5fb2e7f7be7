"""Write a .blend with a sketch: a walk, a turn and two punches from twelve keys.

    python tools/sketch_sample.py --out out/sketch/sketch-sample.blend

The motion is drawn from the starter motion. With --render FOLDER, pictures of some frames and a contact sheet.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import bpy
import cv2
import numpy as np
from mathutils import Vector
from perfanim.core.cli.main import main as perfanim
from perfanim.core.database.store import open_database
from perfanim.core.sketch.sketch_messages import solution_from, solution_table
from perfanim.core.sketch.solve_sketch import solve_sketch
from perfanim.core.system.assets import MOTION
from perfanim.perfanim_addon import registration
from perfanim.perfanim_addon.export.stage import render, set_up_rendering
from perfanim.perfanim_addon.sketch.controls import controls_of
from perfanim.perfanim_addon.sketch.read_controls import read_controls
from perfanim.perfanim_addon.sketch.write_solution import SketchBody, write_solution

FPS = 30
MARK = (0.0, -2.0)  # on the floor; the walk begins at the origin, towards -y
HIPS, ANKLE, CHEST, GUARD, FIST = 0.99, 0.08, 1.22, 1.32, 1.42  # heights above the floor
# joint -> frame -> place in the scene; after the turn the character faces +x
KEYS = {
    "root": {1: (0.0, 0.0, HIPS), 40: (0.0, -1.05, HIPS), 75: (*MARK, HIPS), 104: (*MARK, HIPS - 0.02)},
    "lfoot": {78: (0.09, MARK[1] - 0.04, ANKLE), 104: (0.16, MARK[1] + 0.12, ANKLE)},
    "rfoot": {104: (-0.16, MARK[1] - 0.12, ANKLE)},
    "thorax": {75: (0.0, MARK[1] - 0.01, CHEST)},
    "lhand": {104: (0.30, MARK[1] + 0.12, GUARD), 130: (0.66, MARK[1] + 0.04, FIST)},
    "rhand": {104: (0.22, MARK[1] - 0.14, GUARD), 117: (0.66, MARK[1] - 0.02, FIST)},
}
SHOWN = (1, 10, 19, 28, 37, 46, 55, 64, 73, 85, 93, 100, 108, 115, 122, 130)


def main() -> None:
    """Write the file, and on wish its pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help=".blend to write")
    parser.add_argument("--render", type=Path, help="folder for pictures")
    options = parser.parse_args()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    registration.register()
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start = FPS, 1
    bpy.ops.perfanim.add_controls()
    armature = scene.perfanim.armature
    armature.perfanim_sketch.parts = {"HANDS", "CHEST"}
    bpy.ops.perfanim.add_controls()
    armature.perfanim_sketch.behaviours = "walking, transition walking, boxing"
    for joint, keys in KEYS.items():
        control = controls_of(armature)[joint]
        for frame, place in keys.items():
            control.location = place
            control.keyframe_insert("location", frame=frame)
    sys.stdout.write(f"{_solve(armature)}\n")
    options.out.parent.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(options.out.resolve()))
    if options.render:
        _render(options.render)


def _solve(armature: bpy.types.Object) -> str:
    with tempfile.TemporaryDirectory() as folder:
        built = Path(folder) / "starter.pfdb"
        perfanim(["database", "build", str(MOTION), "--out", str(built)])
        body, chosen = SketchBody.of(armature), armature.perfanim_sketch.solver_settings()
        sketch = read_controls(bpy.context, armature, body.space)
        solution = solve_sketch(sketch, body.skeleton, open_database(built), chosen)
    solved = solution_from(solution_table(solution, 0))
    return write_solution(bpy.context, armature, sketch, chosen, solved)


def _render(folder: Path) -> None:
    """Render some frames, and all of them side by side."""
    scene = bpy.context.scene
    set_up_rendering(scene)
    scene.cycles.samples = 4
    scene.render.resolution_x, scene.render.resolution_y = 320, 240
    bpy.ops.mesh.primitive_plane_add(size=30.0, location=(0.0, -1.5, 0.0))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    camera.location = (4.6, -3.6, 1.8)
    camera.rotation_euler = (Vector((0.0, -1.4, 0.85)) - camera.location).to_track_quat("-Z", "Y").to_euler()
    scene.camera = camera
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.rotation_euler, sun.data.energy = (0.6, 0.4, 0.3), 3.0
    scene.collection.objects.link(sun)
    folder.mkdir(parents=True, exist_ok=True)
    pictures = []
    for frame in SHOWN:
        scene.frame_set(frame)
        target = folder / f"{frame:03d}.png"
        render(scene, target)
        pictures.append(cv2.imread(str(target)))
    rows = [np.hstack(pictures[start : start + 4]) for start in range(0, len(pictures), 4)]
    cv2.imwrite(str(folder / "sheet.png"), np.vstack(rows))


if __name__ == "__main__":
    main()
