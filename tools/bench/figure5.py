"""Figure 5 of the paper: reconstruction of poses by low-dimensional models."""

import importlib.util
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from perfanim.core.body.joint_angle_frames import with_angle_frames
from perfanim.core.body.motion_metrics import angle_errors_deg
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.store import Database, rotations_from_pose
from perfanim.core.errors import DatabaseError
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array, IntArray
from perfanim.core.solver.paper.local_model import fit

from .plots import Line, Panel, check_plots, write_plot
from .run import Run
from .scenarios import BANDAI, CMU

DIMENSIONS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 15, 18, 21, 24, 27, 30, 34, 38, 42, 46, 50)
GPLVM_DIMENSIONS = tuple(d for d in DIMENSIONS if d <= 10)  # each takes 14 s
PCA, MIXTURE, LOCAL, STRICT, GPLVM = (
    "global PCA", "mixture of local models", "local model", "local model, own second left out", "GPLVM",
)  # fmt: skip
# dimensions needed for less than one degree per joint angle
PAPER = {
    "walking": {PCA: 14, MIXTURE: 6, LOCAL: 4},
    "boxing and martial arts": {PCA: 27, MIXTURE: 18, LOCAL: 6},
    "heterogeneous": {PCA: 38, MIXTURE: 27, LOCAL: 5},
}
PAPER_GPLVM = (2, 2.7)  # dimensions and degrees, for walking
_GOOD_ENOUGH_DEG = 1.0
_SHOWN_DEG = 12.0
_TESTED = 250  # frames tested
_NEIGHBOURS = 64
_SMALL_FRAMES = 350  # at 60 Hz as long as the paper's 700 frames at 120 Hz
_GPLVM_FRAMES = 1000  # largest database from which a GPLVM is learned
_GPLVM_TESTED = 5  # step between the frames that are tested, and left out of the examples
_SAMPLE = 60_000  # frames from which global PCA and the mixture are learned
_MARTIAL = ("boxing", "empi", "gedanbarai", "heiansyodan", "mawashigeri", "syutouuke", "yokogeri", "kick", "slash")
_ROUNDS = 30  # largest number of k-means iterations
_FRAMES_PER_CLUSTER = 400  # a few times the size of the covariance learned from them
_GPLVM_STEPS = 300  # L-BFGS steps: 1000 change the error by less than a tenth
_GPLVM_NOISE = 0.01  # initial share of the variance


class Curve(NamedTuple):
    """Error of a model as a function of its dimension."""

    dimensions: tuple[int, ...]  # (N,) numbers used to describe a pose
    deg_per_angle: Array  # (N,) mean absolute difference of the joint angles
    rms_deg_per_angle: Array  # (N,) root of their mean square in a frame, averaged over the frames


def figure5(run: Run) -> dict[str, Any]:
    """Reconstruct frames of three databases with each model; write the figure.

    Returns:
        rows (database, frames, model, dimensions, errors), needed (per database and model the dimensions for less
        than one degree, the paper's, and the reason if there is no value), outputs.
    """
    check_plots()
    rows: list[dict[str, Any]] = []
    needed: list[dict[str, Any]] = []
    panels = []
    for number, (name, database) in enumerate(_databases(run).items()):
        run.progress(0.3 + 0.2 * number, f"reconstructing {name}")
        curves, missing = reconstruction_errors(database), gplvm_missing(database)
        if missing is None:
            run.progress(0.4, f"learning a GPLVM of {name}")
            curves[GPLVM] = gplvm_errors(database)
        for model, curve in curves.items():
            of: dict[str, Any] = {"database": name, "frames": database.frames, "model": model}
            for d, mean, rms in zip(*curve, strict=True):
                rows.append(of | {"dimensions": d, "deg_per_angle": float(mean), "rms_deg_per_angle": float(rms)})
            needed.append(_needed(name, model, curve))
        if missing is not None:
            nothing = dict.fromkeys(("dimensions", "dimensions_rms", "paper"))
            needed.append({"database": name, "model": GPLVM} | nothing | {"note": missing})
        marks = {model: (d, _GOOD_ENOUGH_DEG) for model, d in PAPER[name].items()} | {GPLVM: PAPER_GPLVM}
        lines = [Line(model, np.array(c.dimensions), c.deg_per_angle, marks.get(model)) for model, c in curves.items()]
        panels.append(Panel(f"{name}, {database.frames:,} frames", lines, _GOOD_ENOUGH_DEG, _SHOWN_DEG))
    y_label = "error (degrees per joint angle)"
    plots = write_plot(run.out / "figure5", panels, "number of dimensions", y_label, markers=True)
    return run.write("figure5", {"rows": rows, "needed": needed}, {"": rows, "needed": needed}, plots)


def _databases(run: Run) -> dict[str, Database]:
    """Return the whole database, one walk from it, and its boxing and martial arts."""
    whole = run.whole(CMU, BANDAI)
    walks = [clip for clip in whole.clips if clip.behaviour == "walk" and clip.stop - clip.start >= _SMALL_FRAMES]
    if not walks:
        advice = "give the complete recordings with --data"
        raise DatabaseError(f"has no walk of {_SMALL_FRAMES} frames", where=str(whole.path), advice=advice)
    martial = [(clip, 0, clip.stop - clip.start) for clip in whole.clips if clip.behaviour in _MARTIAL]
    return {
        "walking": run.subset(whole, "figure5-walking", [(walks[0], 0, _SMALL_FRAMES)]),
        "boxing and martial arts": run.subset(whole, "figure5-martial", martial),
        "heterogeneous": whole,
    }


def reconstruction_errors(database: Database) -> dict[str, Curve]:
    """Return the errors of each model.

    Global PCA and the mixture reconstruct the poses that they were learned from, as in the paper. The local model is
    learned from the frames closest to the pose: without the pose's own frame ("local model"), or without the
    surrounding second of its clip, which is nearly the same (`STRICT`). The paper does not say which it excludes.
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
    """Return why no GPLVM is learned from a database, or None if one is."""
    if database.frames > _GPLVM_FRAMES:
        return f"not computed: its cost grows with the cube of the frames, feasible up to {_GPLVM_FRAMES}"
    if not has_gplvm():
        return "not computed: it needs GPy, which is missing (pip install 'perfanim[gplvm]')"
    return None


def gplvm_errors(database: Database) -> Curve:
    """Return the errors of a GPLVM on every fifth frame, which is left out of its examples.

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


def _needed(name: str, model: str, curve: Curve) -> dict[str, Any]:
    """Return the smallest dimension with an error below one degree, or None if there is none."""
    mean, rms = (
        next((d for d, error in zip(curve.dimensions, errors, strict=True) if error < _GOOD_ENOUGH_DEG), None)
        for errors in (curve.deg_per_angle, curve.rms_deg_per_angle)
    )
    paper = PAPER[name].get(model)
    return {"database": name, "model": model, "dimensions": mean, "dimensions_rms": rms, "paper": paper, "note": ""}


# ---- models: reconstructions (dimensions, N, D) of poses (N, D), one for each dimension


def linear(examples: Array, truth: Array, dimensions: Sequence[int]) -> Array:
    """Return poses projected onto the principal components of examples (K, D)."""
    model = fit(np.asarray(examples, dtype=np.float64), dimensions[-1])
    weights = (truth - model.mean) @ model.basis
    return np.stack([model.mean + weights[:, :d] @ model.basis[:, :d].T for d in dimensions])


def mixture(examples: Array, truth: Array, dimensions: Sequence[int]) -> Array:
    """Reconstruct poses with a mixture of local linear models: k-means, then PCA per cluster.

    This is the paper's mixture (Bregler and Omohundro 1995). A pose belongs to the cluster that reconstructs it best
    (Kambhatla and Leen 1997), which is never worse than the cluster with the nearest centre.
    """
    members = _k_means(examples, max(2, len(examples) // _FRAMES_PER_CLUSTER))
    best, errors = linear(examples, truth, dimensions), np.full((len(dimensions), len(truth)), np.inf)
    for cluster in np.unique(members):
        own = examples[members == cluster]
        if len(own) < 2:
            continue
        found = linear(own, truth, dimensions)
        found_errors = np.sum((found - truth) ** 2, axis=-1)
        better = found_errors < errors
        best[better], errors[better] = found[better], found_errors[better]
    return best


def _k_means(poses: Array, count: int) -> IntArray:
    """Return the cluster (N,) of every pose by k-means, started with k-means++ (Arthur and Vassilvitskii 2007)."""
    generator = np.random.default_rng(0)
    norms = np.einsum("fd,fd->f", poses, poses)
    centres = poses[generator.integers(len(poses))][None]
    nearest = np.full(len(poses), np.inf)
    while len(centres) < count:
        to_last = norms - 2.0 * (poses @ centres[-1]) + centres[-1] @ centres[-1]
        nearest = np.maximum(np.minimum(nearest, to_last), 0.0)
        if nearest.sum() <= 0.0:  # fewer distinct poses than clusters
            break
        centres = np.concatenate((centres, poses[generator.choice(len(poses), p=nearest / nearest.sum())][None]))
    members = np.full(len(poses), -1, dtype=np.int64)
    for _ in range(_ROUNDS):
        before = members
        members = np.argmin(np.einsum("cd,cd->c", centres, centres) - 2.0 * (poses @ centres.T), axis=1)
        if np.array_equal(members, before):
            break
        for cluster in np.unique(members):
            centres[cluster] = poses[members == cluster].mean(axis=0)
    return members


def has_gplvm() -> bool:
    """Return whether the library that learns GPLVMs is installed."""
    return importlib.util.find_spec("GPy") is not None


def gplvm(examples: Array, truth: Array, dimensions: Sequence[int]) -> Array:
    """Reconstruct poses with a Gaussian process latent variable model.

    See Lawrence 2004; needs `has_gplvm`. A pose's latent point is the one that maps closest to it, searched from that
    of the closest example. Time grows with the cube of the number of examples: a few hundred are feasible.
    """
    import GPy
    from scipy.optimize import minimize

    mean, scale = examples.mean(axis=0), examples.std()
    outputs, targets = (examples - mean) / scale, (truth - mean) / scale
    closest = np.argmin(np.sum((targets[:, None] - outputs) ** 2, axis=-1), axis=1)
    result = np.empty((len(dimensions), *truth.shape))
    for row, count in enumerate(dimensions):
        kernel = GPy.kern.RBF(count) + GPy.kern.Bias(count)
        model = GPy.models.GPLVM(outputs, count, init="PCA", kernel=kernel)
        model.likelihood.variance = _GPLVM_NOISE
        model.optimize("lbfgs", max_iters=_GPLVM_STEPS)
        latent, loads = np.asarray(model.X), np.asarray(model.posterior.woodbury_vector)

        def image(point: Array, kernel: object = kernel, latent: Array = latent, loads: Array = loads) -> Array:
            return np.asarray((kernel.K(point[None], latent) @ loads)[0])  # type: ignore[attr-defined]

        for frame, target in enumerate(targets):
            found = minimize(lambda x, y=target, f=image: np.sum((f(x) - y) ** 2), latent[closest[frame]])
            result[row, frame] = image(found.x) * scale + mean
    return result
