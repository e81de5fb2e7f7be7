"""Bundle adjustment of cameras with the moving points that they see, without a board (Triggs et al., 2000).

Unknown are the cameras' poses, delays and, unless they are given, focal lengths and one distortion term, and the points
at each moment. Pairs of points on one bone keep their distance: two cameras that look at the same place do not
determine their focal lengths otherwise (Sturm 2001). Points may be wrong, so all errors have heavy tails (Cauchy's
loss).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...geometry import rotations as rot
from ...geometry.arrays import Array, IntArray, Mask
from ...geometry.camera import Camera
from ...geometry.least_squares import NormalEquations, levenberg_marquardt

PER_CAMERA = 9
"""Rotation (3), translation (3), logarithm of the focal length, k1 and delay of one camera, in this order."""


@dataclass(frozen=True)
class BundleSettings:
    """Settings of the adjustment."""

    focal_sigma: float = 0.2  # prior standard deviation of the logarithm of a focal length that is not given
    radial_sigma: float = 0.1  # prior standard deviation of k1
    delay_sigma_s: float = 0.015  # prior standard deviation of a camera's delay: unsynchronised cameras, half a frame
    tail: float = 2.0  # error, in standard deviations, from which Cauchy's loss bends
    block_s: float = 1.0  # errors are uncorrelated over longer times
    scale_sigma: float = 1e-3  # fixes the scale, which nothing else determines


_S = BundleSettings()


@dataclass(frozen=True)
class Sightings:
    """Points that cameras saw at the same moments.

    Args:
        times_s: Times (F,), increasing.
        pixels: Points (F, C, K, 2), NaN where a camera does not see a point.
        velocities_px_s: Their velocities (F, C, K, 2), finite.
        sigmas_px: Standard deviations (F, C, K) along each axis of the image.
        bones: Pairs (B, 2) of points that keep their distance.
        bone_sigma_m: Standard deviation of that distance.
        share: Information in a moment, relative to one whose errors are independent of the others'.
    """

    times_s: Array
    pixels: Array
    velocities_px_s: Array
    sigmas_px: Array
    bones: IntArray
    bone_sigma_m: float
    share: float

    @cached_property
    def seen(self) -> Mask:
        """Mask (F, C, K) of the points that are seen, if by two cameras at least."""
        seen = np.isfinite(self.pixels[..., 0])
        return np.asarray(seen & (seen.sum(axis=1, keepdims=True) >= 2))


@dataclass(frozen=True)
class PointBundle:
    """Unknowns of the adjustment.

    Args:
        usual: Cameras with the most probable lenses.
        cameras: Cameras in the frame of the first.
        is_free: Whether a camera's lens (C,) is adjusted.
        apart_m: Distance between the first two cameras, which fixes the scale.
        delays_s: Delays (C,) relative to the first camera.
        bones_m: Lengths (B,).
        points_m: Points (F, K, 3).
    """

    sightings: Sightings
    usual: tuple[Camera, ...]
    cameras: tuple[Camera, ...]
    is_free: Mask
    delays_s: Array
    bones_m: Array
    points_m: Array
    apart_m: float = 1.0

    @cached_property
    def near(self) -> "_Linearised":
        """Normal equations here."""
        return _linearise(self)

    @property
    def unknowns(self) -> IntArray:
        """Indices of the parameters that are adjusted, of those of all cameras and bones."""
        free = np.ones((len(self.cameras), PER_CAMERA), dtype=bool)
        free[:, 6:8] = self.is_free[:, None]
        free[0, :6] = free[0, 8] = False
        return np.flatnonzero(np.concatenate((free.ravel(), np.ones(len(self.bones_m), dtype=bool))))

    def moved(self, step: Array) -> "PointBundle":
        """Return the bundle with the adjusted parameters changed, and the points at their best for that."""
        near, count = self.near, len(self.cameras)
        whole = np.zeros(count * PER_CAMERA + len(self.bones_m))
        whole[self.unknowns] = step
        by_camera = whole[: count * PER_CAMERA].reshape(count, PER_CAMERA)
        points = self.points_m - (near.points + near.by_parameter @ step).reshape(self.points_m.shape)
        return replace(
            self,
            cameras=tuple(moved_camera(camera, row) for camera, row in zip(self.cameras, by_camera, strict=True)),
            delays_s=self.delays_s + by_camera[:, 8],
            bones_m=self.bones_m + whole[count * PER_CAMERA :],
            points_m=points,
        )

    def covariance(self) -> Array:
        """Return the covariance of the parameters of all cameras and bones.

        Errors last, and points share them: the covariance is scaled by how much farther stretches of a second pull the
        cameras apart than independent errors with the assumed standard deviations would, if they do.
        """
        near, unknowns = self.near, self.unknowns
        inverse = np.linalg.pinv(near.reduced.matrix, rcond=1e-12, hermitian=True)
        blocks = np.floor((self.sightings.times_s - self.sightings.times_s[0]) / _S.block_s).astype(np.int64)
        pulls = np.zeros((blocks[-1] + 1, len(unknowns)))
        np.add.at(pulls, blocks, near.gradients)
        of_cameras = unknowns < PER_CAMERA * len(self.cameras)
        moves = (pulls @ inverse)[:, of_cameras]
        alone = np.linalg.pinv(inverse[np.ix_(of_cameras, of_cameras)], hermitian=True)
        factor = float(np.einsum("bi,ij,bj->", moves, alone, moves)) / np.count_nonzero(of_cameras)
        result = np.zeros((PER_CAMERA * len(self.cameras) + len(self.bones_m),) * 2)
        result[np.ix_(unknowns, unknowns)] = max(factor, 1.0) * inverse
        return result


@dataclass(frozen=True)
class _Linearised:
    """Normal equations without the points; a step s of the parameters moves these by -(points + by_parameter s)."""

    reduced: NormalEquations
    gradients: Array  # (F, P) by moment, without priors
    points: Array  # (F, 3 K)
    by_parameter: Array  # (F, 3 K, P)


def adjust_points(start: PointBundle, steps: int = 30) -> PointBundle:
    """Return the bundle with the lowest cost, by Levenberg-Marquardt on the parameters without the points."""
    return levenberg_marquardt(
        start, lambda bundle: bundle.near.reduced, lambda bundle, step: bundle.moved(step), steps=steps, least_gain=1e-5
    )[0]


def reprojection_errors(bundle: PointBundle) -> Array:
    """Return the errors (F, C, K, 2), pixels, NaN where a point is not seen."""
    errors = np.full(bundle.sightings.pixels.shape, np.nan)
    for index, camera in enumerate(bundle.cameras):
        seen = bundle.sightings.seen[:, index]
        errors[:, index][seen] = _observed(bundle, index)[seen] - camera.project(bundle.points_m[seen])
    return errors


def moved_camera(camera: Camera, step: Array) -> Camera:
    """Return a camera with its parameters (9,) changed."""
    turn = rot.to_matrix(rot.from_rotation_vector(step[:3]))
    matrix, distortion = camera.matrix.copy(), camera.distortion.copy()
    matrix[:2, :2] *= np.exp(np.clip(step[6], -0.5, 0.5))
    distortion[0] += step[7]
    rotation, translation = turn @ camera.rotation, turn @ camera.translation_m + step[3:6]
    return replace(camera, matrix=matrix, distortion=distortion, rotation=rotation, translation_m=translation)


def _observed(bundle: PointBundle, camera: int) -> Array:
    """Return where a camera without delay would have seen the points (F, K, 2)."""
    seen = bundle.sightings
    return np.asarray(seen.pixels[:, camera] - bundle.delays_s[camera] * seen.velocities_px_s[:, camera])


def _linearise(bundle: PointBundle) -> _Linearised:
    frames, count = bundle.points_m.shape[:2]
    lens, bones = PER_CAMERA * len(bundle.cameras), len(bundle.bones_m)
    unknowns = bundle.unknowns
    matrix, gradient, cost = _priors(bundle)
    own = np.zeros((frames, count, 3, count, 3))
    cross = np.zeros((frames, count, 3, lens + bones))
    by_points, gradients = np.zeros((frames, count, 3)), np.zeros((frames, lens + bones))
    diagonal = np.arange(count)
    for index in range(len(bundle.cameras)):
        errors, to_points, to_camera, loss = _camera_rows(bundle, index)
        own[:, diagonal, :, diagonal] += (to_points.swapaxes(2, 3) @ to_points).swapaxes(0, 1)
        columns = slice(index * PER_CAMERA, (index + 1) * PER_CAMERA)
        cross[..., columns] += to_points.swapaxes(2, 3) @ to_camera
        by_points += np.einsum("fkia,fki->fka", to_points, errors)
        gradients[:, columns] += np.einsum("fkip,fki->fp", to_camera, errors)
        rows = to_camera.reshape(-1, PER_CAMERA)
        matrix[columns, columns] += rows.T @ rows
        cost += loss
    for bone, (i, j) in enumerate(bundle.sightings.bones.tolist()):
        errors, along, weight, loss = _bone_rows(bundle, bone)
        outer = along[:, :, None] * along[:, None, :]
        for a, b, sign in ((i, i, 1.0), (j, j, 1.0), (i, j, -1.0), (j, i, -1.0)):
            own[:, a, :, b] += sign * outer
        cross[:, i, :, lens + bone] -= along * weight[:, None]
        cross[:, j, :, lens + bone] += along * weight[:, None]
        by_points[:, i] += along * errors[:, None]
        by_points[:, j] -= along * errors[:, None]
        gradients[:, lens + bone] -= weight * errors
        matrix[lens + bone, lens + bone] += float(weight @ weight)
        cost += loss
    blocks = own.reshape(frames, 3 * count, 3 * count)
    flat = np.arange(3 * count)
    blocks[:, flat, flat] += 1e-6 * blocks[:, flat, flat] + 1e-6  # points that nobody sees stay where they are
    cross = cross.reshape(frames, 3 * count, -1)[..., unknowns]
    solved = np.linalg.solve(blocks, np.concatenate((cross, by_points.reshape(frames, -1, 1)), axis=2))
    by_parameter, points = solved[..., :-1], solved[..., -1]
    gradients = gradients[:, unknowns] - np.einsum("fap,fa->fp", cross, points)
    size = len(unknowns)
    eliminated = cross.reshape(-1, size).T @ by_parameter.reshape(-1, size)
    reduced = matrix[np.ix_(unknowns, unknowns)] - eliminated
    equations = NormalEquations(reduced, gradient[unknowns] + gradients.sum(axis=0), cost)
    return _Linearised(equations, gradients, points, by_parameter)


def _priors(bundle: PointBundle) -> tuple[Array, Array, float]:
    """Return matrix, gradient and cost of the lenses', delays' and scale's priors, of all parameters."""
    size = PER_CAMERA * len(bundle.cameras) + len(bundle.bones_m)
    matrix, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
    for index, (camera, usual) in enumerate(zip(bundle.cameras, bundle.usual, strict=True)):
        off = np.array(
            (
                np.log(camera.focal_px / usual.focal_px) / _S.focal_sigma,
                (camera.distortion[0] - usual.distortion[0]) / _S.radial_sigma,
                bundle.delays_s[index] / _S.delay_sigma_s,
            )
        )
        sigmas = np.array((_S.focal_sigma, _S.radial_sigma, _S.delay_sigma_s))
        rows = index * PER_CAMERA + np.arange(6, 9)
        matrix[rows, rows] += 1.0 / sigmas**2
        gradient[rows] += off / sigmas
        cost += float(off @ off)
    second = bundle.cameras[1]
    apart = np.linalg.norm(second.translation_m)
    row = np.zeros(size)
    row[PER_CAMERA + 3 : PER_CAMERA + 6] = second.translation_m / (apart * bundle.apart_m * _S.scale_sigma)
    error = (apart / bundle.apart_m - 1.0) / _S.scale_sigma
    return matrix + np.outer(row, row), gradient + row * error, cost + float(error**2)


def _camera_rows(bundle: PointBundle, index: int) -> tuple[Array, Array, Array, float]:
    """Return a camera's weighted errors (F, K, 2), their derivatives by point and by parameter, and their loss."""
    camera, seen = bundle.cameras[index], bundle.sightings
    known = seen.seen[:, index]
    local = np.where(known[..., None], camera.to_camera(bundle.points_m), (0.0, 0.0, 1.0))
    depth = np.where(np.abs(local[..., 2:]) > 1e-3, local[..., 2:], 1e-3)
    flat = local[..., :2] / depth
    pixels = camera.to_pixels(flat)
    step = 1e-4
    lens = np.stack(
        [(camera.to_pixels(flat + axis) - camera.to_pixels(flat - axis)) / (2.0 * step) for axis in step * np.eye(2)],
        axis=-1,
    )  # derivatives (F, K, 2, 2) of pixels by normalised coordinates
    by_local = np.zeros((*known.shape, 2, 3))
    by_local[..., :2] = lens / depth[..., None]
    by_local[..., 2] = -np.einsum("fkij,fkj->fki", lens, flat) / depth
    rows = np.zeros((*known.shape, 2, PER_CAMERA))
    rows[..., :3] = -by_local @ rot.cross_matrices(local)
    rows[..., 3:6] = by_local
    rows[..., 6] = pixels - camera.matrix[:2, 2]
    rows[..., 7] = np.sum(flat**2, axis=-1, keepdims=True) * flat * camera.matrix[(0, 1), (0, 1)]
    rows[..., 8] = seen.velocities_px_s[:, index]
    errors = np.where(known[..., None], pixels - _observed(bundle, index), 0.0) / seen.sigmas_px[:, index, :, None]
    weight, loss = _cauchy(np.sum(errors**2, axis=-1), known, seen.share)
    scale = (weight / seen.sigmas_px[:, index])[..., None, None]
    return errors * weight[..., None], by_local @ camera.rotation * scale, rows * scale, loss


def _bone_rows(bundle: PointBundle, bone: int) -> tuple[Array, Array, Array, float]:
    """Return a bone's weighted errors (F,), derivatives (F, 3) by its first point, weights (F,) and loss."""
    seen, (i, j) = bundle.sightings, bundle.sightings.bones[bone]
    known = seen.seen[:, :, i].any(axis=1) & seen.seen[:, :, j].any(axis=1)
    apart = bundle.points_m[:, i] - bundle.points_m[:, j]
    length = np.maximum(np.linalg.norm(apart, axis=-1), 1e-6)
    errors = np.where(known, length - bundle.bones_m[bone], 0.0) / seen.bone_sigma_m
    weight, loss = _cauchy(errors**2, known, seen.share)
    scale = weight / seen.bone_sigma_m
    return errors * weight, apart / length[:, None] * scale[:, None], scale, loss


def _cauchy(squares: Array, known: Mask, share: float) -> tuple[Array, float]:
    """Return the weights of errors and their loss, from their squares."""
    bent = 1.0 + squares / _S.tail**2
    loss = share * _S.tail**2 * float(np.sum(np.log(bent)[known]))
    return np.where(known, np.sqrt(share / bent), 0.0), loss
