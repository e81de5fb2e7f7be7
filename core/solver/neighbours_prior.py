"""Gaussian of the neighbours' poses, conditioned on the past.

The neighbours' poses, their earlier markers and their earlier poses have a joint Gaussian distribution, widened by a
fraction of the whole database's covariance, so that it still allows only movements that bodies make (a knee does not
twist). The pose given the past is a linear regression (Bishop 2006, Eq. 2.81).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array, FloatArray
from ..kernel.library import address, checked, contiguous, function, stage
from .gaussian_conditioning import Prior, conditioned

WIDTH = 0.2  # squared distance, as a share of the largest one, at which a neighbour's weight has fallen to 1/e
TINY = np.float32(1e-3)  # differences below about a ten-millionth of this are rounded to zero
PANEL = 16  # number of columns that the kernel keeps together


@dataclass(frozen=True)
class Neighbours:
    """The K database frames that are like the current one."""

    distances: Array  # (K,) squared distances (Eq. 2)
    poses: FloatArray  # (K, D)
    markers: FloatArray  # (K, H) earlier markers
    before: FloatArray  # (K, C) earlier poses


_PRIOR = function("neighbours_prior", "pppppddfpppppppp")


def _compiled(neighbours: Neighbours, share: float, past: Array, variances: Array, floor: FloatArray) -> Prior:
    count, size = neighbours.poses.shape
    sizes = np.array([count, size, neighbours.markers.shape[1], neighbours.before.shape[1]])
    whole = len(floor)
    mean, covariance = np.empty(size), np.empty((size, size))
    columns = np.empty(whole, dtype=np.int64)
    single = np.empty((whole + PANEL) * count, dtype=np.float32)
    work = np.empty(count + (whole + 1) * (whole + 4))
    rows = (contiguous(each, np.float32) for each in (neighbours.poses, neighbours.markers, neighbours.before))
    given = contiguous(past), contiguous(variances), contiguous(floor, np.float32)
    settings = share, WIDTH, float(TINY)
    checked(
        _PRIOR(
            address(sizes), *rows, contiguous(neighbours.distances), *settings, *given,
            address(columns), address(single), address(work), address(mean), address(covariance),
        )
    )  # fmt: skip
    return Prior(mean, covariance)


@stage(_compiled)
def neighbours_prior(neighbours: Neighbours, share: float, past: Array, variances: Array, floor: FloatArray) -> Prior:
    """Return the Gaussian of the neighbours' poses given the past.

    Args:
        share: Weight of the squared distances of earlier markers relative to `Neighbours.distances`.
        past: The performer's earlier markers and poses (H + C,), NaN where unknown.
        variances: Variances (H + C,) of their differences from a neighbour's.
        floor: Covariance (D + H + C, D + H + C) added to that of the neighbours, so that entries that are equal in all
            neighbours can still change.
    """
    markers = neighbours.markers
    known = np.isfinite(past[: markers.shape[1]])
    observed = past[: len(known)]
    away = markers - observed if known.all() else markers[:, known] - observed[known]
    distances = np.maximum(neighbours.distances, 0.0) + share * np.add.reduce(away * away, axis=1)
    weights = np.exp(-distances / (WIDTH * distances.max() + 1e-12))
    weights /= weights.sum()
    samples = np.concatenate((neighbours.poses, markers, neighbours.before), axis=1)
    return gaussian_given(samples, weights, floor, past, variances)


def gaussian_given(
    samples: NDArray[Any], weights: Array, floor: NDArray[Any], observed: Array, variances: Array
) -> Prior:
    """Return the Gaussian of the first entries of samples given the last m (Bishop 2006, Eq. 2.81).

    Single precision is enough for the differences between samples.

    Args:
        samples: Samples (K, D + m).
        weights: Their positive weights (K,), with sum 1.
        floor: Covariance (D + m, D + m) added to that of the samples.
        observed: Observed values (m,) of the last entries, NaN where unknown.
        variances: Variances (m,) of the observations.
    """
    kept, seen = samples.shape[1] - len(observed), np.isfinite(observed)
    if not seen.all():
        columns = np.concatenate((np.arange(kept), kept + np.flatnonzero(seen)))
        samples, floor = samples[:, columns], floor[np.ix_(columns, columns)]
        observed, variances = observed[seen], variances[seen]
    shares = weights.astype(samples.dtype)
    spread = samples - samples[0]
    shift = shares.astype(np.float64) @ spread  # digits are left where the first sample is far from the others
    spread -= shift.astype(spread.dtype)
    # round tiny differences to zero: their products would be subnormal numbers, which are slow
    spread += TINY
    spread -= TINY
    spread *= np.sqrt(shares)[:, None]
    mean = samples[0] + shift
    # double precision from here on, because in single precision subnormal numbers would occur
    covariance = (spread.T @ spread + floor).astype(np.float64)
    own = covariance[kept:, kept:] + np.diag(variances)
    return conditioned(
        Prior(mean[:kept], covariance[:kept, :kept]), covariance[:kept, kept:], own, observed - mean[kept:]
    )
