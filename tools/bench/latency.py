"""Latency of a live capture by stage, from the arrival of images to the posed bones.

It runs all processes of a live capture: the cameras' process, the solver's process, and this one in place of Blender,
with its timer and a character in `bpy`. The cameras are simulated, with images drawn beforehand, and are treated like
plugged-in ones: no process waits for another. Each process notes when a frame passed a stage; the product itself only
carries the time of the images, which identifies a frame in the notes. Exposure, the camera's own delay, and Blender's
evaluation and drawing are excluded. Needs bpy.
"""

import atexit
import json
import os
import struct
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
from perfanim.core.geometry.arrays import Array
from perfanim.core.geometry.rig_file import rig_tables
from perfanim.core.markers.subject import subject_tables
from perfanim.core.simulate.studio.simulated_performer import SimulatedPerformer
from perfanim.core.simulate.studio.simulated_source import SimulatedSource, open_simulated
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.worker import child_process, process
from perfanim.core.worker.channel import Channel
from perfanim.core.worker.client import WorkerClient
from perfanim.perfanim_addon.capture.capture_run import CaptureRun, Phase

from .run import Run

STAGES = (  # points at which the stages end
    "detected",  # blobs of all cameras
    "located",  # points in space, passed to the socket's thread
    "received by the solver",  # unpacked and written to the take
    "its turn in the solver",
    "labelled and solved",
    "filtered, handed over",  # passed to the socket's thread
    "received by Blender",  # unpacked on a tick of its timer
    "bones set",
)
WHOLE = "images to bones"
_NOTES = "PERFANIM_LATENCY_NOTES"  # environment variable: folder of the processes' notes
_STAMP = struct.Struct("<d")
_SOURCE = {"kind": "simulated", "behaviour": "boxing", "seconds": 2.0, "live": True, "loop": True}
_WARM_S = 8.0  # by then all images are drawn and the performer is labelled
_PATIENCE_S = 120.0


class Notes:
    """Times at which frames passed the ends of stages, by the time of their images."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, str, float]] = []

    def add(self, stamp_s: float, stage: str) -> None:
        """Note that a frame has just passed a stage."""
        self.rows.append((stamp_s, stage, time.perf_counter()))

    def after(self, owner: Any, name: str, stage: str, stamp_of: Callable[..., float]) -> None:
        """Make a method note the end of a stage for the frame in its arguments."""
        method = getattr(owner, name)

        @wraps(method)
        def noting(*arguments: Any, **named: Any) -> Any:
            result = method(*arguments, **named)
            self.add(stamp_of(*arguments), stage)
            return result

        setattr(owner, name, noting)

    def write(self) -> None:
        """Write the notes of this process."""
        Path(os.environ[_NOTES], f"{os.getpid()}.json").write_text(json.dumps(self.rows))


def latency(
    run: Run, seconds: float = 20.0, tick_ms: float | None = None, fps: float = 60.0, database: Path | None = None
) -> dict[str, Any]:
    """Run all processes and measure, with poses shown immediately: smoothed ones would come two frames later.

    Args:
        seconds: Duration of the capture that is measured.
        tick_ms: Interval of Blender's timer; by default the product's.
        fps: Images per camera and second.
        database: Database to solve with; by default the embedded motion's.

    Returns:
        rows (stage, median and 99 % in ms), frames, idle_tick_us (a tick of the timer without a pose), outputs.
    """
    request = {
        "job": "capture",
        "cameras": {"source": {**_SOURCE, "fps": fps}, "rig": rig_tables(default_rig()), "threshold": None},
        "performers": [subject_tables(open_simulated(_SOURCE).subject)],
        "database": str(database or run.embedded().path),
        "shape": {"immediate": True},
    }
    with tempfile.TemporaryDirectory(prefix="latency-bench-") as folder:
        os.environ[_NOTES] = folder
        idle_us = captured({**request, "take": f"{folder}/latency.perftake"}, seconds, tick_ms)
        times_s = stage_times(Path(folder))
    rows = [
        {"stage": stage, "median_ms": round(median, 2), "p99_ms": round(most, 2)}
        for stage, (median, most) in figures(times_s).items()
    ]
    found = {"rows": rows, "frames": len(times_s), "idle_tick_us": round(idle_us, 1)}
    return run.write("latency", found, {"": rows})


def stage_times(folder: Path) -> Array:
    """Return the times, s, of each frame (F, stages) from the notes of all processes."""
    passed: dict[float, dict[str, float]] = {}
    for path in folder.glob("*.json"):
        for stamp_s, stage, moment_s in json.loads(path.read_text()):
            passed.setdefault(stamp_s, {})[stage] = moment_s
    measured_from_s = min(passed) + _WARM_S
    # a pose that was overtaken by another within a tick never reached the bones
    whole = [
        [stamp_s, *(moments[stage] for stage in STAGES)]
        for stamp_s, moments in sorted(passed.items())
        if stamp_s > measured_from_s and moments.keys() >= set(STAGES)
    ]
    return np.diff(np.array(whole), axis=1)


def figures(times_s: Array) -> dict[str, tuple[float, float]]:
    """Return median and 99th percentile of each stage and of the total, ms, from (F, stages)."""
    milliseconds = 1e3 * np.column_stack((times_s, times_s.sum(axis=1)))
    return {
        stage: (float(np.median(column)), float(np.percentile(column, 99)))
        for stage, column in zip((*STAGES, WHOLE), milliseconds.T, strict=True)
    }


def captured(request: dict[str, Any], seconds: float, tick_ms: float | None) -> float:
    """Capture as Blender does; return the duration of a tick without a pose in microseconds."""
    import bpy
    from perfanim.perfanim_addon.capture.armature_driver import ArmatureDriver
    from perfanim.perfanim_addon.capture.tuning import TUNING
    from perfanim.perfanim_addon.character.create_character import create_character

    tick_s = TUNING.tick_s if tick_ms is None else 1e-3 * tick_ms
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    skeleton = open_simulated(_SOURCE).subject.skeleton
    driver = ArmatureDriver(create_character(bpy.context, skeleton), skeleton)
    probe_children()
    notes, idle = Notes(), []
    capture = CaptureRun(WorkerClient(request))
    notes.after(capture, "_take_pose", "received by Blender", lambda message: _stamp(message.payload))
    due_s = time.perf_counter()
    end_s = limit_s = due_s + _PATIENCE_S
    try:
        while time.perf_counter() < end_s:
            started_s = time.perf_counter()
            pose = capture.tick()
            if capture.error is not None:
                raise RuntimeError(f"the capture ended: {capture.error}")
            if pose is None:
                idle.append(time.perf_counter() - started_s)
            else:
                end_s = started_s + _WARM_S + seconds if end_s == limit_s else end_s
                driver.apply(pose.performers[0].rotations, pose.performers[0].root_position_m)
                notes.add(capture._stamp, "bones set")
            due_s = max(due_s + tick_s, time.perf_counter())  # missed ticks are not made up for
            time.sleep(max(due_s - time.perf_counter(), 0.0))
        capture.stop()
        while capture.phase is not Phase.DONE:
            capture.tick()
            time.sleep(0.01)
    finally:
        capture.close()
    notes.write()
    return 1e6 * float(np.median(idle))


def probe_children() -> None:
    """Make the child processes of this one, and their children, take notes."""
    folder, paths = str(Path(__file__).parents[1]), child_process.library_paths
    vars(child_process).update(process=SimpleNamespace(main=probed), library_paths=lambda: [folder, *paths()])


def probed(port: int, token: str, job: str) -> int:
    """Run a worker process that notes when frames pass its stages."""
    notes = Notes()
    atexit.register(notes.write)
    probe_children()
    # like plugged-in cameras: no process waits for another
    setattr(SimulatedPerformer, "is_live", True)  # noqa: B010 - a property of another class
    if job == "capture":
        vars(import_module("perfanim.core.worker.jobs.run_capture"))["_POSES_AHEAD"] = None
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

    for owner, name, probe in (
        (MarkerPipeline, "detect", detected), (Channel, "send_frame", sent), (SimulatedSource, "frame", image_set),
    ):  # fmt: skip
        setattr(owner, name, probe)


def _probe_solver(notes: Notes) -> None:
    from perfanim.core.session.multi_target_session import MultiTargetSession
    from perfanim.core.worker.jobs.capture_loop import CaptureLoop
    from perfanim.core.worker.jobs.capture_stages import FrameRecorder

    stamps: dict[str, float] = {}
    solve = CaptureLoop._solve

    def solved(self: Any, stamp_s: float, frame: Any) -> None:
        stamps["now"] = stamp_s
        notes.add(stamp_s, "its turn in the solver")
        solve(self, stamp_s, frame)

    setattr(CaptureLoop, "_solve", solved)  # noqa: B010 - a method of another class
    notes.after(FrameRecorder, "record", "received by the solver", lambda self, record: _stamp(record))
    notes.after(MultiTargetSession, "step", "labelled and solved", lambda self, frame: stamps["now"])
    notes.after(Channel, "send_pose", "filtered, handed over", lambda self, record: _stamp(record))


def _stamp(record: bytes) -> float:
    """Return the time of the images at the start of a packed frame or pose."""
    return float(_STAMP.unpack_from(record)[0])
