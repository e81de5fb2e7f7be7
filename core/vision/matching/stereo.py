"""Stereo matching by epipolar line, colour, size and predicted markers.

Chai and Hodgins 2005 use the epipolar line and colour, then temporal coherence if several candidates remain; here all
of these form the cost of one assignment problem.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry.arrays import Array, FloatArray, IntArray
from ...geometry.camera import Camera, CameraRig, undistort_all
from ...geometry.gated_assignment import assign
from ...geometry.rotations import lengths
from ...geometry.triangulation import depths, inverse_3x3, triangulate
from .matching_settings import MATCHING

Located = tuple[Array, Array, Array]


@dataclass(frozen=True)
class Matches:
    """Triangulated points (N, 3) with covariances, their blobs' indices (N, C) or -1, and errors (N, C) in pixels."""

    points_m: Array
    covariances_m2: Array
    blobs: IntArray
    errors_px: Array


class StereoMatcher:
    """Matcher for the blobs of a rig's cameras."""

    def __init__(self, rig: CameraRig, epipolar_px: float = MATCHING.epipolar_px) -> None:
        self.rig = rig
        self._epipolar_px = epipolar_px
        self._essential = {
            (a, b): essential_matrix(rig.cameras[a], rig.cameras[b]) for b in range(len(rig)) for a in range(b)
        }

    def undistort(self, blobs: Sequence[FloatArray]) -> list[Array]:
        """Return the blobs' undistorted normalised coordinates (n, 2), per camera."""
        return undistort_all(self.rig.cameras, [rows[:, :2].astype(np.float64) for rows in blobs])

    def match(self, blobs: Sequence[FloatArray], normalised: Sequence[Array], predicted_m: Array | None) -> Matches:
        """Match the brightest blobs of all cameras.

        Args:
            blobs: Blobs (n, 5) of each camera.
            normalised: Their coordinates (n, 2) from `undistort`.
            predicted_m: Expected markers (P, 3); None if nothing is known.
        """
        cameras = len(self.rig)
        located = self._locate(np.empty((0, cameras), dtype=np.int64), normalised)
        table = np.empty((0, cameras), dtype=np.int64)
        for camera in range(1, cameras):
            table = self._attach(camera, normalised, located[0], table)
            for other in range(camera):
                free = [_brightest(unused_blobs(table, of, len(blobs[of])), blobs[of]) for of in (other, camera)]
                pairs, located = self._pairs(other, camera, free, blobs, normalised, predicted_m)
                rows = np.full((len(pairs), cameras), -1, dtype=np.int64)
                rows[:, other], rows[:, camera] = pairs[:, 0], pairs[:, 1]
                table = np.concatenate((table, rows))
            if camera > 1:
                located = self._locate(table, normalised)
        return Matches(located[0], located[1], table, located[2])

    def _locate(self, table: IntArray, normalised: Sequence[Array]) -> Located:
        if len(table) == 0:
            return np.empty((0, 3)), np.empty((0, 3, 3)), np.empty((0, len(self.rig)))
        observed = np.zeros((*table.shape, 2))
        for camera, coordinates in enumerate(normalised):
            seen = table[:, camera] >= 0
            observed[seen, camera] = coordinates[table[seen, camera]]
        return triangulate(self.rig.cameras, observed, (table >= 0).astype(float), MATCHING.pixel_sigma)

    def _attach(self, camera: int, normalised: Sequence[Array], points: Array, table: IntArray) -> IntArray:
        """Add another camera's blobs to known points."""
        if len(points) == 0 or len(normalised[camera]) == 0:
            return table
        view = self.rig.cameras[camera]
        local = view.to_camera(points)
        distance = lengths((local[:, :2] / local[:, 2:])[:, None] - normalised[camera]) * view.focal_px
        rows, columns = assign(np.where(local[:, 2:] > 0.0, distance, np.inf), self._epipolar_px)
        table = table.copy()
        table[rows, camera] = columns
        return table

    def _pairs(
        self,
        a: int,
        b: int,
        free: Sequence[IntArray],
        blobs: Sequence[FloatArray],
        normalised: Sequence[Array],
        predicted_m: Array | None,
    ) -> tuple[IntArray, Located]:
        """Return matched blobs (n, 2) of two cameras' free blobs, and their triangulation."""
        none = np.empty((0, 2), dtype=np.int64), (np.empty((0, 3)), np.empty((0, 3, 3)), np.empty((0, 2)))
        if min(map(len, free)) == 0:
            return none
        views = self.rig.cameras[a], self.rig.cameras[b]
        x, y = normalised[a][free[0]], normalised[b][free[1]]
        line = epipolar_distances(self._essential[a, b], 0.5 * (views[0].focal_px + views[1].focal_px), x, y)
        rows, columns = np.nonzero(line <= self._epipolar_px)
        if len(rows) == 0:
            return none
        both = np.stack((x[rows], y[columns]), axis=1)
        points, covariances, errors = triangulate(views, both, np.ones((len(rows), 2)), MATCHING.pixel_sigma)
        depth, other_depth = (depths(view, points) for view in views)
        possible = np.minimum(depth, other_depth) >= MATCHING.nearest_m
        possible &= np.maximum(depth, other_depth) <= MATCHING.farthest_m
        if not possible.all():
            rows, columns, depth = rows[possible], columns[possible], depth[possible]
            points, covariances, errors = points[possible], covariances[possible], errors[possible]
        unlike = _dissimilarity(blobs[a][free[0]], blobs[b][free[1]], rows, columns)
        base = (line[rows, columns] / (self._epipolar_px / MATCHING.epipolar_sigmas)) ** 2 + unlike
        if predicted_m is not None and len(predicted_m):
            nearest = self._coherence(points, covariances, predicted_m)
            base = base + np.minimum(nearest, MATCHING.most_coherence)
        candidates = np.full(line.shape, -1, dtype=np.int64)
        candidates[rows, columns] = np.arange(len(rows))
        chosen = _choose(base, rows, columns, candidates)
        # choose again, now that the first result shows the performer's depth
        if len(chosen) >= 3:
            middle = float(_medians(depth[chosen]))
            cost = base + np.minimum(((depth - middle) / MATCHING.spread_m) ** 2, MATCHING.most_coherence)
            chosen = _choose(cost, rows, columns, candidates)
        pairs = np.stack((free[0][rows[chosen]], free[1][columns[chosen]]), axis=1)
        return pairs, (points[chosen], covariances[chosen], errors[chosen])

    def _coherence(self, points: Array, covariances: Array, predicted_m: Array) -> Array:
        """Return squared distances (n,), in sigmas, to the nearest predicted point."""
        information = inverse_3x3(covariances + MATCHING.coherence_m**2 * np.eye(3))
        apart = points[:, None] - predicted_m[None]
        return np.asarray(np.einsum("npi,npi->np", apart @ information, apart).min(axis=1))


def _choose(cost: Array, rows: IntArray, columns: IntArray, candidates: IntArray) -> IntArray:
    """Return the candidates of the cheapest assignment.

    Args:
        cost, rows, columns: Cost and blobs (K,) of each candidate.
        candidates: Index (n, m) of each pair's candidate, -1 where there is none.
    """
    table = np.full(candidates.shape, np.inf)
    table[rows, columns] = cost
    return np.sort(candidates[assign(table, MATCHING.no_match)])


def unused_blobs(table: IntArray, camera: int, count: int) -> IntArray:
    """Return a camera's blobs that no row of the table (N, C) contains."""
    free = np.ones(count + 1, dtype=bool)
    free[table[:, camera]] = False  # -1 addresses the last entry, which is not a blob
    return free[:count].nonzero()[0]


def _brightest(free: IntArray, blobs: FloatArray) -> IntArray:
    """Return the brightest of these blobs, in the same order."""
    if len(free) <= MATCHING.most_blobs:
        return free
    return np.sort(free[np.argsort(-blobs[free, 3], kind="stable")[: MATCHING.most_blobs]])


def epipolar_distances(essential: Array, focal_px: float, x: Array, y: Array) -> Array:
    """Return Sampson distances (n, m) in pixels of normalised points (n, 2), (m, 2).

    Hartley and Zisserman, Multiple View Geometry, 11.4.3: first-order distance to the nearest pair that meets in 3D.

    Args:
        focal_px: Mean focal length of the cameras.
    """
    xh, yh = homogeneous(x), homogeneous(y)
    lines_b, lines_a = xh @ essential.T, yh @ essential
    value = lines_b @ yh.T
    slope_b, slope_a = (np.einsum("ni,ni->n", lines[:, :2], lines[:, :2]) for lines in (lines_b, lines_a))
    slope = slope_b[:, None] + slope_a
    return np.asarray(np.abs(value) / np.sqrt(np.maximum(slope, 1e-30)) * focal_px)


def essential_matrix(a: Camera, b: Camera) -> Array:
    """Return E (3, 3) with y' E x = 0 for normalised x in camera a, y in camera b."""
    rotation = b.rotation @ a.rotation.T
    t = b.translation_m - rotation @ a.translation_m
    cross = np.array([[0.0, -t[2], t[1]], [t[2], 0.0, -t[0]], [-t[1], t[0], 0.0]])
    return np.asarray(cross @ rotation)


def homogeneous(points: Array) -> Array:
    """Return points (..., 2) with a third coordinate of one."""
    result = np.ones((*points.shape[:-1], 3))
    result[..., :2] = points
    return result


def _dissimilarity(a: FloatArray, b: FloatArray, rows: IntArray, columns: IntArray) -> Array:
    """Return squared dissimilarities (K,) of two cameras' blobs, each measured relative to its camera's median."""
    apart = _unlike_usual(a)[rows] - _unlike_usual(b)[columns]
    sizes, brightnesses = apart[:, 0] / MATCHING.size_sigma, apart[:, 1] / MATCHING.brightness_sigma
    hue = np.minimum(np.abs((apart[:, 2] + 90.0) % 180.0 - 90.0), 2.0 * MATCHING.hue_sigma) / MATCHING.hue_sigma
    return np.asarray(np.minimum(sizes**2, 4.0) + np.minimum(brightnesses**2, 4.0) + 0.25 * hue**2)


def _unlike_usual(blobs: FloatArray) -> Array:
    """Return log size, log brightness and hue (n, 3), minus their medians."""
    features = np.empty((len(blobs), 3))
    features[:, 0], features[:, 1], features[:, 2] = blobs[:, 2], blobs[:, 3] + 5.0, blobs[:, 4]
    features[:, :2] = np.log(np.maximum(features[:, :2], 1e-3))
    return features - _medians(features)


def _medians(values: Array) -> Array:
    """Return the medians of the columns; for few values, ten times as fast as `np.median`."""
    ordered = np.sort(values, axis=0)
    return np.asarray(0.5 * (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]))
