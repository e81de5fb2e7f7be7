"""Figure 5 of the paper: how well poses are kept by models of few dimensions, on databases of three sizes.

GPLVM is left out: the paper itself could not compute it on the larger databases.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..database.graph import l1_distance_deg
from ..database.store import Clip, Database
from ..database.subset import write_subset
from ..errors import DatabaseError
from ..solver.local_model import fit
from .data import BANDAI, CMU, Progress, whole_database
from .plots import Line, Panel, check_plots, write_plot
from .report import write_json, write_rows

Array = NDArray[np.float64]

DIMENSIONS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 15, 18, 21, 24, 27, 30, 34, 38, 42, 46, 50)
# dimensions for less than one degree per joint angle
PAPER = {
    "walking": {"global PCA": 14, "mixture of local models": 6, "local model": 4},
    "boxing and martial arts": {"global PCA": 27, "mixture of local models": 18, "local model": 6},
    "heterogeneous": {"global PCA": 38, "mixture of local models": 27, "local model": 5},
}
LOCAL, STRICT = "local model", "local model, own second left out"
_GOOD_ENOUGH_DEG = 1.0
_TESTED = 250  # frames
_NEIGHBOURS = 64
_SMALL_FRAMES = 350  # at 60 Hz as long as the 700 frames at 120 Hz of the paper
_FRAMES_PER_CLUSTER = 400
_CLUSTER_SAMPLE = 60_000  # frames that clusters and covariances are learned from
_MARTIAL = ("boxing", "empi", "gedanbarai", "heiansyodan", "mawashigeri", "syutouuke", "yokogeri", "kick", "slash")


def figure5(data: Path, out: Path, workers: int, progress: Progress) -> dict[str, Any]:
    """Reconstruct frames of three databases from models of growing dimension, and write the figure.

    Args:
        data: folder that holds `cmu` and `bandai`.
        out: folder to write to.
        workers: processes that read motion.

    Returns:
        rows (database, frames, model, dimensions, error), needed (dimensions for less than one degree), outputs.
    """
    check_plots()
    whole = whole_database(data, out, (CMU, BANDAI), workers, progress)
    databases = {
        "walking": _part(whole, out, "walking", _one_walk(whole.clips)),
        "boxing and martial arts": _part(whole, out, "martial", _martial(whole.clips)),
        "heterogeneous": whole,
    }
    rows, panels = [], []
    for number, (name, database) in enumerate(databases.items()):
        progress(0.3 + 0.7 * number / len(databases), f"reconstructing {name}")
        curves = reconstruction_errors(database)
        panels.append(
            Panel(
                f"{name}, {database.frames} frames",
                [Line(model, np.array(DIMENSIONS[: len(curve)]), curve) for model, curve in curves.items()],
            )
        )
        rows += [
            {"database": name, "frames": database.frames, "model": model, "dimensions": d, "deg_per_angle": float(e)}
            for model, curve in curves.items()
            for d, e in zip(DIMENSIONS, curve, strict=False)
        ]
    figures = {"rows": rows, "needed": [_needed(rows, name, model) for name in databases for model in curves]}
    write_json(out / "figure5.json", figures)
    write_rows(out / "figure5.csv", rows)
    plots = write_plot(out / "figure5", panels, "number of dimensions", "error (degrees per joint angle)", True)
    names = [str(out / "figure5.json"), str(out / "figure5.csv")]
    return figures | {"outputs": names + [str(path) for path in plots]}


def reconstruction_errors(database: Database) -> dict[str, Array]:
    """Return the mean L1 error, degrees per joint angle, of each model by dimension.

    The local models are learned from the closest frames to the pose itself, without its frame ("local model", as in
    the paper), and without the second of its clip that it stands in.
    """
    poses = database.poses.reshape(database.frames, -1)
    tested = np.unique(np.linspace(0, database.frames - 1, _TESTED).astype(np.int64))
    truth = poses[tested].astype(np.float64)
    sample = poses[:: max(1, database.frames // _CLUSTER_SAMPLE)].astype(np.float64)
    norms = np.einsum("fd,fd->f", poses, poses)
    errors: dict[str, list[Array]] = {LOCAL: [], STRICT: []}
    for frame, pose in zip(tested, truth, strict=True):
        distances = norms - 2.0 * (poses @ pose.astype(np.float32))
        distances[frame] = np.inf
        for name, around in ((LOCAL, 0), (STRICT, round(0.5 * database.fps))):
            distances[max(0, frame - around) : frame + around + 1] = np.inf
            count = min(_NEIGHBOURS, database.frames - 2 * around - 1)
            errors[name].append(_errors(poses[np.argpartition(distances, count - 1)[:count]], pose[None])[0])
    result = {
        "global PCA": _errors(sample, truth).mean(axis=0),
        "mixture of local models": _mixture_errors(sample, truth).mean(axis=0),
    }
    return result | {name: np.mean(rows, axis=0) for name, rows in errors.items()}


def _errors(examples: Array, truth: Array) -> Array:
    """Return the errors (N, dimensions) of poses (N, D) projected onto the PCA of examples."""
    model = fit(np.asarray(examples, dtype=np.float64), DIMENSIONS[-1])
    weights = (truth - model.mean) @ model.basis
    columns = [l1_distance_deg(model.mean + weights[:, :d] @ model.basis[:, :d].T, truth) for d in DIMENSIONS]
    return np.stack(columns, axis=1)


def _mixture_errors(sample: Array, truth: Array) -> Array:
    """Return the errors of poses projected onto the PCA of their k-means cluster."""
    count = max(2, len(sample) // _FRAMES_PER_CLUSTER)
    centres = sample[np.random.default_rng(0).choice(len(sample), count, replace=False)]
    for _ in range(10):
        cluster = _closest(sample, centres)
        centres = np.array(
            [sample[cluster == i].mean(axis=0) if np.any(cluster == i) else centres[i] for i in range(count)]
        )
    cluster, own = _closest(sample, centres), _closest(truth, centres)
    result = np.empty((len(truth), len(DIMENSIONS)))
    for i in np.unique(own):
        examples = sample[cluster == i]
        result[own == i] = _errors(examples if len(examples) > 1 else sample, truth[own == i])
    return result


def _closest(poses: Array, centres: Array) -> NDArray[np.int64]:
    return np.argmin(np.einsum("cd,cd->c", centres, centres) - 2.0 * (poses @ centres.T), axis=1)


def _part(whole: Database, out: Path, name: str, kept: Iterable[tuple[Clip, int, int]]) -> Database:
    return write_subset(whole, out / "databases" / f"figure5-{name}.perfdb", kept)


def _one_walk(clips: Iterable[Clip]) -> list[tuple[Clip, int, int]]:
    for clip in clips:
        if clip.behaviour == "walk" and clip.stop - clip.start >= _SMALL_FRAMES:
            return [(clip, 0, _SMALL_FRAMES)]
    raise DatabaseError(f"has no walk of {_SMALL_FRAMES} frames", advice="give the complete recordings with --data")


def _martial(clips: Iterable[Clip]) -> list[tuple[Clip, int, int]]:
    return [(clip, 0, clip.stop - clip.start) for clip in clips if clip.behaviour in _MARTIAL]


def _needed(rows: list[dict[str, Any]], database: str, model: str) -> dict[str, Any]:
    """Return the fewest dimensions for less than one degree, None where none of those tried suffices."""
    mine = [row for row in rows if (row["database"], row["model"]) == (database, model)]
    enough = [row["dimensions"] for row in mine if row["deg_per_angle"] < _GOOD_ENOUGH_DEG]
    paper = PAPER[database].get(model)
    return {"database": database, "model": model, "dimensions": min(enough) if enough else None, "paper": paper}
