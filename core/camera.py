"""Pinhole cameras with lens distortion (OpenCV's model and frame) and rigs of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import rotations as rot
from .errors import CalibrationError
from .foreign_rigs import caliscope_rows, level_from_world, qualisys_rows
from .system.files import read_bytes, read_toml, write_toml

Array = NDArray[np.float64]

WORLD_FROM_CAMERA = np.diag([1.0, -1.0, -1.0])
"""Axes of the world seen by a level camera that the performer faces, used until a floor is known."""

_UNDISTORT_ITERATIONS = 20
_UNDISTORT_ERROR = 1e-7  # normalised, before the last step
_LEAST_DETERMINANT = 0.05


@dataclass(frozen=True)
class Camera:
    """One calibrated camera.

    Args:
        name: what it is called.
        image_size: (width, height), pixels.
        matrix: (3, 3) intrinsics, pixels; pixel centres lie at whole numbers.
        distortion: (5,) k1, k2, p1, p2, k3 as in OpenCV.
        rotation: (3, 3) camera-from-world.
        translation_m: (3,) with x_camera = rotation @ x_world + translation.
    """

    name: str
    image_size: tuple[int, int]
    matrix: Array
    distortion: Array = field(default_factory=lambda: np.zeros(5))
    rotation: Array = field(default_factory=lambda: np.eye(3))
    translation_m: Array = field(default_factory=lambda: np.zeros(3))

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
        """Return the pixels (..., 2) of world points (..., 3); NaN for points behind the camera."""
        local = self.to_camera(points_m)
        depth = np.where(local[..., 2:] > 1e-9, local[..., 2:], np.nan)
        return self.to_pixels(local[..., :2] / depth)

    def to_pixels(self, normalised: ArrayLike) -> Array:
        """Return distorted pixels (..., 2) of undistorted normalised coordinates x/z, y/z."""
        distorted = _distort(np.asarray(normalised, dtype=np.float64), self.distortion)
        return np.asarray(distorted @ self.matrix[:2, :2].T + self.matrix[:2, 2])

    def undistort(self, pixels: ArrayLike) -> Array:
        """Return undistorted normalised coordinates (..., 2) of pixels."""
        p = np.asarray(pixels, dtype=np.float64)
        return _undistort(p, *_intrinsics(self))

    def rays(self, normalised: ArrayLike) -> Array:
        """Return unit directions (..., 3) in the world of undistorted normalised coordinates (..., 2)."""
        n = np.asarray(normalised, dtype=np.float64)
        local = np.concatenate((n, np.ones((*n.shape[:-1], 1))), axis=-1)
        local /= np.linalg.norm(local, axis=-1, keepdims=True)
        return np.asarray(local @ self.rotation)

    @property
    def focal_px(self) -> float:
        """Mean focal length in pixels: one pixel is about 1 / focal_px in normalised coordinates."""
        return float(0.5 * (self.matrix[0, 0] + self.matrix[1, 1]))


def undistort_all(cameras: Sequence[Camera], pixels: Sequence[Array]) -> list[Array]:
    """Return the undistorted normalised coordinates (n, 2) of each camera's pixels (n, 2), as `Camera.undistort`.

    For the few markers of some images this takes as long as for those of one.
    """
    counts = [len(rows) for rows in pixels]
    columns = zip(*(_intrinsics(camera) for camera in cameras), strict=True)
    found = _undistort(np.concatenate(pixels), *(np.repeat(column, counts, axis=0) for column in columns))
    return np.split(found, np.cumsum(counts)[:-1])


def _intrinsics(camera: Camera) -> tuple[Array, Array]:
    """Return fx, skew, cx, fy, cy (5,) and the distortion (5,)."""
    return camera.matrix.ravel()[[0, 1, 2, 4, 5]], camera.distortion


def _undistort(pixels: Array, intrinsics: Array, distortion: Array) -> Array:
    """Invert matrix and lens (..., 5) each, of pixels (..., 2), by Newton's method."""
    fx, skew, cx, fy, cy = np.moveaxis(intrinsics, -1, 0)
    k1, k2, p1, p2, k3 = np.moveaxis(distortion, -1, 0)
    target_y = (pixels[..., 1] - cy) / fy
    target_x = (pixels[..., 0] - cx - skew * target_y) / fx
    x, y = target_x, target_y
    for _ in range(_UNDISTORT_ITERATIONS):
        distorted_x, distorted_y, radial, r2 = _distorted(x, y, distortion)
        error_x, error_y = distorted_x - target_x, distorted_y - target_y
        slope = 2.0 * k1 + r2 * (4.0 * k2 + r2 * 6.0 * k3)
        xx = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
        yy = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
        xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
        # a lens model that folds back far outside the image must not throw points away
        determinant = np.maximum(xx * yy - xy * xy, _LEAST_DETERMINANT)
        x = x - (yy * error_x - xy * error_y) / determinant
        y = y - (xx * error_y - xy * error_x) / determinant
        # squared by the step that was just taken
        if not max(np.max(np.abs(error_x), initial=0.0), np.max(np.abs(error_y), initial=0.0)) > _UNDISTORT_ERROR:
            break
    return np.stack((x, y), axis=-1)


def _distort(normalised: Array, distortion: Array) -> Array:
    """Apply radial and tangential distortion (Brown 1966, as in OpenCV) to normalised coordinates (..., 2)."""
    x, y, _, _ = _distorted(normalised[..., 0], normalised[..., 1], distortion)
    return np.stack((x, y), axis=-1)


def _distorted(x: Array, y: Array, distortion: Array) -> tuple[Array, Array, Array, Array]:
    """Return distorted x and y, the radial factor, and the squared radius."""
    k1, k2, p1, p2, k3 = np.moveaxis(distortion, -1, 0)
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    distorted_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    distorted_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return distorted_x, distorted_y, radial, r2


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

    def baseline_m(self, first: int = 0, second: int = 1) -> float:
        """Return the distance between two optical centres."""
        return float(np.linalg.norm(self.cameras[first].centre_m - self.cameras[second].centre_m))


def save_rig(rig: CameraRig, path: str | Path) -> None:
    """Write the rig in anipose's layout: one table a camera, rotation as a rotation vector."""
    write_toml(path, rig_tables(rig))


def rig_tables(rig: CameraRig) -> dict[str, Any]:
    """Return the tables that `save_rig` writes."""
    tables: dict[str, Any] = {}
    for i, camera in enumerate(rig.cameras):
        tables[f"cam_{i}"] = {
            "name": camera.name,
            "size": list(camera.image_size),
            "matrix": camera.matrix,
            "distortions": camera.distortion,
            "rotation": rot.to_rotation_vector(rot.from_matrix(camera.rotation)),
            "translation": camera.translation_m,
        }
    return tables | {"metadata": dict(rig.metadata) | {"length_unit": "m"}}


def load_rig(path: str | Path) -> CameraRig:
    """Return a rig from a calibration file: anipose's layout (`cam_N` tables), caliscope's TOML, or Qualisys' XML.

    Files of other programs are brought to metres and to a world with y up. In anipose's layout a file without
    `metadata.length_unit` is of another program: there anipose writes the unit of its board, millimetres, and a
    baseline above 10 tells so.

    Raises:
        FormatError: the file cannot be read, or is no TOML.
        CalibrationError: no cameras, incomplete ones, fisheye lenses, or a unit other than "m" and "mm".
    """
    raw = read_bytes(path)
    if raw.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        return _levelled(_cameras_from(qualisys_rows(raw, str(path)), str(path)), {})
    tables = read_toml(path)
    if "cameras" in tables:
        return _levelled(_cameras_from(caliscope_rows(tables, str(path)), str(path)), {})
    return rig_from(tables, str(path))


def rig_from(tables: Mapping[str, Any], where: str) -> CameraRig:
    """Return the rig of tables in anipose's layout, `rig_tables`' inverse; errors as in `load_rig`."""
    keys = [key for key in sorted(tables, key=_camera_order) if key.startswith("cam_")]
    rows = [{"name": key} | tables[key] if isinstance(tables[key], Mapping) else tables[key] for key in keys]
    cameras = _cameras_from(rows, where)
    metadata = tables.get("metadata", {})
    unit = metadata.get("length_unit", "unknown") if isinstance(metadata, Mapping) else None
    if unit not in ("m", "mm", "unknown"):
        raise CalibrationError("metadata is not understood", where=where, advice='length_unit is "m" or "mm"')
    if unit == "mm" or (unit == "unknown" and _spread(cameras) > 10.0):
        cameras = tuple(_scaled(camera, 1e-3) for camera in cameras)
    return CameraRig(cameras, metadata) if unit != "unknown" else _levelled(cameras, metadata)


def _cameras_from(rows: Sequence[Any], where: str) -> tuple[Camera, ...]:
    if not rows:
        raise CalibrationError(
            "holds no cameras",
            where=where,
            advice="use a file of `perfanim calibrate cameras`, anipose, caliscope or Qualisys",
        )
    return tuple(_camera_from(row, where) for row in rows)


def _levelled(cameras: Sequence[Camera], metadata: Mapping[str, Any]) -> CameraRig:
    turn = level_from_world(np.array([camera.rotation for camera in cameras]))
    return CameraRig(tuple(replace(camera, rotation=camera.rotation @ turn.T) for camera in cameras), metadata)


def _camera_order(key: str) -> tuple[int, str]:
    suffix = key.removeprefix("cam_")
    return (int(suffix) if suffix.isdigit() else 10**9, key)


def _camera_from(row: Mapping[str, Any], where: str) -> Camera:
    try:
        if row.get("fisheye", False):
            raise CalibrationError(
                "fisheye lenses are not supported", where=where, advice="calibrate with the standard lens model"
            )
        rotation = np.asarray(row["rotation"], dtype=np.float64)
        if rotation.shape == (3, 3):
            matrix = _nearest_rotation(rotation)  # other programs' have few digits, or come out of a bundle adjustment
        else:
            matrix = rot.to_matrix(rot.from_rotation_vector(rotation))
        return Camera(
            name=str(row.get("name", "camera")),
            image_size=(int(row["size"][0]), int(row["size"][1])),
            matrix=np.asarray(row["matrix"], dtype=np.float64),
            distortion=np.asarray(row.get("distortions", [0.0] * 5), dtype=np.float64),
            rotation=matrix,
            translation_m=np.asarray(row["translation"], dtype=np.float64),
        )
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise CalibrationError(
            f"a camera table is incomplete ({error})", where=where, advice="calibrate the cameras again"
        ) from error


def _nearest_rotation(matrix: Array) -> Array:
    """Return the rotation nearest to a matrix (3, 3) that is almost one; others as they are."""
    if not 1e-9 < np.abs(matrix @ matrix.T - np.eye(3)).max() < 1e-3:
        return matrix
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ vt)


def _spread(cameras: Sequence[Camera]) -> float:
    centres = np.array([camera.centre_m for camera in cameras])
    return float(np.linalg.norm(centres - centres[0], axis=1).max())


def _scaled(camera: Camera, factor: float) -> Camera:
    return replace(camera, translation_m=camera.translation_m * factor)
