"""Labels of blobs of a single camera, frame after frame.

A marker that was just seen is where its movement in the image takes it; one that was hidden for a while is somewhere
about where the last synthesized pose has it, the less surely the longer. One assignment of all blobs to all markers
weighs how far a blob is from where a marker should be against how sure that is: else a marker that nobody has seen for
long, and that may be anywhere, takes the blobs of its neighbours.
"""

from copy import copy

import numpy as np

from ..geometry.arrays import Array, IntArray, Mask
from ..geometry.camera import Camera
from ..geometry.gated_assignment import assign

_MEMORY_S = 0.1  # a movement in the image older than this is of no use
# standard deviations across the ray at the marker's distance
_IMAGE_M = 0.006  # of a marker that moves on as it did
_IMAGE_M_S2 = 30.0  # and what it may accelerate
_BODY_M = 0.05  # of the pose's markers
_BODY_M_S = 0.5  # growth with the time that a marker has been hidden
_BODY_MOST_M, _TORSO_MOST_M = 0.20, 0.06
# costs are minus twice the logarithm of a likelihood
_UNLIKELY = 20.0  # above this a blob is not the marker's
_SURE = 4.0  # below this no other name is thought of
_ALTERNATIVE_COST = 12.0  # by which another assignment may be worse than the best and still be the right one
_NEAREST_M = 0.1  # to the camera


class SingleViewLabeller:
    """Labels the blobs of successive frames of one camera.

    Args:
        torso: (M,) which markers lie on the torso: where it is known, so are they, even when hidden for long.
    """

    def __init__(self, camera: Camera, torso: Mask) -> None:
        self._camera = camera
        self._most_m = np.where(torso, _TORSO_MOST_M, _BODY_MOST_M)
        self._points = np.full((len(torso), 2), np.nan)
        self._velocities = np.zeros((len(torso), 2))
        self._lost_s = np.full(len(torso), np.inf)

    def proposals(self, points: Array, predicted_m: Array, elapsed_s: float) -> list[tuple[float, IntArray]]:
        """Return cost and labels (N,), -1 for none, of the best assignment and its alternatives.

        Args:
            points: (N, 2) undistorted normalised coordinates of the blobs.
            predicted_m: (M, 3) markers of the last synthesized pose.
        """
        costs = self._costs(points, predicted_m, elapsed_s)
        best = _name_blobs(costs)
        found = [best]
        for blob in np.flatnonzero(best[1] >= 0):
            marker = best[1][blob]
            if costs[blob, marker] <= _SURE:
                continue
            others = costs.copy()
            others[blob, marker] = _UNLIKELY
            alternative = _name_blobs(others)
            if alternative[0] < best[0] + _ALTERNATIVE_COST and not any(
                np.array_equal(alternative[1], labels) for _, labels in found
            ):
                found.append(alternative)
        return sorted(found, key=lambda pair: pair[0])

    def after(self, points: Array, labels: IntArray, elapsed_s: float) -> "SingleViewLabeller":
        """Return the labeller after a frame of points (N, 2) with labels (N,)."""
        named = labels >= 0
        markers, seen = labels[named], points[named]
        since_s = self._lost_s[markers] + elapsed_s
        known = (since_s < _MEMORY_S) & (since_s > 0.0)
        step = (seen - self._points[markers]) / np.where(known, since_s, 1.0)[:, None]
        result = copy(self)
        result._points, result._velocities = self._points.copy(), self._velocities.copy()
        result._lost_s = self._lost_s + elapsed_s
        result._points[markers], result._lost_s[markers] = seen, 0.0
        result._velocities[markers] = np.where(known[:, None], step, 0.0)
        return result

    def _costs(self, points: Array, predicted_m: Array, elapsed_s: float) -> Array:
        """Return the costs (N, M) of each blob for each marker, at most `_UNLIKELY`."""
        local = self._camera.to_camera(predicted_m)
        depth = np.maximum(local[:, 2], _NEAREST_M)
        by_body = local[:, :2] / depth[:, None]
        since_s = self._lost_s + elapsed_s
        fresh = since_s < _MEMORY_S
        moved_s = np.where(fresh, since_s, 0.0)
        by_image = np.where(fresh[:, None], self._points + self._velocities * moved_s[:, None], by_body)
        body_m = np.minimum(_BODY_M + _BODY_M_S * since_s, self._most_m)
        image_m = np.where(fresh, _IMAGE_M + 0.5 * _IMAGE_M_S2 * moved_s**2, np.inf)
        from_body = np.sum((points[:, None] - by_body) ** 2, axis=-1) * depth**2
        from_image = np.sum((points[:, None] - by_image) ** 2, axis=-1) * depth**2
        variance = 1.0 / (1.0 / image_m**2 + 1.0 / body_m**2)
        # the density of a marker that may be anywhere is low everywhere
        costs = from_body / body_m**2 + from_image / image_m**2 + 2.0 * np.log(variance / _IMAGE_M**2)
        return np.asarray(np.minimum(costs, _UNLIKELY))


def _name_blobs(costs: Array) -> tuple[float, IntArray]:
    """Return the least cost of naming blobs, and the labels (N,)."""
    rows, columns = assign(costs, _UNLIKELY)
    labels = np.full(len(costs), -1, dtype=np.int64)
    labels[rows] = columns
    return float(costs[rows, columns].sum() + _UNLIKELY * np.sum(labels < 0)), labels
