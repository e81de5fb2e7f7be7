"""Figure 5 of the paper: reconstruction of poses by models of few dimensions."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.joint_angle_frames import with_angle_frames
from perfanim.core.body.motion_metrics import angle_errors_deg
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.store import Clip, Database, rotations_from_pose
from perfanim.core.errors import DatabaseError
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array
from perfanim.core.system.progress import Progress

from .data import BANDAI, CMU, whole_database
from .plots import Line, Panel, check_plots, write_plot
from .pose_models import gplvm, has_gplvm, linear, mixture
from .report import write_figures
from .subset import write_subset

DIMENSIONS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 15, 18, 21, 24, 27, 30, 34, 38, 42, 46, 50)
GPLVM_DIMENSIONS = tuple(d for d in DIMENSIONS if d <= 10)  # 14 s each
PCA, MIXTURE, LOCAL, STRICT, GPLVM = (
    "global PCA",
    "mixture of local models",
    "local model",
    "local model, own second left out",
    "GPLVM",
)
# dimensions for less than one degree per joint angle
PAPER = {
    "walking": {PCA: 14, MIXTURE: 6, LOCAL: 4},
    "boxing and martial arts": {PCA: 27, MIXTURE: 18, LOCAL: 6},
    "heterogeneous": {PCA: 38, MIXTURE: 27, LOCAL: 5},
}
PAPER_GPLVM = (2, 2.7)  # dimensions and degrees, on walking
_GOOD_ENOUGH_DEG = 1.0
_SHOWN_DEG = 12.0
_TESTED = 250  # frames
_NEIGHBOURS = 64
_SMALL_FRAMES = 350  # at 60 Hz as long as the 700 frames at 120 Hz of the paper
_GPLVM_FRAMES = 1000  # up to which a GPLVM is learned
_GPLVM_TESTED = 5  # one frame of so many is tested, and left out of the examples
_SAMPLE = 60_000  # frames that global PCA and the mixture are learned from
_MARTIAL = ("boxing", "empi", "gedanbarai", "heiansyodan", "mawashigeri", "syutouuke", "yokogeri", "kick", "slash")


@dataclass(frozen=True)
class Curve:
    """Error of a model by its dimension.

    Args:
        dimensions: (N,) numbers that describe a pose.
        deg_per_angle: (N,) mean absolute difference of the joint angles.
        rms_deg_per_angle: (N,) root of their mean square in a frame, averaged over the frames.
    """

    dimensions: tuple[int, ...]
    deg_per_angle: Array
    rms_deg_per_angle: Array


def figure5(data: Path, out: Path, workers: int, progress: Progress) -> dict[str, Any]:
    """Reconstruct frames of three databases by each model; write the figure.

    Returns:
        rows (database, frames, model, dimensions, errors), needed (per database and model the dimensions for less
        than one degree, the paper's, and why there is no figure where there is none), outputs.
    """
    check_plots()
    whole = whole_database(data, out, (CMU, BANDAI), workers, progress)
    databases = {
        "walking": _part(whole, out, "walking", _one_walk(whole.clips)),
        "boxing and martial arts": _part(whole, out, "martial", _martial(whole.clips)),
        "heterogeneous": whole,
    }
    rows: list[dict[str, Any]] = []
    needed: list[dict[str, Any]] = []
    panels = []
    for number, (name, database) in enumerate(databases.items()):
        progress(0.3 + 0.7 * number / len(databases), f"reconstructing {name}")
        curves = reconstruction_errors(database)
        missing = gplvm_missing(database)
        if missing is None:
            progress(0.4, f"learning a GPLVM of {name}")
            curves[GPLVM] = gplvm_errors(database)
        rows += list(_rows(name, database, curves))
        needed += [_needed(name, model, curve) for model, curve in curves.items()]
        if missing is not None:
            needed.append({"database": name, "model": GPLVM, "dimensions": None, "dimensions_rms": None, "paper": None,
                           "note": missing})  # fmt: skip
        title = f"{name}, {database.frames:,} frames"
        panels.append(Panel(title, _lines(name, curves), _GOOD_ENOUGH_DEG, _SHOWN_DEG))
    figures = {"rows": rows, "needed": needed}
    plots = write_plot(out / "figure5", panels, "number of dimensions", "error (degrees per joint angle)", True)
    return write_figures(out, "figure5", figures, {"": rows, "needed": needed}, plots)


def reconstruction_errors(database: Database) -> dict[str, Curve]:
    """Return the errors of each model.

    Global PCA and the mixture reconstruct the poses that they were learned from, as in the paper. The local model is
    learned from the frames closest to the pose: without the pose's own frame ("local model"), or without the second
    of its clip around it, near copies of the pose (`STRICT`). The paper does not say which frames it leaves out.
    """
    poses = database.poses.reshape(database.frames, -1)
    tested = np.unique(np.linspace(0, database.frames - 1, _TESTED).astype(np.int64))
    truth = poses[tested].astype(np.float64)
    sample = poses[:: max(1, database.frames // _SAMPLE)].astype(np.float64)
    norms = np.einsum("fd,fd->f", poses, poses)
    local: dict[str, list[Array]] = {LOCAL: [], STRICT: []}
    for frame, pose in zip(tested, truth, strict=True):
        distances = norms - 2.0 * (poses @ pose.astype(np.float32))
        for name, around in ((LOCAL, 0), (STRICT, round(0.5 * database.fps))):
            distances[max(0, frame - around) : frame + around + 1] = np.inf
            count = min(_NEIGHBOURS, database.frames - 2 * around - 1)
            examples = poses[np.argpartition(distances, count - 1)[:count]]
            local[name].append(linear(examples, pose[None], DIMENSIONS))
    found = {PCA: linear(sample, truth, DIMENSIONS), MIXTURE: mixture(sample, truth, DIMENSIONS)}
    found |= {name: np.concatenate(rows, axis=1) for name, rows in local.items()}
    return {name: _curve(database, DIMENSIONS, poses, truth) for name, poses in found.items()}


def gplvm_missing(database: Database) -> str | None:
    """Return why no GPLVM is learned of a database, None where one is."""
    if database.frames > _GPLVM_FRAMES:
        return f"not computed: its cost grows with the cube of the frames, feasible up to {_GPLVM_FRAMES}"
    if not has_gplvm():
        return "not computed: it needs GPy, which is missing (pip install 'perfanim[gplvm]')"
    return None


def gplvm_errors(database: Database) -> Curve:
    """Return the errors of a GPLVM on every fifth frame, left out of its examples.

    A Gaussian process reproduces its examples exactly in any number of dimensions.
    """
    poses = database.poses.reshape(database.frames, -1).astype(np.float64)
    tested = np.arange(database.frames) % _GPLVM_TESTED == _GPLVM_TESTED // 2
    found = gplvm(poses[~tested], poses[tested], GPLVM_DIMENSIONS)
    return _curve(database, GPLVM_DIMENSIONS, found, poses[tested])


def _curve(database: Database, dimensions: tuple[int, ...], found: Array, truth: Array) -> Curve:
    """Return the errors of poses (dimensions, N, D) against the true ones (N, D)."""
    skeleton = with_angle_frames(default_skeleton())
    true_rotations, *rotations = (
        rotations_from_pose(poses.reshape(len(truth), -1, 3), database.mean_rotations, rot.identity())
        for poses in (truth, *found)
    )
    errors = np.array([angle_errors_deg(skeleton, each, true_rotations)[0] for each in rotations])
    return Curve(dimensions, errors.mean(axis=(1, 2)), np.sqrt(np.mean(errors**2, axis=2)).mean(axis=1))


def _part(whole: Database, out: Path, name: str, kept: Iterable[tuple[Clip, int, int]]) -> Database:
    return write_subset(whole, out / "databases" / f"figure5-{name}.pfdb", kept)


def _one_walk(clips: Iterable[Clip]) -> list[tuple[Clip, int, int]]:
    for clip in clips:
        if clip.behaviour == "walk" and clip.stop - clip.start >= _SMALL_FRAMES:
            return [(clip, 0, _SMALL_FRAMES)]
    raise DatabaseError(f"has no walk of {_SMALL_FRAMES} frames", advice="give the complete recordings with --data")


def _martial(clips: Iterable[Clip]) -> list[tuple[Clip, int, int]]:
    return [(clip, 0, clip.stop - clip.start) for clip in clips if clip.behaviour in _MARTIAL]


def _rows(name: str, database: Database, curves: dict[str, Curve]) -> Iterator[dict[str, Any]]:
    for model, curve in curves.items():
        for d, mean, rms in zip(curve.dimensions, curve.deg_per_angle, curve.rms_deg_per_angle, strict=True):
            yield {"database": name, "frames": database.frames, "model": model, "dimensions": d,
                   "deg_per_angle": float(mean), "rms_deg_per_angle": float(rms)}  # fmt: skip


def _needed(name: str, model: str, curve: Curve) -> dict[str, Any]:
    """Return the fewest dimensions for less than one degree, None if none suffices."""
    mean, rms = (
        next((d for d, error in zip(curve.dimensions, errors, strict=True) if error < _GOOD_ENOUGH_DEG), None)
        for errors in (curve.deg_per_angle, curve.rms_deg_per_angle)
    )
    paper = PAPER[name].get(model)
    return {"database": name, "model": model, "dimensions": mean, "dimensions_rms": rms, "paper": paper, "note": ""}


def _lines(name: str, curves: dict[str, Curve]) -> list[Line]:
    marks = {model: (d, _GOOD_ENOUGH_DEG) for model, d in PAPER[name].items()} | {GPLVM: PAPER_GPLVM}
    return [Line(model, np.array(c.dimensions), c.deg_per_angle, marks.get(model)) for model, c in curves.items()]
