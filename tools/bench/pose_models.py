"""Pose models of few dimensions that Figure 5 compares.

Every function returns reconstructions (dimensions, N, D) of poses (N, D), one for each number of dimensions.
"""

import importlib.util
from collections.abc import Sequence

import numpy as np
from perfanim.core.geometry.arrays import Array, IntArray
from perfanim.core.solver.paper.local_model import fit
from scipy.optimize import minimize

_ROUNDS = 30  # of k-means, at most
_FRAMES_PER_CLUSTER = 400  # a few times the size of the covariance that is learned from them
_FEWEST_CLUSTERS = 2
_GPLVM_STEPS = 300  # of L-BFGS: 1000 change the error by less than a tenth
_GPLVM_NOISE = 0.01  # share of the variance, to start with


def linear(examples: Array, truth: Array, dimensions: Sequence[int]) -> Array:
    """Return poses projected onto the principal components of examples (K, D)."""
    model = fit(np.asarray(examples, dtype=np.float64), dimensions[-1])
    weights = (truth - model.mean) @ model.basis
    return np.stack([model.mean + weights[:, :d] @ model.basis[:, :d].T for d in dimensions])


def mixture(examples: Array, truth: Array, dimensions: Sequence[int]) -> Array:
    """Reconstruct poses by a mixture of local linear models: k-means, PCA per cluster.

    The paper's mixture (Bregler and Omohundro 1995). A pose belongs to the cluster that reconstructs it best (Kambhatla
    and Leen 1997): as many numbers, and never worse than the cluster with the nearest centre.
    """
    count = max(_FEWEST_CLUSTERS, len(examples) // _FRAMES_PER_CLUSTER)
    members = _k_means(examples, count)
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
    """Return the cluster (N,) of every pose by k-means.

    The first centres are those of k-means++ (Arthur and Vassilvitskii 2007).
    """
    generator = np.random.default_rng(0)
    norms = np.einsum("fd,fd->f", poses, poses)
    centres = poses[generator.integers(len(poses))][None]
    nearest = np.full(len(poses), np.inf)
    while len(centres) < count:
        to_last = norms - 2.0 * (poses @ centres[-1]) + centres[-1] @ centres[-1]
        nearest = np.maximum(np.minimum(nearest, to_last), 0.0)
        if nearest.sum() <= 0.0:  # fewer different poses than clusters
            break
        chosen = generator.choice(len(poses), p=nearest / nearest.sum())
        centres = np.concatenate((centres, poses[chosen][None]))
    members = np.full(len(poses), -1, dtype=np.int64)
    for _ in range(_ROUNDS):
        before = members
        members = np.argmin(np.einsum("cd,cd->c", centres, centres) - 2.0 * (poses @ centres.T), axis=1)
        if np.array_equal(members, before):
            break
        order = np.argsort(members, kind="stable")
        filled, starts = np.unique(members[order], return_index=True)
        centres[filled] = (
            np.add.reduceat(poses[order], starts, axis=0) / np.diff(np.append(starts, len(poses)))[:, None]
        )
    return members


def has_gplvm() -> bool:
    """Return True if the library that learns GPLVMs is installed."""
    return importlib.util.find_spec("GPy") is not None


def gplvm(examples: Array, truth: Array, dimensions: Sequence[int]) -> Array:
    """Reconstruct poses by a Gaussian process latent variable model.

    Lawrence 2004; needs `has_gplvm`. The latent point of a pose maps closest to it, searched from that of the closest
    example. Time grows with the cube of the examples: a few hundred are feasible.
    """
    import GPy

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
