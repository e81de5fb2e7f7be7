"""Time, memory and error by the size of the database."""

import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.database.store import Database, open_database, save_database
from perfanim.core.geometry.arrays import Array
from perfanim.core.markers.take_frames import take_frames
from perfanim.core.session.session import Session
from perfanim.core.session.solve_take import motion_of
from perfanim.core.simulate.simulated_markers import simulate_markers
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
_FULL_SIZES = (*_SIZES, 10_000_000)  # with variations of all
# of a variation: angles of a joint multiplied by 1 within this, and moved within this
_VARIED, _MOVED_RAD = 0.06, 0.03
_FRAMES = 240  # solved, of each take
_FIRST_FRAMES = 20  # that a session begins in
_TAKES = {"known": WALKING, "unlike": UNLIKE}  # motion that the database has much of, and none
_TIMED = ("known", "unlike")


def scale(data: Path, out: Path, workers: int, progress: Progress, full: bool = False) -> dict[str, Any]:
    """Solve two takes with ever larger databases, and write the figures.

    Times are the processor's; for those of one core run this with OPENBLAS_NUM_THREADS=1.

    Args:
        full: 10 million frames, too; needs 5 GB of disk and 8 GB of memory.

    Returns:
        rows (frames, clips, size, memory of a solver beside the file, times and their shares of one exhaustive search
        in NumPy, error), outputs.
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
    sizes = _FULL_SIZES if full else _SIZES
    for number, size in enumerate(sizes):
        progress(0.3 + 0.7 * number / len(sizes), f"{size:,} frames")
        database = _part(mirrored, size, out / "databases")
        with ProcessPoolExecutor(1, get_context("spawn")) as process:
            own_mb = process.submit(_own_memory_mb, takes["known"], database.path).result()
        rows.append(_row(takes, database) | {"own_mb": own_mb})
    figures: dict[str, Any] = {"rows": rows}
    frames = np.array([row["frames"] for row in rows])
    lines = [Line(name, frames, np.array([row[f"{name}_ms_median"] for row in rows])) for name in _TIMED]
    plots = write_plot(out / "scale", [Panel("best, one frame", lines)], "frames in the database", "median (ms)")
    return write_figures(out, "scale", figures, {"": rows}, plots)


def _part(whole: Database, size: int, folder: Path) -> Database:
    """Return a database of so many frames at most, of clips from everywhere."""
    path = folder / f"scale-{size}.pfdb"
    if path.exists():
        return open_database(path)
    if size > _SIZES[-1]:
        return _with_variations(whole, size, path)
    if size >= whole.frames:
        return whole
    recorded = [clip for clip in whole.clips if not clip.mirrored]
    order = np.random.default_rng(0).permutation(len(recorded))
    kept, left = [], size
    for clip in (recorded[index] for index in order):
        count = min(clip.stop - clip.start, left)
        if count > 1:
            kept.append((clip, 0, count))
            left -= count
    return write_subset(whole, path, sorted(kept, key=lambda part: part[0].start))


def _with_variations(whole: Database, size: int, path: Path) -> Database:
    """Write a database over and over, each time with other joint angles."""
    copies, random = -(-size // whole.frames), np.random.default_rng(0)
    poses, clips = np.empty((copies * whole.frames, *whole.poses.shape[1:]), dtype=np.float32), list(whole.clips)
    poses[: whole.frames] = whole.poses
    for first in range(whole.frames, len(poses), whole.frames):
        for clip in whole.clips:
            part = whole.poses[clip.start : clip.stop]
            factors = random.normal(1.0, _VARIED, size=(part.shape[1], 1)).astype(np.float32)
            moved_rad = random.normal(0.0, _MOVED_RAD, size=part.shape[1:]).astype(np.float32)
            poses[first + clip.start : first + clip.stop] = part * factors + moved_rad
            clips.append(replace(clip, start=first + clip.start, stop=first + clip.stop))
    rotations, positions_m = (np.tile(rows, (copies, 1)) for rows in (whole.root_rotations, whole.root_positions_m))
    database = replace(whole, path=path, clips=tuple(clips), poses=poses, cells=None, graph=None)
    save_database(replace(database, root_rotations=rotations, root_positions_m=positions_m))
    return open_database(path)


def _own_memory_mb(truth: Motion, path: Path) -> float:
    """Return the memory of a solver beside its file's pages; NaN but on Linux."""
    before_mb = _anonymous_mb()
    database = open_database(path)
    _session = Session(true_subject(truth), database)
    return round(_anonymous_mb() - before_mb, 1)


def _anonymous_mb() -> float:
    file = Path("/proc/self/status")
    rows = dict(line.split(":", 1) for line in file.read_text().splitlines()) if file.exists() else {}
    return float(rows["RssAnon"].split()[0]) / 1e3 if "RssAnon" in rows else float("nan")


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
