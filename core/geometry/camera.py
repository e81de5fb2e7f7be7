"""Pinhole cameras with lens distortion (OpenCV's model), and rigs of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import CalibrationError
from .arrays import Array, ComplexArray

WORLD_FROM_CAMERA = np.diag([1.0, -1.0, -1.0])
"""Axes of the world seen by a level camera that the performer faces, used until a floor is known."""

_UNDISTORT_ITERATIONS = 20
_UNDISTORT_ERROR = 1e-7  # normalised, before the last step
_LEAST_DETERMINANT = 0.05


@dataclass(frozen=True)
class Camera:
    """One calibrated camera.

    Args:
        image_size: (width, height), pixels.
        matrix: (3, 3) intrinsics, pixels; pixel centres lie at whole numbers.
        distortion: (5,) k1, k2, p1, p2, k3 as in OpenCV.
        rotation: (3, 3) camera-from-world.
        translation_m: (3,) with x_camera = rotation @ x_world + translation.
        ignored_px: (N, 2) places in the image where nothing is taken for a marker: reflections that cannot be covered.
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
                raise CalibrationError(f"{key} must be {shape} finite numbers", where=f"camera {self.name}")
            object.__setattr__(self, key, value)
        places = np.asarray(self.ignored_px, dtype=np.float64)
        places = places.reshape(-1, 2) if places.size == 0 else places
        if places.ndim != 2 or places.shape[1] != 2 or not np.all(np.isfinite(places)):
            raise CalibrationError("ignored places must be pairs of finite numbers", where=f"camera {self.name}")
        object.__setattr__(self, "ignored_px", places)
        if min(size) <= 0 or self.matrix[0, 0] <= 0.0 or self.matrix[1, 1] <= 0.0:
            raise CalibrationError("image size and focal lengths must be positive", where=f"camera {self.name}")
        if np.abs(self.rotation @ self.rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(self.rotation) < 0:
            raise CalibrationError("rotation is not a rotation matrix", where=f"camera {self.name}")

    @property
    def centre_m(self) -> Array:
        """(3,) optical centre in the world."""
        return np.asarray(-self.rotation.T @ self.translation_m)

    def to_camera(self, points_m: ArrayLike) -> Array:
        """Return world points (..., 3) in the camera's frame."""
        return np.asarray(np.asarray(points_m, dtype=np.float64) @ self.rotation.T + self.translation_m)

    def project(self, points_m: ArrayLike) -> Array:
        """Return pixels (..., 2) of world points (..., 3); NaN behind the camera."""
        local = self.to_camera(points_m)
        depth = np.where(local[..., 2:] > 1e-9, local[..., 2:], np.nan)
        return self.to_pixels(local[..., :2] / depth)

    def to_pixels(self, normalised: ArrayLike) -> Array:
        """Return distorted pixels (..., 2) of undistorted normalised coordinates x/z, y/z."""
        points = np.asarray(normalised, dtype=np.float64)
        distorted = np.empty(points.shape)
        lens = _distorted(points[..., 0] + 1j * points[..., 1], self.distortion)[0]
        distorted[..., 0], distorted[..., 1] = lens.real, lens.imag
        return np.asarray(distorted @ self.matrix[:2, :2].T + self.matrix[:2, 2])

    def undistort(self, pixels: ArrayLike) -> Array:
        """Return undistorted normalised coordinates (..., 2) of pixels."""
        p = np.asarray(pixels, dtype=np.float64)
        return _undistort(p, *_intrinsics(self))

    def rays(self, normalised: ArrayLike) -> Array:
        """Return unit world directions (..., 3) of normalised coordinates (..., 2)."""
        n = np.asarray(normalised, dtype=np.float64)
        local = np.concatenate((n, np.ones((*n.shape[:-1], 1))), axis=-1)
        local /= np.linalg.norm(local, axis=-1, keepdims=True)
        return np.asarray(local @ self.rotation)

    @property
    def focal_px(self) -> float:
        """Mean focal length in pixels: the inverse of a pixel's normalised size."""
        return float(0.5 * (self.matrix[0, 0] + self.matrix[1, 1]))


def undistort_all(cameras: Sequence[Camera], pixels: Sequence[Array]) -> list[Array]:
    """Return each camera's undistorted normalised coordinates (n, 2) of its pixels.

    For the few markers of some images this takes as long as for those of one.
    """
    counts = [len(rows) for rows in pixels]
    columns = zip(*(_intrinsics(camera) for camera in cameras), strict=True)
    found = _undistort(np.concatenate(pixels), *(np.repeat(column, counts, axis=0) for column in columns))
    stops = list(accumulate(counts))
    return [found[stop - count : stop] for stop, count in zip(stops, counts, strict=True)]


def _intrinsics(camera: Camera) -> tuple[Array, Array]:
    """Return fx, skew, cx, fy, cy (5,) and the distortion (5,)."""
    return camera.matrix.ravel()[[0, 1, 2, 4, 5]], camera.distortion


def _undistort(pixels: Array, intrinsics: Array, distortion: Array) -> Array:
    """Invert matrix and lens of pixels (..., 2) by Newton's method.

    The complex derivatives of a map f of the plane, by z and by its conjugate, take half the work of a real Jacobian:
    df = f_z dz + f_c conj(dz); f_z of a lens is real.

    Args:
        intrinsics, distortion: of `_intrinsics`, (5,) for all pixels or (n, 5) for n of them.
    """
    fx, skew, cx, fy, cy = intrinsics.T
    k1, k2, _, _, k3 = distortion.T
    target_y = (pixels[..., 1] - cy) / fy
    target = (pixels[..., 0] - cx - skew * target_y) / fx + 1j * target_y
    z = target
    for _ in range(_UNDISTORT_ITERATIONS):
        distorted, radial, r2, decentering = _distorted(z, distortion)
        error = distorted - target
        slope = k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3))
        by_z = radial + slope * r2 + 4.0 * (decentering * z.conj()).real
        by_conjugate = z * (slope * z + 2.0 * decentering)
        # a lens model that folds back far outside the image must not throw points away
        determinant = np.maximum(by_z * by_z - _squared(by_conjugate), _LEAST_DETERMINANT)
        z = z - (by_z * error - by_conjugate * error.conj()) * (1.0 / determinant)
        # squared by the step that was just taken
        if not np.max(np.abs(error), initial=0.0) > _UNDISTORT_ERROR:
            break
    found = np.empty(pixels.shape)
    found[..., 0], found[..., 1] = z.real, z.imag
    return found


def _distorted(z: ComplexArray, distortion: Array) -> tuple[ComplexArray, Array, Array, ComplexArray]:
    """Return distorted x + iy (Brown 1966), radial factor, squared radius, p2 + i p1."""
    k1, k2, p1, p2, k3 = distortion.T
    r2 = _squared(z)
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    decentering = p2 + 1j * p1
    return z * radial + 2.0 * r2 * decentering + decentering.conj() * (z * z), radial, r2, decentering


def _squared(z: ComplexArray) -> Array:
    """Return the squared absolute values."""
    return np.asarray(z.real * z.real + z.imag * z.imag)


@dataclass(frozen=True)
class CameraRig:
    """Cameras calibrated together; the world is theirs in common.

    Args:
        cameras: at least one.
        metadata: facts about the calibration (error, date, ...), kept in the file.
    """

    cameras: tuple[Camera, ...]
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        if not self.cameras:
            raise CalibrationError("a camera rig needs at least one camera")

    def __len__(self) -> int:
        return len(self.cameras)

    @property
    def ignored(self) -> Array:
        """(N, 3) ignored places of all cameras: index of the camera, x, y."""
        rows = [np.insert(camera.ignored_px, 0, index, axis=1) for index, camera in enumerate(self.cameras)]
        return np.concatenate(rows)

    def ignoring(self, places: ArrayLike) -> "CameraRig":
        """Return the rig with these ignored places (N, 3) alone, as `ignored` gives them."""
        rows = np.asarray(places, dtype=np.float64).reshape(-1, 3)
        cameras = (
            replace(camera, ignored_px=rows[rows[:, 0] == index, 1:]) for index, camera in enumerate(self.cameras)
        )
        return replace(self, cameras=tuple(cameras))

    def baseline_m(self, first: int = 0, second: int = 1) -> float:
        """Return the distance between two optical centres."""
        return float(np.linalg.norm(self.cameras[first].centre_m - self.cameras[second].centre_m))
