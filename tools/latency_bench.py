"""Latency of a live capture by stages, from images in hand to bones.

    python tools/latency_bench.py --seconds 20 [--tick-ms 16.7] [--out report.json]   (make latency-bench)

Runs the chain of a live capture: the cameras' process, the solver's process, and this one in place of Blender, with its
timer and a character of `bpy`. The cameras are simulated, with images drawn beforehand, and the processes treat them as
plugged-in ones: nobody waits for anybody. Each process notes when a frame passed a stage; the product itself only
carries the time of the images, by which the notes are put together. Excluded: exposure and the camera's own delay,
Blender's evaluation and drawing. Needs bpy.
"""

import argparse
import atexit
import json
import os
import struct
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.geometry.arrays import Array
from perfanim.core.geometry.rig_file import rig_tables
from perfanim.core.markers.subject import Subject, subject_tables
from perfanim.core.simulate.studio.simulated_performer import SimulatedPerformer
from perfanim.core.simulate.studio.simulated_source import SimulatedSource, open_simulated
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.system.assets import MOTION
from perfanim.core.worker import child_process, process
from perfanim.core.worker.channel import Channel
from perfanim.core.worker.client import WorkerClient
from perfanim.perfanim_addon.capture.capture_run import CaptureRun, Phase

STAGES = (  # each ends at
    "detected",  # blobs of all cameras
    "located",  # points in space, handed to the socket's thread
    "received by the solver",  # unpacked and noted in the take
    "its turn in the solver",
    "labelled and solved",
    "filtered, handed over",  # to the socket's thread
    "received by Blender",  # unpacked at a tick of its timer
    "bones set",
)
WHOLE = "images to bones"
_NOTES = "PERFANIM_LATENCY_NOTES"  # environment: folder of the processes' notes
_STAMP = struct.Struct("<d")
_SOURCE = {"kind": "simulated", "behaviour": "boxing", "seconds": 2.0, "live": True, "loop": True}
_WARM_S = 8.0  # all images are drawn, the performer is labelled
_PATIENCE_S = 120.0


class Notes:
    """Moments of frames at the ends of stages, by the time of their images."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, str, float]] = []

    def add(self, stamp_s: float, stage: str) -> None:
        """Note that a frame has passed a stage now."""
        self.rows.append((stamp_s, stage, time.perf_counter()))

    def write(self) -> None:
        """Write the notes of this process."""
        Path(os.environ[_NOTES], f"{os.getpid()}.json").write_text(json.dumps(self.rows))


def main() -> int:
    """Run the chain and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="of the capture that are measured (default 20)")
    parser.add_argument("--tick-ms", type=float, help="interval of Blender's timer (default: the product's)")
    parser.add_argument("--fps", type=float, default=60.0, help="images of a camera per second (default 60)")
    parser.add_argument("--out", type=Path, help="report to write (JSON)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="latency-bench-") as name:
        folder = Path(name)
        os.environ[_NOTES] = name
        tick_s = None if options.tick_ms is None else 1e-3 * options.tick_ms
        idle_us = captured(folder, options.fps, options.seconds, tick_s)
        times_s = stage_times(folder)
    stages = figures(times_s)
    sys.stdout.write(f"{f'{len(times_s)} frames, ms':34}{'median':>10}{'99 %':>10}\n")
    for stage, (median, most) in stages.items():
        sys.stdout.write(f"{stage:34}{median:10.2f}{most:10.2f}\n")
    sys.stdout.write(f"a tick of Blender's timer without a pose: {idle_us:.0f} us\n")
    if options.out:
        report = {"frames": len(times_s), "stages": stages, "idle_tick_us": idle_us}
        options.out.write_text(json.dumps(report, indent=1))
    return 0


def stage_times(folder: Path) -> Array:
    """Return the seconds of each frame (F, stages), from all processes' notes."""
    passed: dict[float, dict[str, float]] = {}
    for path in folder.glob("*.json"):
        for stamp_s, stage, moment_s in json.loads(path.read_text()):
            passed.setdefault(stamp_s, {})[stage] = moment_s
    measured_from_s = min(passed) + _WARM_S
    # a pose that another one overtook within a tick never was on the bones
    whole = [
        [stamp_s, *(moments[stage] for stage in STAGES)]
        for stamp_s, moments in sorted(passed.items())
        if stamp_s > measured_from_s and moments.keys() >= set(STAGES)
    ]
    return np.diff(np.array(whole), axis=1)


def figures(times_s: Array) -> dict[str, tuple[float, float]]:
    """Return median and 99 % of each stage and of the whole, ms, from (F, stages)."""
    milliseconds = 1e3 * np.column_stack((times_s, times_s.sum(axis=1)))
    return {
        stage: (float(np.median(column)), float(np.percentile(column, 99)))
        for stage, column in zip((*STAGES, WHOLE), milliseconds.T, strict=True)
    }


def captured(folder: Path, fps: float, seconds: float, tick_s: float | None) -> float:
    """Capture as Blender does; return the microseconds of a tick without a pose."""
    import bpy
    from perfanim.perfanim_addon.capture.armature_driver import ArmatureDriver
    from perfanim.perfanim_addon.capture.tuning import TUNING
    from perfanim.perfanim_addon.character.create_character import create_character

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    subject = open_simulated(_SOURCE).subject
    driver = ArmatureDriver(create_character(bpy.context, subject.skeleton), subject.skeleton)
    request = _request(folder, fps, subject)
    probe_children()
    notes = Notes()
    run = CaptureRun(WorkerClient(request))
    _noted(run, "_take_pose", notes, "received by Blender", lambda arguments: _stamp(arguments[0].payload))
    idle: list[float] = []
    due_s = time.perf_counter()
    end_s = limit_s = due_s + _PATIENCE_S
    try:
        while time.perf_counter() < end_s:
            started_s = time.perf_counter()
            pose = run.tick()
            if run.error is not None:
                raise SystemExit(f"the capture ended: {run.error}")
            if pose is None:
                idle.append(time.perf_counter() - started_s)
            else:
                end_s = started_s + _WARM_S + seconds if end_s == limit_s else end_s
                driver.apply(pose.performers[0].rotations, pose.performers[0].root_position_m)
                notes.add(run._stamp, "bones set")
            due_s = max(due_s + (tick_s or TUNING.tick_s), time.perf_counter())  # no tick is made up for
            time.sleep(max(due_s - time.perf_counter(), 0.0))
        run.stop()
        while run.phase is not Phase.DONE:
            run.tick()
            time.sleep(0.01)
    finally:
        run.close()
    notes.write()
    return 1e6 * float(np.median(idle))


def _request(folder: Path, fps: float, subject: Subject) -> dict[str, Any]:
    build_database([str(MOTION)], folder / "embedded.pfdb", BuildSettings(fps=60.0))
    return {
        "job": "capture",
        "cameras": {"source": {**_SOURCE, "fps": fps}, "rig": rig_tables(default_rig()), "threshold": None},
        "performers": [subject_tables(subject)],
        "database": str(folder / "embedded.pfdb"),
        "take": str(folder / "latency.perftake"),
    }


def probe_children() -> None:
    """Let child processes of this one take notes, and theirs."""
    folder, paths = str(Path(__file__).parent), child_process.library_paths
    there = import_module(Path(__file__).stem)  # this file may be the main program here
    _replace(child_process, "process", SimpleNamespace(main=there.probed))
    _replace(child_process, "library_paths", lambda: [folder, *paths()])


def probed(port: int, token: str, job: str) -> int:
    """Be a worker process that notes when frames pass its stages."""
    notes = Notes()
    atexit.register(notes.write)
    probe_children()
    # as plugged-in cameras: nobody waits for anybody
    _replace(SimulatedPerformer, "is_live", True)
    if job == "capture":
        _replace(import_module("perfanim.core.worker.jobs.run_capture"), "_POSES_AHEAD", None)
        _probe_solver(notes)
    else:
        _probe_cameras(notes)
    return process.main(port, token, job)


def _probe_cameras(notes: Notes) -> None:
    from perfanim.core.vision.pipeline import MarkerPipeline

    begun: dict[str, float] = {}
    drawn: dict[int, Any] = {}
    detect, send, draw = MarkerPipeline.detect, Channel.send_frame, SimulatedSource.frame

    def detected(self: Any, images: Any) -> Any:
        seen = detect(self, images)
        begun["detected"] = time.perf_counter()
        return seen

    def sent(self: Any, stamp_s: float, frame: Any) -> None:
        send(self, stamp_s, frame)
        notes.rows.append((stamp_s, "detected", begun["detected"]))
        notes.add(stamp_s, "located")

    def image_set(self: Any, number: int) -> Any:
        turn = number % self.frames
        if turn not in drawn:
            drawn[turn] = draw(self, turn)
        later_s = (number - turn) / self.fps
        return replace(drawn[turn], number=number, times_s=tuple(t + later_s for t in drawn[turn].times_s))

    _replace(MarkerPipeline, "detect", detected)
    _replace(Channel, "send_frame", sent)
    _replace(SimulatedSource, "frame", image_set)


def _probe_solver(notes: Notes) -> None:
    from perfanim.core.session.multi_target_session import MultiTargetSession
    from perfanim.core.worker.jobs.capture_loop import CaptureLoop
    from perfanim.core.worker.jobs.capture_stages import FrameRecorder

    _noted(FrameRecorder, "record", notes, "received by the solver", lambda arguments: _stamp(arguments[1]))
    _noted(Channel, "send_pose", notes, "filtered, handed over", lambda arguments: _stamp(arguments[1]))
    stamps: dict[str, float] = {}
    solve, step = CaptureLoop._solve, MultiTargetSession.step

    def solved(self: Any, stamp_s: float, frame: Any) -> None:
        stamps["now"] = stamp_s
        notes.add(stamp_s, "its turn in the solver")
        solve(self, stamp_s, frame)

    def stepped(self: Any, frame: Any) -> Any:
        pose = step(self, frame)
        notes.add(stamps["now"], "labelled and solved")
        return pose

    _replace(CaptureLoop, "_solve", solved)
    _replace(MultiTargetSession, "step", stepped)


def _noted(owner: Any, name: str, notes: Notes, stage: str, stamp_of: Callable[[tuple[Any, ...]], float]) -> None:
    """Let a method note the end of a stage for the frame that its arguments carry."""
    method = getattr(owner, name)

    @wraps(method)
    def noting(*arguments: Any, **named: Any) -> Any:
        result = method(*arguments, **named)
        notes.add(stamp_of(arguments), stage)
        return result

    _replace(owner, name, noting)


def _replace(owner: Any, name: str, by: Any) -> None:
    setattr(owner, name, by)


def _stamp(record: bytes) -> float:
    """Return the time of the images that a packed frame or pose begins with."""
    return float(_STAMP.unpack_from(record)[0])


if __name__ == "__main__":
    sys.exit(main())
