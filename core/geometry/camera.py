"""Pinhole cameras with lens distortion (OpenCV's model), and camera rigs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import CalibrationError
from .arrays import Array, ComplexArray, Mask

WORLD_FROM_CAMERA = np.diag([1.0, -1.0, -1.0])
"""World axes until a floor is known, for a level first camera that the performer faces."""
_AGAIN = "calibrate it again"


@dataclass(frozen=True)
class Camera:
    """One calibrated camera.

    Args:
        image_size: Width and height, pixels.
        matrix: Intrinsics (3, 3), pixels; pixel centres lie at whole numbers.
        distortion: k1, k2, p1, p2, k3 (5,) as in OpenCV.
        rotation: Camera-from-world (3, 3).
        translation_m: x_camera = rotation @ x_world + translation (3,).
        ignored_px: Pixels (N, 2) of reflections, at which blobs are ignored.
    """

    name: str
    image_size: tuple[int, int]
    matrix: Array
    distortion: Array = field(default_factory=lambda: np.zeros(5))
    rotation: Array = field(default_factory=lambda: np.eye(3))
    translation_m: Array = field(default_factory=lambda: np.zeros(3))
    ignored_px: Array = field(default_factory=lambda: np.empty((0, 2)))

    def __post_init__(self) -> None:
        size = (int(self.image_size[0]), int(self.image_size[1]))
        object.__setattr__(self, "image_size", size)
        for key, shape in (("matrix", (3, 3)), ("rotation", (3, 3)), ("translation_m", (3,)), ("distortion", (5,))):
            value = np.asarray(getattr(self, key), dtype=np.float64)
            if key == "distortion":
                if np.any(value.ravel()[5:]):
                    raise CalibrationError(
                        "at most five distortion coefficients (k1, k2, p1, p2, k3) are supported",
                        where=f"camera {self.name}",
                        advice="calibrate with OpenCV's standard lens model",
                    )
                value = np.pad(value.ravel()[:5], (0, max(0, 5 - value.size)))
            if value.shape != shape or not np.all(np.isfinite(value)):
                raise CalibrationError(
                    f"{key} must be an array of finite numbers with shape {shape}",
                    where=f"camera {self.name}",
                    advice=_AGAIN,
                )
            object.__setattr__(self, key, value)
        places = np.asarray(self.ignored_px, dtype=np.float64)
        places = places.reshape(-1, 2) if places.size == 0 else places
        if places.ndim != 2 or places.shape[1] != 2 or not np.all(np.isfinite(places)):
            raise CalibrationError(
                "ignored positions must be pairs of finite numbers",
                where=f"camera {self.name}",
                advice="correct them, or calibrate again",
            )
        object.__setattr__(self, "ignored_px", places)
        if min(size) <= 0 or self.matrix[0, 0] <= 0.0 or self.matrix[1, 1] <= 0.0:
            raise CalibrationError(
                "image size and focal lengths must be positive", where=f"camera {self.name}", advice=_AGAIN
            )
        if np.abs(self.rotation @ self.rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(self.rotation) < 0:
            raise CalibrationError("its rotation is not a rotation matrix", where=f"camera {self.name}", advice=_AGAIN)

    @property
    def centre_m(self) -> Array:
        """Optical centre (3,) in the world."""
        return np.asarray(-self.rotation.T @ self.translation_m)

    def to_camera(self, points_m: ArrayLike) -> Array:
        """Return world points (..., 3) in the camera's frame."""
        return np.asarray(np.asarray(points_m, dtype=np.float64) @ self.rotation.T + self.translation_m)

    def project(self, points_m: ArrayLike) -> Array:
        """Return pixels (..., 2) of world points (..., 3); NaN behind the camera."""
        local = self.to_camera(points_m)
        depth = np.where(local[..., 2:] > 1e-9, local[..., 2:], np.nan)
        return self.to_pixels(local[..., :2] / depth)

    def shows(self, points_m: ArrayLike) -> Mask:
        """Return a mask (...) of the world points (..., 3) that lie in the image."""
        local = self.to_camera(points_m)
        ahead = local[..., 2] > 0.1  # metres
        normalised = local[..., :2] / np.where(ahead, local[..., 2], 1.0)[..., None]
        pixels = self.to_pixels(normalised)
        inside = ahead & np.all((pixels >= 0.0) & (pixels <= np.array(self.image_size) - 1.0), axis=-1)
        # lens models fold directions far outside the image back into it
        back = self.undistort(pixels[inside])
        inside[inside] = np.abs(back - normalised[inside]).max(axis=-1, initial=0.0) < 0.01
        return np.asarray(inside)

    def to_pixels(self, normalised: ArrayLike) -> Array:
        """Return distorted pixels (..., 2) of undistorted normalised coordinates x/z, y/z."""
        points = np.asarray(normalised, dtype=np.float64)
        distorted = np.empty(points.shape)
        lens = _distorted(points[..., 0] + 1j * points[..., 1], self.distortion)[0]
        distorted[..., 0], distorted[..., 1] = lens.real, lens.imag
        return np.asarray(distorted @ self.matrix[:2, :2].T + self.matrix[:2, 2])

    def undistort(self, pixels: ArrayLike) -> Array:
        """Return undistorted normalised coordinates (..., 2) of pixels (..., 2)."""
        return _undistort(np.asarray(pixels, dtype=np.float64), *_intrinsics(self))

    def rays(self, normalised: ArrayLike) -> Array:
        """Return unit world directions (..., 3) of normalised coordinates (..., 2)."""
        n = np.asarray(normalised, dtype=np.float64)
        local = np.concatenate((n, np.ones((*n.shape[:-1], 1))), axis=-1)
        local /= np.linalg.norm(local, axis=-1, keepdims=True)
        return np.asarray(local @ self.rotation)

    @property
    def focal_px(self) -> float:
        """Mean of the two focal lengths, pixels."""
        return float(0.5 * (self.matrix[0, 0] + self.matrix[1, 1]))


def undistort_all(cameras: Sequence[Camera], pixels: Sequence[Array]) -> list[Array]:
    """Return the undistorted normalised coordinates (n, 2) of each camera's pixels (n, 2), computed all at once."""
    counts = [len(rows) for rows in pixels]
    columns = zip(*(_intrinsics(camera) for camera in cameras), strict=True)
    found = _undistort(np.concatenate(pixels), *(np.repeat(column, counts, axis=0) for column in columns))
    stops = list(accumulate(counts))
    return [found[stop - count : stop] for stop, count in zip(stops, counts, strict=True)]


def _intrinsics(camera: Camera) -> tuple[Array, Array]:
    """Return a camera's fx, skew, cx, fy, cy (5,) and its distortion (5,)."""
    return camera.matrix.ravel()[[0, 1, 2, 4, 5]], camera.distortion


def _undistort(pixels: Array, intrinsics: Array, distortion: Array) -> Array:
    """Return normalised coordinates (..., 2) of pixels by Newton's method on x + iy.

    Derivatives by z and its conjugate halve the work of a real Jacobian: df = f_z dz + f_c conj(dz), with f_z real.

    Args:
        intrinsics, distortion: Results of `_intrinsics`, one row (5,) for all pixels or one for each (n, 5).
    """
    fx, skew, cx, fy, cy = intrinsics.T
    k1, k2, _, _, k3 = distortion.T
    target_y = (pixels[..., 1] - cy) / fy
    target = (pixels[..., 0] - cx - skew * target_y) / fx + 1j * target_y
    z = target
    for _ in range(20):
        distorted, radial, r2, decentering = _distorted(z, distortion)
        error = distorted - target
        slope = k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3))
        by_z = radial + slope * r2 + 4.0 * (decentering * z.conj()).real
        by_conjugate = z * (slope * z + 2.0 * decentering)
        # the bound keeps points finite far outside the image, where the lens model folds back
        determinant = np.maximum(by_z * by_z - _squared(by_conjugate), 0.05)
        z = z - (by_z * error - by_conjugate * error.conj()) * (1.0 / determinant)
        # Newton's method converges quadratically, so the error left is about the square of this step
        if not np.max(np.abs(error), initial=0.0) > 1e-7:
            break
    found = np.empty(pixels.shape)
    found[..., 0], found[..., 1] = z.real, z.imag
    return found


def _distorted(z: ComplexArray, distortion: Array) -> tuple[ComplexArray, Array, Array, ComplexArray]:
    """Return distorted x + iy (Brown 1966), the radial factor, the squared radius and p2 + i p1."""
    k1, k2, p1, p2, k3 = distortion.T
    r2 = _squared(z)
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    decentering = p2 + 1j * p1
    return z * radial + 2.0 * r2 * decentering + decentering.conj() * (z * z), radial, r2, decentering


def _squared(z: ComplexArray) -> Array:
    """Return the squared absolute values of complex numbers."""
    return np.asarray(z.real * z.real + z.imag * z.imag)


@dataclass(frozen=True)
class CameraRig:
    """One or more cameras that are calibrated in the same world.

    Args:
        metadata: Facts about the calibration (error, date, ...), which the file stores.
    """

    cameras: tuple[Camera, ...]
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        if not self.cameras:
            raise CalibrationError("needs at least one camera", where="camera rig", advice="calibrate a camera first")

    def __len__(self) -> int:
        return len(self.cameras)

    @property
    def ignored(self) -> Array:
        """Ignored pixels (N, 3) of all cameras: camera index, x, y."""
        rows = [np.insert(camera.ignored_px, 0, index, axis=1) for index, camera in enumerate(self.cameras)]
        return np.concatenate(rows)

    @property
    def heights_mm(self) -> dict[str, float]:
        """Height of each optical centre above y = 0, by the camera's name."""
        return {camera.name: 1e3 * float(camera.centre_m[1]) for camera in self.cameras}

    def ignoring(self, places: ArrayLike) -> "CameraRig":
        """Return the rig with other ignored positions (N, 3), as in `ignored`."""
        rows = np.asarray(places, dtype=np.float64).reshape(-1, 3)
        cameras = (
            replace(camera, ignored_px=rows[rows[:, 0] == index, 1:]) for index, camera in enumerate(self.cameras)
        )
        return replace(self, cameras=tuple(cameras))

    def baseline_m(self, first: int = 0, second: int = 1) -> float:
        """Return the distance between two optical centres."""
        return float(np.linalg.norm(self.cameras[first].centre_m - self.cameras[second].centre_m))
