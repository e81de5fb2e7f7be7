"""Time, memory and error by the size of the database."""

import time
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.database.build import BuildSettings, build_database
from perfanim.core.database.store import Clip, Database, open_database
from perfanim.core.markers.take_frames import take_frames
from perfanim.core.session.session import Session
from perfanim.core.session.solve_take import motion_of
from perfanim.core.simulate.markers import simulate_markers
from perfanim.core.system.progress import Progress

from .data import BANDAI, CMU, FPS, LEFT_OUT, SPLIT, WALKING, data_folders, read_take
from .figure6 import true_subject
from .methods import WITHOUT_PRIOR
from .plots import Line, Panel, check_plots, write_plot
from .report import write_figures
from .speed import reference_ms
from .subset import write_subset
from .table1 import SEARCHES, search_times

_SHARES = (1 / 64, 1 / 16, 1 / 4, 1.0)  # of the clips, spread evenly
_FRAMES = 240  # solved
_TIMED = ("exhaustive", *SEARCHES, "solve")


def scale(data: Path, out: Path, workers: int, progress: Progress) -> dict[str, Any]:
    """Solve a walk with ever larger databases, and write the figures.

    The largest database holds everything and mirrored copies.

    Returns:
        rows (frames, clips, size, times, error), reference (milliseconds of one exhaustive search in NumPy), outputs.
    """
    check_plots()
    path = out / "databases" / "scale-mirrored.pfdb"
    if not path.exists():
        build_database(
            data_folders(data, (CMU, BANDAI)),
            path,
            BuildSettings(fps=FPS, exclude=(*LEFT_OUT, SPLIT), mirror=True, workers=workers),
            progress=lambda fraction, text: progress(0.3 * fraction, text),
        )
    mirrored = open_database(path)
    truth = sliced(read_take(data, WALKING), 0, _FRAMES)
    reference, _ = reference_ms()
    rows = []
    originals = [clip for clip in mirrored.clips if not clip.mirrored]
    for number, share in enumerate((*_SHARES, None)):
        progress(
            0.3 + 0.7 * number / (len(_SHARES) + 1), "everything, mirrored too" if share is None else f"{share:.1%}"
        )
        database = mirrored if share is None else _part(mirrored, originals, share, out / "databases")
        rows.append(_row(truth, database, reference))
    figures = {"rows": rows, "reference_ms": round(reference, 3)}
    sizes = np.array([row["frames"] for row in rows])
    lines = [Line(name, sizes, np.array([row[f"{name}_ms_median"] for row in rows])) for name in _TIMED]
    plots = write_plot(out / "scale", [Panel("best, a walk", lines)], "frames in the database", "median (ms)")
    return write_figures(out, "scale", figures, {"": rows}, plots)


def _part(whole: Database, clips: list[Clip], share: float, folder: Path) -> Database:
    """Return a database of every so many clips."""
    chosen = clips[:: round(1.0 / share)]
    path = folder / f"scale-{len(chosen)}-clips.pfdb"
    if path.exists():
        return open_database(path)
    return write_subset(whole, path, [(clip, 0, clip.stop - clip.start) for clip in chosen])


def _row(truth: Motion, database: Database, reference_ms: float) -> dict[str, Any]:
    started_s = time.perf_counter()
    open_database(database.path)
    opened_s = time.perf_counter()
    subject = true_subject(truth)
    session = Session(subject, database, settings=WITHOUT_PRIOR)
    ready_s = time.perf_counter()
    taken, poses = [], []
    for frame in take_frames(simulate_markers(truth, subject)[0], subject.marker_set):
        before_s = time.perf_counter()
        poses.append(session.step(frame))
        taken.append(1e3 * (time.perf_counter() - before_s))
    errors = evaluate(motion_of(poses, subject, truth.name, truth.fps), truth)
    row: dict[str, Any] = {
        "frames": database.frames,
        "clips": len(database.clips),
        "bytes": database.path.stat().st_size,
        "open_ms": round(1e3 * (opened_s - started_s), 2),
        "ready_s": round(ready_s - opened_s, 3),
        "solve_ms_median": round(float(np.median(taken)), 3),
        "solve_ms_p99": round(float(np.percentile(taken, 99)), 3),
        "deg_per_joint": round(errors["deg_per_joint"], 4),
    }
    for times in search_times(truth, database):
        name = times["search"]
        row |= {f"{name}_ms_median": times["median_ms"], f"{name}_ms_p99": times["p99_ms"]}
        row[f"{name}_of_reference"] = round(times["median_ms"] / reference_ms, 4)
    return row
