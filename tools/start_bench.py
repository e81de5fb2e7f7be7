"""Time to the first pose of a capture, and to the next after its solver died.

    python tools/start_bench.py --runs 10 [--database ALL.pfdb] --out report.json

As Blender does, a capture of the simulated performer is started, by the embedded motion and by each other database
given. Three seconds after the first pose its solver's process is killed (SIGKILL); the next pose is waited for. Beside
the times stands the memory of the solver's and the cameras' processes before the kill: their share of all pages (PSS),
and without pages of files, as the system takes those back where it needs them. Times hang on the machine, so that of
one exhaustive NumPy search in the same run stands beside them. The exit status is 1 if a median is over its goal. Linux
only: it looks at /proc.
"""

import argparse
import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from bench.speed import reference_ms
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.database.store import open_database
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject, subject_tables
from perfanim.core.system.assets import MOTION
from perfanim.core.worker.client import WorkerClient
from perfanim.perfanim_addon.capture.capture_run import CaptureRun, Phase
from soak.processes import children

EMBEDDED = "embedded"
TICK_S = 1.0 / 240.0  # as of Blender's timer
WORKING_S = 3.0  # from the first pose to the kill
PATIENCE_S = 120.0
EMBEDDED_S, OTHER_S, AGAIN_S = 1.5, 2.5, 1.2  # goals
FIGURES = ("start_s", "again_s", "memory_mb", "own_memory_mb")


def main() -> int:
    """Run; the exit status is 1 when a median is over its goal."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=10, help="captures of each database (default 10)")
    parser.add_argument("--database", type=Path, action="append", default=[], help="another database; repeatable")
    parser.add_argument("--out", type=Path, help="report to write (JSON)")
    options = parser.parse_args()
    report: dict[str, Any] = {"search_ms": reference_ms()[0], "databases": {}}
    sys.stdout.write("".join(f"{name:>16}" for name in ("frames", *FIGURES)) + "   medians and most\n")
    late = False
    with tempfile.TemporaryDirectory(prefix="start-bench-") as name:
        embedded = Path(name) / f"{EMBEDDED}.pfdb"
        build_database([str(MOTION)], embedded, BuildSettings(fps=60.0))
        for path in (embedded, *options.database):
            rows = [started(path, Path(name) / f"{number}.perftake") for number in range(options.runs)]
            median, most = ({key: worst([row[key] for row in rows]) for key in FIGURES} for worst in (np.median, max))
            frames = open_database(path).frames
            report["databases"][path.stem] = {"frames": frames, "median": median, "most": most, "rows": rows}
            for figures in (median, most):
                sys.stdout.write(f"{frames:16d}" + "".join(f"{figures[key]:16.3f}" for key in FIGURES) + "\n")
            goal_s = EMBEDDED_S if path == embedded else OTHER_S
            late = late or bool(median["start_s"] > goal_s or median["again_s"] > AGAIN_S)
    sys.stdout.write(f"one exhaustive search: {report['search_ms']:.1f} ms\n")
    if options.out:
        options.out.write_text(json.dumps(report, indent=1))
    return int(late)


def started(database: Path, take: Path) -> dict[str, float]:
    """Return the figures of one capture."""
    source = {"kind": "simulated", "behaviour": "walking", "seconds": 60.0, "height_m": 1.75, "loop": True}
    subject = Subject("Sim", default_skeleton(1.75), load_marker_set("boxing"))
    request = {
        "job": "capture",
        "cameras": {"source": source, "rig": None, "threshold": None},
        "performers": [subject_tables(subject)],
        "database": str(database),
        "take": str(take),
    }
    begun_s = time.perf_counter()
    client = WorkerClient(request)
    run = CaptureRun(client)
    try:
        start_s = _ticked(run, lambda: len(run.poses) > 0) - begun_s
        _ticked(run, lambda: time.perf_counter() > begun_s + start_s + WORKING_S)
        workers = [client.process_id, *children(client.process_id)]
        memory_mb = [sum(column) for column in zip(*map(_memory_mb, workers), strict=True)]
        killed_s = time.perf_counter()
        os.kill(client.process_id, signal.SIGKILL)
        _ticked(run, lambda: run.notice.endswith("starting it again"))
        taken = len(run.poses)
        again_s = _ticked(run, lambda: len(run.poses) > taken) - killed_s
        run.stop()
        _ticked(run, lambda: run.phase is Phase.DONE)
    finally:
        run.close()
        take.unlink(missing_ok=True)
    return dict(zip(FIGURES, (start_s, again_s, *memory_mb), strict=True))


def _ticked(run: CaptureRun, until: Callable[[], bool]) -> float:
    """Take poses as Blender does; return when a condition became true."""
    limit_s = time.perf_counter() + PATIENCE_S
    while not until():
        run.tick()
        if run.error is not None or time.perf_counter() > limit_s:
            raise SystemExit(f"the capture did not go on: {run.error or 'nothing came'}")
        time.sleep(TICK_S)
    return time.perf_counter()


def _memory_mb(process_id: int) -> list[float]:
    """Return a process' share of memory, and that of pages of no file."""
    rows = dict(line.split(":", 1) for line in Path(f"/proc/{process_id}/smaps_rollup").read_text().splitlines()[1:])
    return [1024e-6 * int(rows[key].split()[0]) for key in ("Pss", "Pss_Anon")]


if __name__ == "__main__":
    sys.exit(main())
