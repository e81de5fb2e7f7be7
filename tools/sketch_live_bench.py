"""Measure live edits of a sketch in Blender: 250 frames, one key after the other.

    python tools/sketch_live_bench.py out/sketch/sketch-sample.blend

Needs the file that `make sketch-sample` writes; its keys are spread over 250 frames. For each edit: the time to the
first picture, to the whole motion, and the longest that Blender's process was held up, in ms and as multiples of one
exhaustive search by numpy in the same run. Other programs make them longer, so the processor time of Blender's own work
in a step, that of the worker (on Linux) and the load are printed as well.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bench.speed import reference_ms
from perfanim.core.cli.main import main as perfanim
from perfanim.core.system.assets import MOTION
from perfanim.perfanim_addon import registration
from perfanim.perfanim_addon.blender_versions import action_curves
from perfanim.perfanim_addon.sketch import live_sketch
from perfanim.perfanim_addon.sketch.controls import controls_of

FRAMES = 250
EDITS = 20
MOVED_M = 0.03
TITLES = ("first picture", "whole motion", "Blender held up", "of its own work", "the worker's processor")


def main() -> None:
    """Run and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sample", type=Path)
    options = parser.parse_args()
    registration.register()
    bpy.ops.wm.open_mainfile(filepath=str(options.sample.resolve()))
    armature = bpy.context.scene.perfanim.armature
    curves = [list(action_curves(control)) for control in controls_of(armature).values()]
    last = max(key.co.x for each in curves for curve in each for key in curve.keyframe_points)
    for curve in (curve for each in curves for curve in each):
        for key in curve.keyframe_points:
            key.co.x = round(1.0 + (key.co.x - 1.0) * (FRAMES - 1) / (last - 1.0))
        curve.update()
    bpy.context.scene.frame_set(FRAMES // 2)
    with tempfile.TemporaryDirectory() as folder:
        database = str(Path(folder) / "starter.pfdb")
        perfanim(["database", "build", str(MOTION), "--out", database])
        armature.perfanim_sketch.action = None  # the first motion makes one
        live_sketch.begin(bpy.context, armature.name, database, None)
        begun = 1e3 * np.array(_played(live_sketch.current()))
        random, rows = np.random.default_rng(0), []
        for number in range(EDITS):
            for curve in curves[number % len(curves)]:
                key = curve.keyframe_points[number % len(curve.keyframe_points)]
                key.co.y += random.normal(0.0, MOVED_M)
                curve.update()
            rows.append(_played(live_sketch.current()))
        live_sketch.end()
    reference, _ = reference_ms()
    for title, column in zip(TITLES, 1e3 * np.array(rows).T, strict=True):
        median, most = np.median(column), np.max(column)
        text = (
            f"{title}: median {median:.0f} ms, most {most:.0f} ms; {median / reference:.1f} and {most / reference:.1f}"
        )
        sys.stdout.write(f"{text} searches of {reference:.1f} ms\n")
    sys.stdout.write(
        f"first motion, into a new action: Blender held up {begun[2]:.0f} ms, own work {begun[3]:.0f} ms\n"
    )
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    sys.stdout.write(f"load {load} on {os.cpu_count()} processors\n")


def _played(live: Any) -> tuple[float, float, float, float, float]:
    """Be Blender's timer until the edit is solved; return five times in seconds."""
    live.noted, used = True, _processor_s(live.worker_id)
    shown, began, first, held, own = live.shown, time.perf_counter(), 0.0, 0.0, 0.0
    while True:
        wall, worked = time.perf_counter(), time.process_time()
        live.tick(bpy.context)
        held, own = max(held, time.perf_counter() - wall), max(own, time.process_time() - worked)
        if not first and live.shown > shown:
            first = time.perf_counter() - began
        if live.idle:
            return first, time.perf_counter() - began, held, own, _processor_s(live.worker_id) - used
        time.sleep(0.002)


def _processor_s(process: int) -> float:
    """Return the processor time of a process, NaN where Linux does not tell."""
    facts = Path(f"/proc/{process}/stat")
    if not facts.exists():
        return float("nan")
    user, system = facts.read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    main()
