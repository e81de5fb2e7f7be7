"""Labelling the blobs of a single camera, frame by frame.

A marker that was just visible is extrapolated in the image. A hidden one is expected at its position in the last pose,
with an uncertainty that grows with the time for which it has been hidden. One assignment of all blobs to all markers
weighs the distances of blobs from markers against these uncertainties; otherwise a marker hidden for long, which may be
anywhere, would take its neighbours' blobs.
"""

from copy import copy
from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, IntArray, Mask
from ..geometry.camera import Camera
from ..geometry.gated_assignment import assign


@dataclass(frozen=True)
class SingleViewSettings:
    """Settings of `SingleViewLabeller`.

    Deviations are measured across the ray at the marker's distance; costs are minus twice the log likelihood.
    """

    memory_s: float = 0.1  # longest time for which the last movement in the image is used
    image_m: float = 0.006  # standard deviation of an extrapolated marker
    image_m_s2: float = 30.0  # standard deviation of an extrapolated marker's acceleration
    body_m: float = 0.05  # standard deviation of the pose's markers
    body_m_s: float = 0.5  # growth of this deviation per second that a marker has been hidden
    body_most_m: float = 0.20  # largest such deviation of a marker on a limb
    torso_most_m: float = 0.06  # the same on the torso
    unlikely: float = 20.0  # cost above which a blob does not belong to the marker
    certain: float = 4.0  # cost of a label below which no alternatives to it are tried
    alternative: float = 12.0  # cost relative to the best assignment below which an assignment is an alternative
    nearest_m: float = 0.1  # smallest depth of a marker


_S = SingleViewSettings()


class SingleViewLabeller:
    """Labels the blobs of successive frames of one camera.

    Args:
        torso: Markers (M,) on the torso. If the torso is located, they are reliable even after being hidden for long.
    """

    def __init__(self, camera: Camera, torso: Mask) -> None:
        self._camera = camera
        self._most_m = np.where(torso, _S.torso_most_m, _S.body_most_m)
        self._points = np.full((len(torso), 2), np.nan)
        self._velocities = np.zeros((len(torso), 2))
        self._lost_s = np.full(len(torso), np.inf)

    def proposals(self, points: Array, predicted_m: Array, elapsed_s: float) -> list[tuple[float, IntArray]]:
        """Return costs and labels (N,) of the best assignment and its alternatives.

        Args:
            points: Undistorted normalised coordinates (N, 2) of the blobs.
            predicted_m: Markers (M, 3) of the last pose.
        """
        costs = self._costs(points, predicted_m, elapsed_s)
        best = _assign(costs)
        found = [best]
        for blob in np.flatnonzero(best[1] >= 0):
            marker = best[1][blob]
            if costs[blob, marker] <= _S.certain:
                continue
            others = costs.copy()
            others[blob, marker] = _S.unlikely
            alternative = _assign(others)
            if alternative[0] < best[0] + _S.alternative and not any(
                np.array_equal(alternative[1], labels) for _, labels in found
            ):
                found.append(alternative)
        return sorted(found, key=lambda pair: pair[0])

    def after(self, points: Array, labels: IntArray, elapsed_s: float) -> "SingleViewLabeller":
        """Return a copy of the labeller, updated with a frame of blobs at points (N, 2) with labels (N,)."""
        named = labels >= 0
        markers, seen = labels[named], points[named]
        since_s = self._lost_s[markers] + elapsed_s
        known = (since_s < _S.memory_s) & (since_s > 0.0)
        step = (seen - self._points[markers]) / np.where(known, since_s, 1.0)[:, None]
        result = copy(self)
        result._points, result._velocities = self._points.copy(), self._velocities.copy()
        result._lost_s = self._lost_s + elapsed_s
        result._points[markers], result._lost_s[markers] = seen, 0.0
        result._velocities[markers] = np.where(known[:, None], step, 0.0)
        return result

    def _costs(self, points: Array, predicted_m: Array, elapsed_s: float) -> Array:
        """Return the cost (N, M) of each blob for each marker."""
        local = self._camera.to_camera(predicted_m)
        depth = np.maximum(local[:, 2], _S.nearest_m)
        by_body = local[:, :2] / depth[:, None]
        since_s = self._lost_s + elapsed_s
        fresh = since_s < _S.memory_s
        moved_s = np.where(fresh, since_s, 0.0)
        by_image = np.where(fresh[:, None], self._points + self._velocities * moved_s[:, None], by_body)
        body_m = np.minimum(_S.body_m + _S.body_m_s * since_s, self._most_m)
        image_m = np.where(fresh, _S.image_m + 0.5 * _S.image_m_s2 * moved_s**2, np.inf)
        from_body = np.sum((points[:, None] - by_body) ** 2, axis=-1) * depth**2
        from_image = np.sum((points[:, None] - by_image) ** 2, axis=-1) * depth**2
        variance = 1.0 / (1.0 / image_m**2 + 1.0 / body_m**2)
        # the last term is the normalisation: a marker that may be anywhere has a low density everywhere
        costs = from_body / body_m**2 + from_image / image_m**2 + 2.0 * np.log(variance / _S.image_m**2)
        return np.asarray(np.minimum(costs, _S.unlikely))


def _assign(costs: Array) -> tuple[float, IntArray]:
    """Return the cheapest labels (N,), preceded by their cost."""
    rows, columns = assign(costs, _S.unlikely)
    labels = np.full(len(costs), -1, dtype=np.int64)
    labels[rows] = columns
    return float(costs[rows, columns].sum() + _S.unlikely * np.sum(labels < 0)), labels
