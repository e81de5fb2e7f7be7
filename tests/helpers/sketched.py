"""Sketches of a walk: its keys, solved and played as an animator would."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
from clicked import run_job
from perfanim.core.body.motion import Motion
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.sketch.sketch_file import Control, Sketch

JOINTS = ("root", "lfoot", "rfoot", "lhand", "rhand")
EVERY = 12
MET = 0.006  # of the scene's metre: a key is met within 5 mm, and keyframes are float32
PATIENCE_S = 120.0


def sketch_of(walk: Motion, first: int = 11) -> Sketch:
    positions = forward_kinematics(walk.skeleton, walk.rotations, walk.root_positions_m)[0]
    at = np.arange(0, walk.frames, EVERY)
    places = {joint: positions[at, walk.skeleton.index(joint)] for joint in JOINTS}
    return Sketch("walk", 30.0, tuple(Control(joint, at + float(first), points) for joint, points in places.items()))


def key(part: Any, armature: bpy.types.Object, walk: Motion) -> None:
    controls, space = part("sketch.controls"), part("sketch.write_solution").SketchBody.of(armature).space
    controls.add_controls(bpy.context, armature, space, JOINTS)
    controls.set_keys(armature, sketch_of(walk), space)


def solve(part: Any, operator: str = "PERFANIM_OT_solve_sketch") -> str:
    found = getattr(part("operators.sketch_operators"), operator)
    clicked = SimpleNamespace()
    clicked.bounds = lambda context: found.bounds(clicked, context)
    return run_job(part, found, clicked)


def distances(part: Any, armature: bpy.types.Object, frames: Any) -> dict[str, list[float]]:
    """Distance of each control from its bone, in the scene."""
    bones = part("character.retarget_plans").bones_of(armature)
    found: dict[str, list[float]] = {}
    for frame in frames:
        bpy.context.scene.frame_set(int(frame))
        graph = bpy.context.evaluated_depsgraph_get()
        posed = armature.evaluated_get(graph)
        for joint, control in part("sketch.controls").controls_of(armature).items():
            head = posed.matrix_world @ posed.pose.bones[bones[joint]].head
            away = (head - control.evaluated_get(graph).matrix_world.translation).length
            found.setdefault(joint, []).append(away)
    return found


@contextmanager
def played_live(part: Any) -> Iterator[Any]:
    """Click Live, and give its module; the test is the timer, and it ends with the block."""
    module = part("sketch.live_sketch")
    assert bpy.ops.perfanim.live_sketch() == {"FINISHED"}
    bpy.app.timers.unregister(module._tick)
    try:
        yield module
    finally:
        module.end()


def play(part: Any) -> None:
    """Be Blender's timer until all edits are solved."""
    live = part("sketch.live_sketch").current()
    limit_s = time.monotonic() + PATIENCE_S
    live.tick(bpy.context)
    while not live.idle:
        live.tick(bpy.context)
        assert time.monotonic() < limit_s
        time.sleep(0.002)


def drawn_path(part: Any, armature: bpy.types.Object) -> bpy.types.Object:
    """An arc that the mouse would draw: a metre and a half ahead and to the left."""
    assert bpy.ops.perfanim.draw_hips_path() == {"FINISHED"}
    path = bpy.context.view_layer.objects.active
    assert (path.type, path.mode) == ("CURVE", "EDIT")
    bpy.ops.object.mode_set(mode="OBJECT")
    spline = path.data.splines.new("POLY")
    spline.points.add(30)
    for point, angle in zip(spline.points, np.linspace(0.0, np.pi / 2.0, 31), strict=True):
        point.co = (1.5 - 1.5 * np.cos(angle), -1.5 * np.sin(angle), 0.0, 1.0)
    return path


def drawn_hand(part: Any, armature: bpy.types.Object) -> bpy.types.Object:
    """The left hand with three keys of its own."""
    hand = part("sketch.controls").controls_of(armature)["lhand"]
    hand.animation_data_clear()
    for frame, place in ((1, (0.0, 0.0, 1.0)), (11, (0.4, 0.1, 1.3)), (31, (0.6, 0.0, 0.9))):
        hand.location = place
        hand.keyframe_insert("location", frame=frame)
    return hand
