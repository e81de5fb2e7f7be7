"""Write a .blend with a sketch: a walk, a turn and two punches from twelve keys.

    python tools/sketch_sample.py --out out/sketch/sketch-sample.blend

The motion is drawn from the starter database.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import bpy
from perfanim.core.database.build_database import build_database
from perfanim.core.database.store import open_database
from perfanim.core.sketch.sketch_messages import solution_from, solution_table
from perfanim.core.sketch.solve_sketch import SketchSolver
from perfanim.core.system.assets import MOTION
from perfanim.perfanim_addon import registration
from perfanim.perfanim_addon.sketch.controls import controls_of
from perfanim.perfanim_addon.sketch.read_controls import read_controls
from perfanim.perfanim_addon.sketch.write_solution import SketchBody, write_solution

FPS = 30
MARK = (0.0, -2.0)  # position on the floor; the walk begins at the origin, towards -y
HIPS, ANKLE, CHEST, GUARD, FIST = 0.99, 0.08, 1.22, 1.32, 1.42  # heights above the floor
# joint -> frame -> position in the scene; after the turn the character faces +x
KEYS = {
    "root": {1: (0.0, 0.0, HIPS), 40: (0.0, -1.05, HIPS), 75: (*MARK, HIPS), 104: (*MARK, HIPS - 0.02)},
    "lfoot": {78: (0.09, MARK[1] - 0.04, ANKLE), 104: (0.16, MARK[1] + 0.12, ANKLE)},
    "rfoot": {104: (-0.16, MARK[1] - 0.12, ANKLE)},
    "thorax": {75: (0.0, MARK[1] - 0.01, CHEST)},
    "lhand": {104: (0.30, MARK[1] + 0.12, GUARD), 130: (0.66, MARK[1] + 0.04, FIST)},
    "rhand": {104: (0.22, MARK[1] - 0.14, GUARD), 117: (0.66, MARK[1] - 0.02, FIST)},
}


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help=".blend to write")
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
        for frame, place in keys.items():
            controls_of(armature)[joint].location = place
            controls_of(armature)[joint].keyframe_insert("location", frame=frame)
    sys.stdout.write(f"{_solve(armature)}\n")
    options.out.parent.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(options.out.resolve()))


def _solve(armature: bpy.types.Object) -> str:
    body, chosen = SketchBody.of(armature), armature.perfanim_sketch.solver_settings()
    sketch = read_controls(bpy.context, armature, body.space)
    with tempfile.TemporaryDirectory() as folder:
        build_database([MOTION], Path(folder) / "starter.pfdb")
        solution = SketchSolver(body.skeleton, open_database(Path(folder) / "starter.pfdb")).solve(sketch, chosen)
    return write_solution(bpy.context, armature, sketch, chosen, solution_from(solution_table(solution, 0)))


if __name__ == "__main__":
    main()
