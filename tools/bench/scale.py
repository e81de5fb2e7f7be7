"""Time, memory and error by the size of the database."""

import time
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.database.build import BuildSettings, build_database
from perfanim.core.database.store import Database, open_database
from perfanim.core.geometry.arrays import Array
from perfanim.core.markers.take_frames import take_frames
from perfanim.core.session.session import Session
from perfanim.core.session.solve_take import motion_of
from perfanim.core.simulate.markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.progress import Progress

from .data import BANDAI, CMU, FPS, LEFT_OUT, SPLIT, UNLIKE, WALKING, data_folders, read_take
from .figure6 import true_subject
from .frame_stages import without_labels
from .methods import WITHOUT_PRIOR
from .plots import Line, Panel, check_plots, write_plot
from .report import write_figures
from .speed import reference_ms
from .subset import write_subset

_SIZES = (10_000, 86_000, 172_000, 400_000, 1_050_000)  # frames; the last is all there are, mirrored ones included
_FRAMES = 240  # solved, of each take
_FIRST_FRAMES = 20  # that a session begins in
_TAKES = {"known": WALKING, "unlike": UNLIKE}  # motion that the database has much of, and none
_TIMED = ("known", "unlike")


def scale(data: Path, out: Path, workers: int, progress: Progress) -> dict[str, Any]:
    """Solve two takes with ever larger databases, and write the figures.

    Times are the processor's; for those of one core run this with OPENBLAS_NUM_THREADS=1.

    Returns:
        rows (frames, clips, size, times and their shares of one exhaustive search in NumPy, error), outputs.
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
    takes = {name: sliced(read_take(data, take), 0, _FRAMES) for name, take in _TAKES.items()}
    rows = []
    for number, size in enumerate(_SIZES):
        progress(0.3 + 0.7 * number / len(_SIZES), f"{size:,} frames")
        rows.append(_row(takes, _part(mirrored, size, out / "databases")))
    figures: dict[str, Any] = {"rows": rows}
    sizes = np.array([row["frames"] for row in rows])
    lines = [Line(name, sizes, np.array([row[f"{name}_ms_median"] for row in rows])) for name in _TIMED]
    plots = write_plot(out / "scale", [Panel("best, one frame", lines)], "frames in the database", "median (ms)")
    return write_figures(out, "scale", figures, {"": rows}, plots)


def _part(whole: Database, size: int, folder: Path) -> Database:
    """Return a database of clips from everywhere, of so many frames at most."""
    if size >= whole.frames:
        return whole
    path = folder / f"scale-{size}.pfdb"
    if path.exists():
        return open_database(path)
    recorded = [clip for clip in whole.clips if not clip.mirrored]
    order = np.random.default_rng(0).permutation(len(recorded))
    kept, left = [], size
    for clip in (recorded[index] for index in order):
        count = min(clip.stop - clip.start, left)
        if count > 1:
            kept.append((clip, 0, count))
            left -= count
    return write_subset(whole, path, sorted(kept, key=lambda part: part[0].start))


def _row(takes: dict[str, Motion], database: Database) -> dict[str, Any]:
    started_s = time.perf_counter()
    open_database(database.path)
    opened_s = time.perf_counter()
    subject = true_subject(takes["known"])
    Session(subject, database)
    ready_s = time.perf_counter()
    row: dict[str, Any] = {
        "frames": database.frames,
        "clips": len(database.clips),
        "bytes": database.path.stat().st_size,
        "open_ms": round(1e3 * (opened_s - started_s), 2),
        "ready_s": round(ready_s - opened_s, 3),
    }
    _, reference = reference_ms()
    for name, truth in takes.items():
        milliseconds, _ = _solve(truth, database, SolveSettings())
        median, p99 = float(np.median(milliseconds)), float(np.percentile(milliseconds, 99))
        row |= {f"{name}_ms_median": round(median, 3), f"{name}_ms_p99": round(p99, 3)}
        row |= {f"{name}_median_of_reference": round(median / reference, 4)}
        row |= {f"{name}_p99_of_reference": round(p99 / reference, 4)}
        errors = evaluate(_solve(truth, database, WITHOUT_PRIOR)[1], truth)
        row[f"{name}_deg_per_joint"] = round(errors["deg_per_joint"], 4)
    return row | {"reference_ms": round(reference, 3)}


def _solve(truth: Motion, database: Database, settings: SolveSettings) -> tuple[Array, Motion]:
    """Return the milliseconds of each frame after the first, and the motion solved."""
    subject = true_subject(truth)
    session, taken, poses = Session(subject, database, settings=settings), [], []
    for number, frame in enumerate(take_frames(simulate_markers(truth, subject)[0], subject.marker_set)):
        unlabelled, before_s = without_labels(frame, number), time.process_time()
        poses.append(session.step(unlabelled))
        taken.append(1e3 * (time.process_time() - before_s))
    return np.array(taken[_FIRST_FRAMES:]), motion_of(poses, subject, truth.name, truth.fps)
