"""Camera rigs as files: anipose layout, caliscope TOML and Qualisys XML."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import CalibrationError
from ..system.files import read_bytes, read_toml, write_toml
from ..system.schema import Key, Schema
from . import rotations as rot
from .camera import Camera, CameraRig
from .rig_import import caliscope_rows, level_from_world, qualisys_rows
from .rigid_transform import nearest_rotation

CAMERA = Schema(
    "Camera of a calibration",
    "A table `[cam_0]`, `[cam_1]`, ... for each camera, in anipose's layout.",
    (
        Key("name", "of the camera", str, optional=True),
        Key("size", "width and height of its images", int, (2,), "pixels", 1, 100_000),
        Key("matrix", "focal lengths and centre, as OpenCV's", float, (3, 3), "pixels", -1e6, 1e6),
        Key("distortions", "k1, k2, p1, p2, k3, as OpenCV's", float, (None,), "", -1e6, 1e6, optional=True),
        Key("rotation", "camera from world: rotation vector, or matrix", float, (3,), "", -1e3, 1e3, or_shape=(3, 3)),
        Key("translation", "camera from world, in the file's unit", float, (3,), "", -1e6, 1e6),
        Key("ignored_px", "places of reflections", float, (None, 2), "pixels", -1e6, 1e6, optional=True),
        Key("fisheye", "true is refused: another lens model", bool, optional=True),
    ),
    CalibrationError,
    "calibrate the cameras again",
)
_UNIT = Key("length_unit", "unit of all lengths", str, choices=("m", "mm", "unknown"), optional=True)
METADATA = Schema(
    "Calibration as a whole",
    "Beside the cameras' tables; other keys of `[metadata]` are kept as they are.",
    (Key("metadata", "about all cameras", (_UNIT,), optional=True),),
    CalibrationError,
    'length_unit is "m" or "mm"',
)


def save_rig(rig: CameraRig, path: str | Path) -> None:
    """Write the rig in anipose's layout, rotations as rotation vectors."""
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
        if len(camera.ignored_px):
            tables[f"cam_{i}"]["ignored_px"] = camera.ignored_px
    return tables | {"metadata": dict(rig.metadata) | {"length_unit": "m"}}


def load_rig(path: str | Path) -> CameraRig:
    """Return the rig of a calibration file: anipose, caliscope or Qualisys.

    Files of other programs are brought to metres and to a world with y up. In anipose's layout a file without
    `metadata.length_unit` is of another program: there anipose writes the unit of its board, millimetres, and a
    baseline above 10 shows it.

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
    """Return the rig of anipose tables; inverse of `rig_tables`."""
    keys = _camera_keys(tables)
    CAMERA.check_each({key: tables[key] for key in keys}, where)
    METADATA.check(tables, where)
    rows = [{"name": key, **tables[key]} for key in keys]
    cameras = _cameras_from(rows, where)
    metadata = tables.get("metadata", {})
    unit = metadata.get("length_unit", "unknown")
    centres = np.array([camera.centre_m for camera in cameras])
    if unit == "mm" or (unit == "unknown" and np.linalg.norm(centres - centres[0], axis=1).max() > 10.0):
        cameras = tuple(replace(camera, translation_m=camera.translation_m * 1e-3) for camera in cameras)
    return CameraRig(cameras, metadata) if unit != "unknown" else _levelled(cameras, metadata)


def save_ignored(path: str | Path, places: ArrayLike) -> None:
    """Write the ignored places into a calibration in anipose's layout.

    Args:
        places: as of `CameraRig.ignored`.

    Raises:
        FormatError: the file cannot be read, or is no TOML.
        CalibrationError: it has another layout.
    """
    tables = read_toml(path)
    keys = _camera_keys(tables)
    if not keys or not all(isinstance(tables[key], dict) for key in keys):
        raise CalibrationError(
            "is a calibration of another program, which notes no places to ignore",
            where=str(path),
            advice="calibrate here, or cover the reflections",
        )
    rows = np.asarray(places, dtype=np.float64).reshape(-1, 3)
    for index, key in enumerate(keys):
        own = rows[rows[:, 0] == index, 1:].round(2).tolist()
        tables[key] = {name: value for name, value in tables[key].items() if name != "ignored_px"}
        tables[key] |= {"ignored_px": own} if own else {}
    write_toml(path, tables)


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


def _camera_keys(tables: Mapping[str, Any]) -> list[str]:
    return [key for key in sorted(tables, key=_camera_order) if key.startswith("cam_")]


def _camera_order(key: str) -> tuple[int, str]:
    suffix = key.removeprefix("cam_")
    return (int(suffix) if suffix.isdecimal() and len(suffix) < 9 else 10**9, key)


def _camera_from(row: Mapping[str, Any], where: str) -> Camera:
    CAMERA.check(row, where)
    if row.get("fisheye", False):
        raise CalibrationError(
            "fisheye lenses are not supported", where=where, advice="calibrate with the standard lens model"
        )
    rotation = np.asarray(row["rotation"], dtype=np.float64)
    matrix = rotation if rotation.shape == (3, 3) else rot.to_matrix(rot.from_rotation_vector(rotation))
    if 1e-9 < np.abs(matrix @ matrix.T - np.eye(3)).max() < 1e-3:  # few digits, or from a bundle adjustment
        matrix = nearest_rotation(matrix)
    return Camera(
        name=row.get("name", "camera"),
        image_size=(int(row["size"][0]), int(row["size"][1])),
        matrix=np.asarray(row["matrix"], dtype=np.float64),
        distortion=np.asarray(row.get("distortions", [0.0] * 5), dtype=np.float64),
        rotation=matrix,
        translation_m=np.asarray(row["translation"], dtype=np.float64),
        ignored_px=np.asarray(row.get("ignored_px", ()), dtype=np.float64),
    )
