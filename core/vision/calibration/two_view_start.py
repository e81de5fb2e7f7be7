"""Rough poses of cameras from points that they saw at the same moments, without knowing the points.

Two cameras are placed by the essential matrix (Nister 2004), the others by the points that these two locate.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import cv2
import numpy as np

from ...geometry.arrays import Array, evenly
from ...geometry.camera import Camera
from ...geometry.triangulation import triangulate


@dataclass(frozen=True)
class StartSettings:
    """Settings of `place_cameras`."""

    most_points: int = 2000  # largest number of points that place two cameras
    fewest_points: int = 30  # fewest points that place a camera
    confidence: float = 0.999  # probability that one sample at least is free of outliers
    tries: int = 500  # largest number of samples


_S = StartSettings()


@dataclass(frozen=True)
class TwoViews:
    """Second-from-first pose of two cameras, one unit apart, and how many points agree with it."""

    rotation: Array
    translation: Array
    used: int  # points that were compared
    agreeing: int
    angle_rad: float  # median angle between the two rays of a point


def place_two(first: Array, second: Array, gate: float, most: int = _S.most_points) -> TwoViews | None:
    """Return the pose on which most points agree, None if there are too few points.

    Args:
        first, second: Undistorted normalised coordinates (N, 2) of the same points, NaN where not seen.
        gate: Largest distance of a point from its epipolar line, normalised.
        most: Largest number of points that are used.
    """
    both = np.flatnonzero(np.isfinite(first[:, 0]) & np.isfinite(second[:, 0]))
    if len(both) < _S.fewest_points:
        return None
    both = both[evenly(len(both), most)]
    a, b = first[both], second[both]
    cv2.setRNGSeed(0)
    essential, inliers = cv2.findEssentialMat(
        a, b, np.eye(3), method=cv2.RANSAC, prob=_S.confidence, threshold=gate, maxIters=_S.tries
    )
    if essential is None or essential.shape != (3, 3):
        return None
    agreeing, rotation, translation, kept = cv2.recoverPose(essential, a, b, np.eye(3), mask=inliers.copy())
    inside = np.ravel(kept) > 0
    rays_a, rays_b = (np.column_stack((each[inside], np.ones(inside.sum()))) for each in (a, b))
    rays_b = rays_b @ rotation
    cosines = np.sum(rays_a * rays_b, axis=1) / np.linalg.norm(rays_a, axis=1) / np.linalg.norm(rays_b, axis=1)
    angle = float(np.arccos(np.clip(np.median(cosines), -1.0, 1.0))) if inside.any() else 0.0
    return TwoViews(np.asarray(rotation), np.ravel(translation), len(both), int(agreeing), angle)


def place_cameras(cameras: Sequence[Camera], points: Array, gate: float) -> list[Camera] | int:
    """Return the cameras with their poses, the first at the origin, in units of the distance of the best pair.

    Args:
        cameras: Cameras with lenses; their poses are not used.
        points: Undistorted normalised coordinates (N, C, 2) of the same points, NaN where not seen.
        gate: Largest distance of a point from its epipolar line, normalised.

    Returns:
        The cameras; or the index of one that cannot be placed.
    """
    pairs = {(i, j): place_two(points[:, i], points[:, j], gate) for i, j in combinations(range(len(cameras)), 2)}
    known = {pair: found for pair, found in pairs.items() if found is not None}
    if not known:
        return len(cameras) - 1
    i, j = max(known, key=lambda pair: known[pair].agreeing * np.sin(known[pair].angle_rad))
    placed = {
        i: replace(cameras[i], rotation=np.eye(3), translation_m=np.zeros(3)),
        j: replace(cameras[j], rotation=known[i, j].rotation, translation_m=known[i, j].translation),
    }
    while len(placed) < len(cameras):
        lacking = [c for c in range(len(cameras)) if c not in placed]
        counts = {c: int(_located(placed, points, c)[1].sum()) for c in lacking}
        index = max(counts, key=lambda c: counts[c])
        found = _resect(cameras[index], placed, points, index, gate)
        if found is None:
            return index
        placed[index] = found
    first = placed[0]
    return [
        replace(
            camera,
            rotation=camera.rotation @ first.rotation.T,
            translation_m=camera.translation_m - camera.rotation @ first.rotation.T @ first.translation_m,
        )
        for camera in (placed[c] for c in range(len(cameras)))
    ]


def _located(placed: dict[int, Camera], points: Array, index: int) -> tuple[Array, Array]:
    """Return weights (N, P) of the placed cameras, and which points (N,) they locate and camera `index` sees."""
    weights = np.isfinite(points[:, list(placed), 0]).astype(np.float64)
    return weights, (weights.sum(axis=1) >= 2) & np.isfinite(points[:, index, 0])


def _resect(camera: Camera, placed: dict[int, Camera], points: Array, index: int, gate: float) -> Camera | None:
    weights, usable = _located(placed, points, index)
    rows = np.flatnonzero(usable)
    if len(rows) < _S.fewest_points:
        return None
    rows = rows[evenly(len(rows), _S.most_points)]
    located, _, _ = triangulate(list(placed.values()), points[rows][:, list(placed)], weights[rows], 1.0)
    cv2.setRNGSeed(0)
    found, turn, shift, _ = cv2.solvePnPRansac(
        located, points[rows, index], np.eye(3), np.zeros(5), iterationsCount=_S.tries, reprojectionError=gate,
        confidence=_S.confidence, flags=cv2.SOLVEPNP_SQPNP,
    )  # fmt: skip
    if not found:
        return None
    return replace(camera, rotation=np.asarray(cv2.Rodrigues(turn)[0]), translation_m=np.ravel(shift))
