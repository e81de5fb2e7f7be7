"""The paper's local model: PCA of the nearest poses (Eq. 3), with cross-validation."""

from dataclasses import dataclass

import numpy as np

from ...geometry.arrays import Array, IntArray, Mask

_VARIANCE_FLOOR = 1e-8  # smallest variance, rad^2, so that directions in which neighbours agree are not rigid
_VALIDATION_DIRECTIONS = 32  # number of principal directions used in the cross-validation: nearly all variance
_FEWEST_KEPT = 8  # fewest neighbours from which a model is made


@dataclass(frozen=True)
class LocalModel:
    """Linear model of a pose, q = mean + basis w, with the variances of w among the neighbours."""

    mean: Array  # (D,) p_t in Eq. 3
    basis: Array  # (D, B) U_t, orthonormal columns
    variances: Array  # (B,) eigenvalues, descending
    neighbours: int  # number of neighbours, K

    @property
    def dimensions(self) -> int:
        """Number of dimensions, B."""
        return self.basis.shape[1]

    def pose(self, weights: Array) -> Array:
        """Return the pose (D,) for weights (B,)."""
        return self.mean + self.basis @ weights

    def weights(self, pose: Array) -> Array:
        """Return the weights (B,) of the model's pose that is closest to `pose` (D,)."""
        return self.basis.T @ (pose - self.mean)


@dataclass(frozen=True)
class Validation:
    """Model with the best K and B, and the mean squared errors, rad^2, of all candidates (K, B), inf if not tried."""

    model: LocalModel
    scores: Array


def fit(poses: Array, dimensions: int) -> LocalModel:
    """Return the local model of poses (K, D) with at most `dimensions` directions."""
    mean = poses.mean(axis=0)
    centred = poses - mean
    count = len(poses)
    dimensions = min(dimensions, count - 1, poses.shape[1])
    if count <= poses.shape[1]:  # the smaller of the two Gram matrices has the same eigenvalues
        values, vectors = np.linalg.eigh(centred @ centred.T)
        values, vectors = values[::-1][:dimensions], vectors[:, ::-1][:, :dimensions]
        basis = centred.T @ (vectors / np.sqrt(np.maximum(values, 1e-300)))
    else:
        values, vectors = np.linalg.eigh(centred.T @ centred)
        values, basis = values[::-1][:dimensions], vectors[:, ::-1][:, :dimensions]
    return LocalModel(mean, basis, np.maximum(values / max(count - 1, 1), _VARIANCE_FLOOR), count)


def cross_validate(
    poses: Array,
    markers: Array,
    groups: IntArray,
    neighbours: tuple[int, ...],
    dimensions: tuple[int, ...],
    marker_variance_m2: float,
    examples: int,
) -> Validation:
    """Choose K and B by cross-validation with the examples closest to the query.

    Each example is left out with its whole clip, because a frame's neighbours in its own clip are near copies of it.
    For each K the model is learned without the clip; the example is then reconstructed from its markers for every B,
    with the prior of Eq. 6 and the control term of Eq. 7 in their linear form (markers as a linear function of the
    weights, by least squares).

    Args:
        poses: Neighbours (K_max, D), closest first.
        markers: Marker coordinates (K_max, m) of the neighbours, metres.
        groups: Group (K_max,) of each neighbour; a group is left out as a whole.
        neighbours: Ascending candidates for K.
        dimensions: Ascending candidates for B.
        marker_variance_m2: Variance of a marker coordinate in the control term.
        examples: Number of closest examples to leave out.
    """
    sizes = [k for k in neighbours if k <= len(poses)] or [len(poses)]
    space = fit(poses, max(_VALIDATION_DIRECTIONS, dimensions[-1]))
    coordinates = (poses - space.mean) @ space.basis
    outside = np.sum((poses - space.mean) ** 2, axis=1) - np.sum(coordinates**2, axis=1)
    scores = np.full((len(sizes), len(dimensions)), np.inf)
    tested = np.unique(groups[: min(examples, sizes[0])])
    for row, size in enumerate(sizes):
        errors = [
            _left_out_errors(coordinates[:size], markers[:size], groups[:size] == group, dimensions,
                             marker_variance_m2, min(examples, sizes[0]))
            for group in tested
        ]  # fmt: skip
        # all K are scored on the same examples, so a K that leaves too few neighbours without some clip is not tried
        known = [error for error in errors if error is not None]
        if len(known) == len(errors):
            scores[row] = np.mean(np.concatenate(known, axis=1), axis=1)
    scores += np.maximum(outside[:examples], 0.0).mean()
    if np.all(np.isinf(scores)):  # with only one clip nothing can be left out, so the largest model is taken
        return Validation(fit(poses[: sizes[-1]], dimensions[-1]), scores)
    best_row, best_column = divmod(int(np.argmin(scores)), len(dimensions))
    return Validation(fit(poses[: sizes[best_row]], dimensions[best_column]), scores)


def _left_out_errors(
    coordinates: Array, markers: Array, left_out: Mask, dimensions: tuple[int, ...], variance: float,
    examples: int,
) -> Array | None:  # fmt: skip
    """Return squared errors (B, tested) of left-out examples, or None if too few neighbours remain."""
    kept = ~left_out
    count = int(kept.sum())
    if count < _FEWEST_KEPT:
        return None
    mean, marker_mean = coordinates[kept].mean(axis=0), markers[kept].mean(axis=0)
    centred, centred_markers = coordinates[kept] - mean, markers[kept] - marker_mean
    values, vectors = np.linalg.eigh(centred.T @ centred)
    values, vectors = np.maximum(values[::-1], 1e-12), vectors[:, ::-1]
    # d markers / d weights by least squares, which is a division because the weights are uncorrelated
    slopes = (centred_markers.T @ (centred @ vectors)) / values
    variances = np.maximum(values / (count - 1), _VARIANCE_FLOOR)
    tested = np.flatnonzero(left_out[:examples])
    weights = (coordinates[tested] - mean) @ vectors
    offsets = (markers[tested] - marker_mean).T
    result = np.full((len(dimensions), len(tested)), np.inf)
    for row, dimension in enumerate(dimensions):
        if dimension >= count:
            break
        slope = slopes[:, :dimension]
        normal = slope.T @ slope / variance + np.diag(1.0 / variances[:dimension])
        predicted = np.linalg.solve(normal, slope.T @ offsets / variance).T
        inside = np.sum((weights[:, :dimension] - predicted) ** 2, axis=1)
        result[row] = inside + np.sum(weights[:, dimension:] ** 2, axis=1)
    return result
