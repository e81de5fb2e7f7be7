"""Time, memory and error as functions of the database size."""

import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.database.store import Database, open_database, save_database
from perfanim.core.geometry.arrays import Array
from perfanim.core.session.session import Session
from perfanim.core.session.steady_motion import motion_of
from perfanim.core.solver.settings import SolveSettings

from .plots import Line, Panel, check_plots, write_plot
from .run import Run
from .scenarios import BANDAI, CMU, LEFT_OUT, SPLIT, UNLIKE, WALKING, WITHOUT_PRIOR
from .solving import true_subject
from .speed import FIRST_FRAMES, frames_without_labels, reference_ms

_SIZES = (10_000, 86_000, 172_000, 400_000, 1_050_000)  # frames; the last is all there are, including mirror images
_VARIED_FRAMES = 10_000_000  # including variations of everything
# standard deviations of a variation: a joint's angles are scaled by a factor within this of 1, and offset within this
_VARIED, _MOVED_RAD = 0.06, 0.03
_FRAMES = 240  # frames solved per take
_TAKES = {"known": WALKING, "unlike": UNLIKE}  # motion that is common in the database, and motion that it lacks


def scale(run: Run, full: bool = False) -> dict[str, Any]:
    """Solve two takes with databases of increasing size, and write the figures.

    Times are processor time; for a single core, run this with OPENBLAS_NUM_THREADS=1.

    Args:
        full: Include 10 million frames, which needs 5 GB of disk and 8 GB of memory.

    Returns:
        rows (frames, clips, size, memory of a solver besides the file, times and their ratio to an exhaustive search
        in NumPy, error), outputs.
    """
    check_plots()
    folders = run.folders((CMU, BANDAI))
    mirrored = run.built("scale-mirrored", folders, exclude=(*LEFT_OUT, SPLIT), mirror=True)
    takes = {name: sliced(run.read(take), 0, _FRAMES) for name, take in _TAKES.items()}
    rows = []
    sizes = (*_SIZES, _VARIED_FRAMES) if full else _SIZES
    for number, size in enumerate(sizes):
        run.progress(0.3 + 0.7 * number / len(sizes), f"{size:,} frames")
        database = _part(run, mirrored, size)
        with ProcessPoolExecutor(1, get_context("spawn")) as process:
            own_mb = process.submit(_own_memory_mb, takes["known"], database.path).result()
        rows.append(_row(takes, database) | {"own_mb": own_mb})
    frames = np.array([row["frames"] for row in rows])
    lines = [Line(name, frames, np.array([row[f"{name}_ms_median"] for row in rows])) for name in _TAKES]
    plots = write_plot(run.out / "scale", [Panel("best, one frame", lines)], "frames in the database", "median (ms)")
    return run.write("scale", {"rows": rows}, {"": rows}, plots)


def _part(run: Run, whole: Database, size: int) -> Database:
    """Return a database of at most this many frames, with clips from everywhere."""
    if size >= whole.frames:
        return whole if size in _SIZES else _with_variations(whole, size, run.path_of(f"scale-{size}"))
    recorded = [clip for clip in whole.clips if not clip.mirrored]
    kept, left = [], size
    for clip in (recorded[index] for index in np.random.default_rng(0).permutation(len(recorded))):
        count = min(clip.stop - clip.start, left)
        if count > 1:
            kept.append((clip, 0, count))
            left -= count
    return run.subset(whole, f"scale-{size}", sorted(kept, key=lambda part: part[0].start))


def _with_variations(whole: Database, size: int, path: Path) -> Database:
    """Return a database repeated with different joint angles each time; it is built if missing."""
    if path.exists():
        return open_database(path)
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
    database = replace(whole, path=path, clips=tuple(clips), poses=poses, cells=None)
    save_database(replace(database, root_rotations=rotations, root_positions_m=positions_m))
    return open_database(path)


def _own_memory_mb(truth: Motion, path: Path) -> float:
    """Return the memory of a solver without its file's pages; NaN except on Linux."""
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
    Session(true_subject(takes["known"]), database)
    row: dict[str, Any] = {
        "frames": database.frames,
        "clips": len(database.clips),
        "bytes": database.path.stat().st_size,
        "open_ms": round(1e3 * (opened_s - started_s), 2),
        "ready_s": round(time.perf_counter() - opened_s, 3),
    }
    _, reference = reference_ms()
    for name, truth in takes.items():
        milliseconds, _ = _solve(truth, database, SolveSettings())
        for what, value in (("median", np.median(milliseconds)), ("p99", np.percentile(milliseconds, 99))):
            row[f"{name}_ms_{what}"] = round(float(value), 3)
            row[f"{name}_{what}_of_reference"] = round(float(value) / reference, 4)
        errors = evaluate(_solve(truth, database, WITHOUT_PRIOR)[1], truth)
        row[f"{name}_deg_per_joint"] = round(errors["deg_per_joint"], 4)
    return row | {"reference_ms": round(reference, 3)}


def _solve(truth: Motion, database: Database, settings: SolveSettings) -> tuple[Array, Motion]:
    """Return the milliseconds for each frame after the first, and the solved motion."""
    subject = true_subject(truth)
    session, taken, poses = Session(subject, database, settings=settings), [], []
    for frame in frames_without_labels(truth, subject):
        before_s = time.process_time()
        poses.append(session.step(frame))
        taken.append(1e3 * (time.process_time() - before_s))
    return np.array(taken[FIRST_FRAMES:]), motion_of(poses, subject, truth.name, truth.fps)
