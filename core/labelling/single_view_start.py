"""Initial labelling of the blobs of a single camera, from a known pose.

The performer stands in a calibration pose in front of the camera and the body is known, so two blobs assigned to two
markers determine the body's distance. The best of all such placements are refined by alternately assigning the blobs
and fitting the body to their rays. Later frames are labelled by the last pose, as with several cameras.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray
from ..geometry.camera import Camera
from ..geometry.gated_assignment import assign
from ..geometry.least_squares import gauss_newton


@dataclass(frozen=True)
class SingleViewStartSettings:
    """Settings of `label_single_view` and `label_near`; distances are measured across the ray at the marker's depth."""

    turns_deg: tuple[float, ...] = (-60.0, -40.0, -20.0, 0.0, 20.0, 40.0, 60.0)  # headings, 0: towards the camera
    pairs: int = 4  # number of marker pairs, the farthest apart, to which two blobs are assigned
    nearest_m: float = 0.8  # smallest and largest distance of the performer from the camera
    farthest_m: float = 10.0
    bent: float = 0.25  # largest deviation of two blobs from their markers' direction, as a share of the distance
    gate_m: float = 0.25  # largest distance of a blob from its marker in the first round
    # factor by which the gate shrinks per round, down to `missed_m`, so that hidden markers lose the blobs of others
    narrowing: float = 0.8
    missed_m: float = 0.10  # distance assumed for a marker without a blob
    refined: int = 2  # number of placements of each pose and heading that are refined
    closest: int = 12  # number of nearest examples that are refined
    rounds: int = 10  # largest number of assignments in one refinement
    tilt_sigma_rad: float = 0.1  # standard deviation of the lean of a standing person
    sigma_m: float = 0.03  # standard deviation of markers from their positions in the pose, which no one holds exactly
    fewest_found: float = 0.7  # share of the markers that must be found
    farthest_rms_m: float = 0.07  # largest RMS distance of the markers found from their rays


_S = SingleViewStartSettings()


@dataclass(frozen=True)
class SingleViewStart:
    """Labels of N blobs, found without history."""

    labels: IntArray  # marker of each blob, -1 for none
    markers_m: Array  # (M, 3) markers of the assumed pose in the world


def label_single_view(points: Array, camera: Camera, poses_m: Sequence[Array]) -> SingleViewStart | None:
    """Return labels of the blobs of a performer in one of several poses; None if none fits.

    Args:
        points: Undistorted normalised coordinates (N, 2) of the blobs; some may be false or missing.
        poses_m: Markers (M, 3) of each pose, y up, facing +z.
    """
    count = len(poses_m[0])
    needed = int(np.ceil(_S.fewest_found * count))
    if len(points) < needed:
        return None
    axis = -camera.rotation[2]  # from the performer to the camera
    facing = np.arctan2(axis[0], axis[2])
    rough: list[Array] = []
    for pose in poses_m:
        for turn in np.radians(_S.turns_deg):
            turned = rot.rotate(rot.from_rotation_vector([0.0, facing + turn, 0.0]), pose)
            rough += _place_by_pairs(points, turned @ camera.rotation.T)
    if not rough:
        return None
    refined = (_refine(points, local, camera.rotation[:, 1]) for local in rough)
    _, labels, local = min(refined, key=lambda result: result[0])
    if np.sum(labels >= 0) < needed:
        return None
    off = _ray_offsets(local[labels[labels >= 0]], points[labels >= 0])
    if np.sqrt(np.mean(off**2)) > _S.farthest_rms_m:
        return None
    return SingleViewStart(labels, (local - camera.translation_m) @ camera.rotation)


def label_near(points: Array, camera: Camera, expected_m: Array, count: int) -> list[SingleViewStart]:
    """Return labels of a performer near example bodies, likeliest first.

    Args:
        points: Undistorted normalised coordinates (N, 2) of the blobs.
        expected_m: Markers (E, M, 3) of bodies in many poses, in the world.
        count: Number of results.
    """
    local = camera.to_camera(expected_m.reshape(-1, 3)).reshape(expected_m.shape)
    depth = np.maximum(local[..., 2:], _S.nearest_m)
    seen = local[..., :2] / depth
    squares = np.sum((seen[:, :, None] - points) ** 2, axis=-1) * depth**2
    costs = np.minimum(squares.min(axis=1), _S.gate_m**2).sum(axis=1)  # sums over blobs, because markers may be hidden
    found: list[tuple[float, SingleViewStart]] = []
    for body in local[np.argsort(costs)[: _S.closest]]:
        cost, labels, refined = _refine(points, body, camera.rotation[:, 1])
        if not any(np.array_equal(labels, other.labels) for _, other in found):
            found.append((cost, SingleViewStart(labels, (refined - camera.translation_m) @ camera.rotation)))
    return [start for _, start in sorted(found, key=lambda pair: pair[0])[:count]]


def _place_by_pairs(points: Array, body: Array) -> list[Array]:
    """Return likely bodies (M, 3) in the camera's frame, placed by pairs of blobs."""
    spans = np.linalg.norm(body[:, None, :2] - body[None, :, :2], axis=-1)
    order = np.argsort(spans, axis=None)[::-1][: 2 * _S.pairs : 2]  # each pair occurs twice
    first, second = np.nonzero(~np.eye(len(points), dtype=bool))
    apart = points[first] - points[second]
    placements = []
    for a, b in zip(*np.unravel_index(order, spans.shape), strict=True):
        # x_a + t = u (z_a + s) for both; their difference determines s, the shift in depth
        wanted = body[a, :2] - body[b, :2] - points[first] * body[a, 2] + points[second] * body[b, 2]
        depth = np.einsum("pc,pc->p", apart, wanted) / np.einsum("pc,pc->p", apart, apart)
        bent = np.linalg.norm(wanted - depth[:, None] * apart, axis=1) > _S.bent * spans[a, b]
        good = (depth > _S.nearest_m) & (depth < _S.farthest_m) & ~bent
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
    costs = np.minimum(squares, _S.gate_m**2).sum(axis=1)
    return list(local[np.argsort(costs)[: _S.refined]])


def _refine(points: Array, local: Array, up: Array) -> tuple[float, IntArray, Array]:
    """Return cost, labels (N,) and body (M, 3) after alternating assignment and fit."""
    labels = np.full(len(points), -1, dtype=np.int64)
    start, pose = local, np.zeros(6)
    cost = np.inf
    for turn in range(_S.rounds):
        gate_m = max(_S.gate_m * _S.narrowing**turn, _S.missed_m)
        distances = np.linalg.norm(_ray_offsets(local[None], points[:, None]), axis=-1)
        rows, columns = assign(distances**2, gate_m**2)
        new = np.full(len(points), -1, dtype=np.int64)
        new[rows] = columns
        missed = len(local) - len(rows)
        off = np.minimum(distances[rows, columns], _S.missed_m)
        cost = float(np.sum(off**2)) + missed * _S.missed_m**2
        if (np.array_equal(new, labels) and gate_m == _S.missed_m) or len(rows) < 4:
            return cost, new, local
        labels = new
        local, pose = _fit_to_rays(points[rows], columns, start, pose, up)
    return cost, labels, local


def _fit_to_rays(points: Array, markers: IntArray, start: Array, pose: Array, up: Array) -> tuple[Array, Array]:
    """Fit the body to its markers' rays by Gauss-Newton; return it and its movement from `start` (turn, shift).

    The body turns about its centre. A prior keeps it upright (`up` in the camera's frame).
    """
    middle = start.mean(axis=0)
    sigma_tilt = (np.eye(3) - np.outer(up, up)) / _S.tilt_sigma_rad

    def linearise(pose: Array) -> tuple[Array, Array]:
        turned = rot.rotate(rot.from_rotation_vector(pose[:3]), start - middle)
        residual = _ray_offsets((turned + middle + pose[3:])[markers], points)
        rows = np.zeros((len(points), 2, 3))
        rows[:, 0, 0] = rows[:, 1, 1] = 1.0
        rows[:, :, 2] = -points
        # d (w x r) / d w = -[r]x
        cross = -rot.cross_matrices(turned[markers])
        jacobian = np.concatenate((rows @ cross, rows), axis=2).reshape(-1, 6) / _S.sigma_m
        prior = np.hstack((sigma_tilt, np.zeros((3, 3))))
        rows = np.concatenate((residual.ravel() / _S.sigma_m, sigma_tilt @ pose[:3]))
        return rows, np.vstack((jacobian, prior))

    pose, _, _ = gauss_newton(pose, linearise, 4)
    local = rot.rotate(rot.from_rotation_vector(pose[:3]), start - middle) + middle + pose[3:]
    return local, pose


def _ray_offsets(local: Array, points: Array) -> Array:
    """Return offsets (..., 2) of positions in the camera's frame from rays, metres across the ray at their depth."""
    return np.asarray(local[..., :2] - points * local[..., 2:])
