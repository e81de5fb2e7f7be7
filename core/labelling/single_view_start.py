"""Labels of the blobs of a single camera at the start, from a known pose.

The performer stands in a calibration pose before the camera and the body is known, so that two blobs taken for two
markers give its distance. The best of all such placements is refined: blobs are assigned, the body is moved to meet
their rays, and so on. Labels afterwards follow from the pose of the frame before, as with more cameras.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray
from ..geometry.camera import Camera
from ..geometry.gated_assignment import assign
from ..geometry.least_squares import gauss_newton

_TURNS_DEG = (-60.0, -40.0, -20.0, 0.0, 20.0, 40.0, 60.0)  # from facing the camera
_PAIRS = 4  # of markers, the farthest apart, that two blobs are taken for
_NEAREST_M, _FARTHEST_M = 0.8, 10.0
_BENT = 0.25  # how far, of their distance, two blobs may lie across from the direction of their markers
_GATE_M = 0.25  # across the ray, at the marker's distance
_MISSED_M = 0.10  # what a marker costs that is not found, and at most one that is
_NARROWING = 0.8  # of the gate, down to that, from one round to the next: a hidden marker must not keep another's blob
_REFINED = 2  # placements of each pose and turn
_CLOSEST = 12  # of many poses at the body's place, that are refined
_ROUNDS = 10  # of assigning and moving
_TILT_SIGMA_RAD = 0.1  # of a person who stands upright
_SIGMA_M = 0.03  # of a marker in a pose that is never held exactly
_FEWEST_FOUND = 0.7  # share of the markers
_FARTHEST_RMS_M = 0.07


@dataclass(frozen=True)
class SingleViewStart:
    """Labels of blobs without a past.

    Args:
        labels: (N,) marker of each blob, -1 for none.
        markers_m: (M, 3) where the assumed pose has the markers in the world.
    """

    labels: IntArray
    markers_m: Array


def label_single_view(points: Array, camera: Camera, poses_m: Sequence[Array]) -> SingleViewStart | None:
    """Return labels of blobs of a performer in one of a few poses; None without a fit.

    Args:
        points: (N, 2) undistorted normalised coordinates of the blobs; some may be false, some missing.
        poses_m: markers (M, 3) of each pose, y up, facing +z.
    """
    count = len(poses_m[0])
    needed = int(np.ceil(_FEWEST_FOUND * count))
    if len(points) < needed:
        return None
    axis = -camera.rotation[2]  # from the performer to the camera
    facing = np.arctan2(axis[0], axis[2])
    rough: list[Array] = []
    for pose in poses_m:
        for turn in np.radians(_TURNS_DEG):
            turned = rot.rotate(rot.from_rotation_vector([0.0, facing + turn, 0.0]), pose)
            rough += _place_by_pairs(points, turned @ camera.rotation.T)
    best, least = None, np.inf
    for local in rough:
        cost, labels, refined = _refine(points, local, camera.rotation[:, 1])
        if cost < least:
            best, least = (labels, refined), cost
    if best is None or np.sum(best[0] >= 0) < needed:
        return None
    labels, local = best
    off = _ray_offsets(local[labels[labels >= 0]], points[labels >= 0])
    if np.sqrt(np.mean(off**2)) > _FARTHEST_RMS_M:
        return None
    return SingleViewStart(labels, (local - camera.translation_m) @ camera.rotation)


def label_near(points: Array, camera: Camera, expected_m: Array, count: int) -> list[SingleViewStart]:
    """Return labellings of a performer near example bodies, likeliest first.

    Args:
        points: (N, 2) undistorted normalised coordinates of the blobs.
        expected_m: (E, M, 3) markers of bodies in many poses, in the world.
    """
    local = camera.to_camera(expected_m.reshape(-1, 3)).reshape(expected_m.shape)
    depth = np.maximum(local[..., 2:], _NEAREST_M)
    seen = local[..., :2] / depth
    squares = np.sum((seen[:, :, None] - points) ** 2, axis=-1) * depth**2
    costs = np.minimum(squares.min(axis=1), _GATE_M**2).sum(axis=1)  # of the blobs: markers may be hidden
    found: list[tuple[float, SingleViewStart]] = []
    for body in local[np.argsort(costs)[:_CLOSEST]]:
        cost, labels, refined = _refine(points, body, camera.rotation[:, 1])
        if not any(np.array_equal(labels, other.labels) for _, other in found):
            found.append((cost, SingleViewStart(labels, (refined - camera.translation_m) @ camera.rotation)))
    return [start for _, start in sorted(found, key=lambda pair: pair[0])[:count]]


def _place_by_pairs(points: Array, body: Array) -> list[Array]:
    """Return likely bodies (M, 3) in the camera's frame from pairs of blobs."""
    spans = np.linalg.norm(body[:, None, :2] - body[None, :, :2], axis=-1)
    order = np.argsort(spans, axis=None)[::-1][: 2 * _PAIRS : 2]  # every pair stands there twice
    first, second = np.nonzero(~np.eye(len(points), dtype=bool))
    apart = points[first] - points[second]
    placements = []
    for a, b in zip(*np.unravel_index(order, spans.shape), strict=True):
        # x_a + t = u (z_a + s) for both; their difference gives s, the shift in depth
        wanted = body[a, :2] - body[b, :2] - points[first] * body[a, 2] + points[second] * body[b, 2]
        depth = np.einsum("pc,pc->p", apart, wanted) / np.einsum("pc,pc->p", apart, apart)
        bent = np.linalg.norm(wanted - depth[:, None] * apart, axis=1) > _BENT * spans[a, b]
        good = (depth > _NEAREST_M) & (depth < _FARTHEST_M) & ~bent
        depth, one, other = depth[good], points[first[good]], points[second[good]]
        across = one * (body[a, 2] + depth)[:, None] - body[a, :2]
        across += other * (body[b, 2] + depth)[:, None] - body[b, :2]
        placements.append(np.column_stack((0.5 * across, depth)))
    shifts = np.concatenate(placements)
    if len(shifts) == 0:
        return []
    local = body + shifts[:, None]
    seen = local[..., :2] / local[..., 2:]
    squares = np.sum((seen[:, :, None] - points) ** 2, axis=-1).min(axis=2) * local[..., 2] ** 2
    costs = np.minimum(squares, _GATE_M**2).sum(axis=1)
    return list(local[np.argsort(costs)[:_REFINED]])


def _refine(points: Array, local: Array, up: Array) -> tuple[float, IntArray, Array]:
    """Return cost, labels (N,) and body (M, 3) after alternating labels and moves."""
    labels = np.full(len(points), -1, dtype=np.int64)
    start, pose = local, np.zeros(6)
    cost = np.inf
    for turn in range(_ROUNDS):
        gate_m = max(_GATE_M * _NARROWING**turn, _MISSED_M)
        distances = np.linalg.norm(_ray_offsets(local[None], points[:, None]), axis=-1)
        rows, columns = assign(distances**2, gate_m**2)
        new = np.full(len(points), -1, dtype=np.int64)
        new[rows] = columns
        missed = len(local) - len(rows)
        off = np.minimum(distances[rows, columns], _MISSED_M)
        cost = float(np.sum(off**2)) + missed * _MISSED_M**2
        if (np.array_equal(new, labels) and gate_m == _MISSED_M) or len(rows) < 4:
            return cost, new, local
        labels = new
        local, pose = _fit_to_rays(points[rows], columns, start, pose, up)
    return cost, labels, local


def _fit_to_rays(points: Array, markers: IntArray, start: Array, pose: Array, up: Array) -> tuple[Array, Array]:
    """Fit the body to its markers' rays by Gauss-Newton; also return the step (6,).

    It turns about its middle; out of the upright (`up` in the camera's frame) only as far as a standing person does.
    """
    middle = start.mean(axis=0)
    sigma_tilt = (np.eye(3) - np.outer(up, up)) / _TILT_SIGMA_RAD

    def linearise(pose: Array) -> tuple[Array, Array]:
        turned = rot.rotate(rot.from_rotation_vector(pose[:3]), start - middle)
        residual = _ray_offsets((turned + middle + pose[3:])[markers], points)
        rows = np.zeros((len(points), 2, 3))
        rows[:, 0, 0] = rows[:, 1, 1] = 1.0
        rows[:, :, 2] = -points
        # d (w x r) / d w = -[r]x
        cross = np.zeros((len(points), 3, 3))
        x, y, z = turned[markers].T
        cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 0] = z, -y, -z
        cross[:, 1, 2], cross[:, 2, 0], cross[:, 2, 1] = x, y, -x
        jacobian = np.concatenate((rows @ cross, rows), axis=2).reshape(-1, 6) / _SIGMA_M
        prior = np.hstack((sigma_tilt, np.zeros((3, 3))))
        rows = np.concatenate((residual.ravel() / _SIGMA_M, sigma_tilt @ pose[:3]))
        return rows, np.vstack((jacobian, prior))

    pose, _, _ = gauss_newton(pose, linearise, 4)
    local = rot.rotate(rot.from_rotation_vector(pose[:3]), start - middle) + middle + pose[3:]
    return local, pose


def _ray_offsets(local: Array, points: Array) -> Array:
    """Return distances (..., 2) of local points across rays, metres at their depth."""
    return np.asarray(local[..., :2] - points * local[..., 2:])
