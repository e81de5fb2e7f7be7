"""Time to the first pose of a capture, and to the next pose after its solver was killed; memory. Linux only."""

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.store import open_database
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject, subject_tables
from perfanim.core.worker.client import WorkerClient
from perfanim.perfanim_addon.capture.capture_run import CaptureRun, Phase
from soak.processes import children

from .run import Run
from .solving import MARKER_SET
from .speed import reference_ms

TICK_S = 1.0 / 240.0  # as in Blender's timer
WORKING_S = 3.0  # time from the first pose to the kill
PATIENCE_S = 120.0
EMBEDDED_S, OTHER_S, AGAIN_S = 1.5, 2.5, 1.2  # limits to reach
FIGURES = ("start_s", "again_s", "memory_mb", "own_memory_mb")


def start(run: Run, runs: int = 10, database: Path | None = None) -> dict[str, Any]:
    """Start captures of the simulated performer, as Blender does, and kill their solver.

    Memory is that of the solver's and the cameras' processes before the kill: proportional set size (PSS), and the
    same without file pages, because the system takes those back if it needs them.

    Args:
        runs: Number of captures per database.
        database: Database to use in addition to the embedded one.

    Returns:
        rows (database, frames, median and maximum of each figure, goals), search_ms (one exhaustive NumPy search in the
        same run), outputs.
    """
    rows: list[dict[str, Any]] = []
    for path in filter(None, (run.embedded().path, database)):
        run.progress(0.0 if not rows else 0.5, str(path))
        found = [captured(path, run.out / f"start-{number}.perftake") for number in range(runs)]
        row: dict[str, Any] = {"database": path.stem, "frames": open_database(path).frames}
        for name in FIGURES:
            values = [figures[name] for figures in found]
            row |= {name: round(float(np.median(values)), 3), f"most_{name}": round(max(values), 3)}
        rows.append(row | {"goal_start_s": OTHER_S if rows else EMBEDDED_S, "goal_again_s": AGAIN_S})
    return run.write("start", {"rows": rows, "search_ms": round(reference_ms()[0], 1)}, {"": rows})


def captured(database: Path, take: Path) -> dict[str, float]:
    """Return the figures for one capture."""
    source = {"kind": "simulated", "behaviour": "walking", "seconds": 60.0, "height_m": 1.75, "loop": True}
    subject = Subject("Sim", default_skeleton(1.75), load_marker_set(MARKER_SET))
    request = {
        "job": "capture",
        "cameras": {"source": source, "rig": None, "threshold": None},
        "performers": [subject_tables(subject)],
        "database": str(database),
        "take": str(take),
    }
    begun_s = time.perf_counter()
    client = WorkerClient(request)
    capture = CaptureRun(client)
    try:
        start_s = _ticked(capture, lambda: len(capture.poses) > 0) - begun_s
        _ticked(capture, lambda: time.perf_counter() > begun_s + start_s + WORKING_S)
        workers = (client.process_id, *children(client.process_id))
        memory_mb = np.sum([_memory_mb(worker) for worker in workers], axis=0)
        killed_s = time.perf_counter()
        os.kill(client.process_id, signal.SIGKILL)
        _ticked(capture, lambda: capture.notice.endswith("restarting it"))
        taken = len(capture.poses)
        again_s = _ticked(capture, lambda: len(capture.poses) > taken) - killed_s
        capture.stop()
        _ticked(capture, lambda: capture.phase is Phase.DONE)
    finally:
        capture.close()
        take.unlink(missing_ok=True)
    return dict(zip(FIGURES, (start_s, again_s, *memory_mb.tolist()), strict=True))


def _ticked(capture: CaptureRun, until: Callable[[], bool]) -> float:
    """Receive poses as Blender does; return when a condition has become true."""
    limit_s = time.perf_counter() + PATIENCE_S
    while not until():
        capture.tick()
        if capture.error is not None or time.perf_counter() > limit_s:
            raise RuntimeError(f"the capture did not go on: {capture.error or 'nothing came'}")
        time.sleep(TICK_S)
    return time.perf_counter()


def _memory_mb(process_id: int) -> list[float]:
    """Return a process's proportional set size, and the part of it that is not file pages, MB."""
    rows = dict(line.split(":", 1) for line in Path(f"/proc/{process_id}/smaps_rollup").read_text().splitlines()[1:])
    return [1024e-6 * int(rows[key].split()[0]) for key in ("Pss", "Pss_Anon")]
