"""Camera rig files: anipose TOML, caliscope TOML, Qualisys XML, and stereo files of OpenCV and MATLAB."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..errors import CalibrationError
from ..system.files import read_bytes, read_toml, write_toml
from ..system.schema import About, Schema, Table, Via, table_of
from . import rotations as rot
from .arrays import Array
from .camera import Camera, CameraRig
from .lens_check import lens_fault
from .rig_import import caliscope_rows, level_from_world, qualisys_rows
from .rigid_transform import nearest_rotation
from .stereo_import import is_stereo, stereo_rows

CALIBRATION_ENDINGS = (".toml", ".json", ".yaml", ".yml", ".xml", ".mat", ".txt")
"""Extensions of the files that `load_rig` reads."""
_FARTHEST = 1e6  # largest value of pixels, and of lengths in the file's unit


@dataclass(frozen=True)
class _CameraTable:
    """One camera, as stored in a calibration file."""

    size: Annotated[tuple[int, int], About("width and height of the images", "pixels", 1, 100_000)]
    matrix: Annotated[Array, About("intrinsic matrix, as in OpenCV", "pixels", -_FARTHEST, _FARTHEST, shape=(3, 3))]
    rotation: Annotated[
        Array, About("camera from world: rotation vector, or matrix", "", -1e3, 1e3, shape=(3,), or_shape=(3, 3))
    ]
    translation: Annotated[Array, About("camera from world, in the file's unit", "", -_FARTHEST, _FARTHEST, shape=(3,))]
    name: Annotated[str, About("name of the camera; by default the name of the table")] = "camera"
    distortions: Annotated[
        Array, About("k1, k2, p1, p2, k3, as in OpenCV", "", -_FARTHEST, _FARTHEST, shape=(None,))
    ] = field(default_factory=lambda: np.zeros(5))
    ignored_px: Annotated[
        Array, About("positions of reflections", "pixels", -_FARTHEST, _FARTHEST, shape=(None, 2))
    ] = field(default_factory=lambda: np.zeros((0, 2)))
    fisheye: Annotated[bool, About("whether the lens is a fisheye, which is refused")] = False


@dataclass(frozen=True)
class _Metadata:
    """The only key of `[metadata]` that is read."""

    length_unit: Annotated[str, About("unit of all lengths", choices=("m", "mm", "unknown"))] = "unknown"


@dataclass(frozen=True)
class _Calibration:
    """Parts of a calibration file that concern all cameras."""

    metadata: Annotated[_Metadata, About("about all cameras")] = _Metadata()


CAMERA = Schema(
    _CameraTable,
    "Camera of a calibration",
    "A table `[cam_0]`, `[cam_1]`, ... for each camera, in anipose's layout.",
    CalibrationError,
    "calibrate the cameras again",
)
METADATA = Schema(
    _Calibration,
    "Calibration as a whole",
    "A table beside those of the cameras; its other keys are kept as they are.",
    CalibrationError,
    'set length_unit to "m" or "mm"',
)


def save_rig(rig: CameraRig, path: str | Path) -> None:
    """Write the rig in anipose's layout, with rotation vectors."""
    write_toml(path, rig_tables(rig))


def rig_tables(rig: CameraRig, exact: bool = False) -> dict[str, Any]:
    """Return the tables that `save_rig` writes; if `exact`, rotations are matrices at full precision."""
    tables: dict[str, Any] = {}
    for index, camera in enumerate(rig.cameras):
        tables[f"cam_{index}"] = table_of(_table(camera)) | ({"rotation": camera.rotation.tolist()} if exact else {})
    return tables | {"metadata": dict(rig.metadata) | {"length_unit": "m"}}


def _table(camera: Camera) -> _CameraTable:
    return _CameraTable(
        size=camera.image_size,
        matrix=camera.matrix,
        rotation=rot.to_rotation_vector(rot.from_matrix(camera.rotation)),
        translation=camera.translation_m,
        name=camera.name,
        distortions=camera.distortion,
        ignored_px=camera.ignored_px,
    )


def load_rig(path: str | Path) -> CameraRig:
    """Return the rig in a calibration file: anipose, caliscope, Qualisys, or a stereo file of OpenCV or MATLAB.

    Files of other programs are converted to metres and to a world with y up. Anipose's lack `metadata.length_unit`, and
    stereo files name no unit: their lengths are in the unit of the board, which is assumed to be millimetres if a
    baseline exceeds 10.

    Raises:
        FormatError: The file cannot be read.
        CalibrationError: Cameras are missing or incomplete, or have fisheye lenses.
    """
    raw = read_bytes(path)
    if is_stereo(raw, str(path)):
        rows, unit = stereo_rows(raw, str(path))
        return _levelled(_in_metres(_read_cameras(rows, str(path)), unit), {})
    if _is_markup(raw):
        return _levelled(_read_cameras(qualisys_rows(raw, str(path)), str(path)), {})
    tables = read_toml(path)
    if "cameras" in tables:
        return _levelled(_read_cameras(caliscope_rows(tables, str(path)), str(path)), {})
    return rig_from(tables, str(path))


def _is_markup(raw: bytes) -> bool:
    return raw.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<")


def rig_from(tables: Table, where: str) -> CameraRig:
    """Return the rig of anipose tables; inverse of `rig_tables`."""
    rows = CAMERA.read_each({key: tables[key] for key in _camera_keys(tables)}, where)
    metadata, unit = tables.get("metadata", {}), METADATA.read(tables, where).metadata.length_unit
    cameras = _in_metres(_cameras(list(rows.values()), where), unit)
    return CameraRig(cameras, metadata) if unit != "unknown" else _levelled(cameras, metadata)


RigTables: TypeAlias = Annotated[CameraRig, Via(Table, rig_from, partial(rig_tables, exact=True))]


def save_ignored(path: str | Path, places: ArrayLike) -> None:
    """Write ignored positions (N, 3), as in `CameraRig.ignored`, into a calibration file in anipose's layout."""
    raw = read_bytes(path)
    tables = {} if is_stereo(raw, str(path)) or _is_markup(raw) else read_toml(path)
    keys = _camera_keys(tables)
    if not keys or not all(isinstance(tables[key], dict) for key in keys):
        raise CalibrationError(
            "is a calibration of another program, which cannot hold ignored positions",
            where=str(path),
            advice="calibrate here, or cover the reflections",
        )
    rows = np.asarray(places, dtype=np.float64).reshape(-1, 3)
    for index, key in enumerate(keys):
        own = rows[rows[:, 0] == index, 1:].round(2).tolist()
        tables[key] = {name: value for name, value in tables[key].items() if name != "ignored_px"}
        tables[key] |= {"ignored_px": own} if own else {}
    write_toml(path, tables)


def _read_cameras(rows: Sequence[Table], where: str) -> tuple[Camera, ...]:
    return _cameras([CAMERA.read(row, where) for row in rows], where)


def _cameras(tables: Sequence[_CameraTable], where: str) -> tuple[Camera, ...]:
    if not tables:
        raise CalibrationError(
            "holds no cameras",
            where=where,
            advice="use a calibration from Perfanim, anipose, caliscope, Qualisys, OpenCV or MATLAB",
        )
    return tuple(_camera(table, where) for table in tables)


def _in_metres(cameras: tuple[Camera, ...], unit: str) -> tuple[Camera, ...]:
    centres = np.array([camera.centre_m for camera in cameras])
    if unit == "mm" or (unit == "unknown" and np.linalg.norm(centres - centres[0], axis=1).max() > 10.0):
        return tuple(replace(camera, translation_m=camera.translation_m * 1e-3) for camera in cameras)
    return cameras


def _levelled(cameras: Sequence[Camera], metadata: Mapping[str, Any]) -> CameraRig:
    turn = level_from_world(np.array([camera.rotation for camera in cameras]))
    return CameraRig(tuple(replace(camera, rotation=camera.rotation @ turn.T) for camera in cameras), metadata)


def _camera_keys(tables: Mapping[str, Any]) -> list[str]:
    return [key for key in sorted(tables, key=_camera_order) if key.startswith("cam_")]


def _camera_order(key: str) -> tuple[int, str]:
    suffix = key.removeprefix("cam_")
    return (int(suffix) if suffix.isdecimal() and len(suffix) < 9 else 10**9, key)


def _camera(table: _CameraTable, where: str) -> Camera:
    if table.fisheye:
        raise CalibrationError(
            "fisheye lenses are not supported", where=where, advice="calibrate with the standard lens model"
        )
    turn = table.rotation
    matrix = turn if turn.shape == (3, 3) else rot.to_matrix(rot.from_rotation_vector(turn))
    if 1e-9 < np.abs(matrix @ matrix.T - np.eye(3)).max() < 1e-3:  # rounded, or not quite orthonormal
        matrix = nearest_rotation(matrix)
    found = (table.name, table.size, table.matrix, table.distortions, matrix, table.translation, table.ignored_px)
    camera = Camera(*found)
    if fault := lens_fault(camera):
        raise CalibrationError(f"camera {camera.name} {fault}", where=where, advice="calibrate it again")
    return camera
