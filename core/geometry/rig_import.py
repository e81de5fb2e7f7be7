"""Camera calibrations from other programs, converted to metres and OpenCV's frame.

- caliscope: TOML with tables [cameras.N], in metres, camera-from-world as a matrix or a rotation vector; "null" where a
  camera was not placed.
- Qualisys Track Manager: XML (`*.qca.txt`) in millimetres. The rows r1x, r2x, r3x are the camera's axes, y up and z
  backwards; intrinsics are in 64ths of a pixel, from the corner of the field of view; distortion is as in OpenCV.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import CalibrationError
from ..system.file_content import check_kind
from ..system.files import reading
from .arrays import Array

_OPENCV_FROM_QUALISYS = np.diag([1.0, -1.0, -1.0])


def caliscope_rows(tables: Mapping[str, Any], where: str) -> list[dict[str, Any]]:
    """Return the camera tables of a caliscope file.

    Raises:
        CalibrationError: A camera has not been placed, or there are no cameras.
    """
    cameras = tables["cameras"]
    if not isinstance(cameras, Mapping) or not all(isinstance(row, Mapping) for row in cameras.values()):
        raise CalibrationError("[cameras] has no camera tables", where=where, advice="export the calibration again")
    rows = []
    for key in sorted(cameras, key=lambda name: (len(name), name)):
        row = cameras[key]
        if row.get("ignore") is True:
            continue
        for part in ("rotation", "translation"):
            if row.get(part, "null") == "null":
                raise CalibrationError(
                    f"camera {key} has no {part}", where=where, advice="finish the calibration of all cameras first"
                )
        rows.append({"name": f"cam_{key}", **row})
    return rows


def qualisys_rows(raw: bytes, where: str) -> list[dict[str, Any]]:
    """Return the camera tables of a Qualisys calibration.

    Raises:
        CalibrationError: The file is not a complete calibration.
    """
    check_kind(raw, where, "calibration", CalibrationError, "XML file")
    if len(raw) > 10_000_000 or b"<!ENTITY" in raw:
        raise CalibrationError("is not a Qualisys calibration", where=where, advice="export it again")
    with reading(where, CalibrationError, "export it again", "is not valid XML"):
        root = ElementTree.fromstring(raw)  # noqa: S314 - entities, which can expand without limit, are refused above
    cameras = root.findall("cameras/camera")
    if root.tag != "calibration":
        advice = "use a calibration from anipose, caliscope or Qualisys"
        raise CalibrationError(f"is another program's XML file (<{root.tag[:40]}>)", where=where, advice=advice)
    if not cameras:
        raise CalibrationError("is a Qualisys calibration that holds no cameras", where=where, advice="export it again")
    return [_qualisys_row(camera, where) for camera in cameras if camera.get("active", "1") != "0"]


def _qualisys_row(camera: ElementTree.Element, where: str) -> dict[str, Any]:
    name = camera.get("serial", "camera")
    place = f"{where}, camera {name}"
    view = _numbers(camera, "fov_video", ("left", "top", "right", "bottom"), place)
    lens = _numbers(
        camera, "intrinsic", ("focalLengthU", "focalLengthV", "centerPointU", "centerPointV", "skew"), place
    )
    fx, fy, cx, cy, skew = lens / 64.0
    shape = ("radialDistortion1", "radialDistortion2", "tangentalDistortion1", "tangentalDistortion2")
    axes = _numbers(camera, "transform", tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)), place).reshape(3, 3)
    centre_m = _numbers(camera, "transform", ("x", "y", "z"), place) / 1000.0
    rotation = _OPENCV_FROM_QUALISYS @ axes
    return {
        "name": name,
        "size": [int(view[2] - view[0]) + 1, int(view[3] - view[1]) + 1],
        "matrix": np.array([[fx, skew, cx - view[0]], [0.0, fy, cy - view[1]], [0.0, 0.0, 1.0]]),
        "distortions": np.append(
            _numbers(camera, "intrinsic", shape, place), _numbers(camera, "intrinsic", ("radialDistortion3",), place)
        ),
        "rotation": rotation,
        "translation": -rotation @ centre_m,
    }


def _numbers(camera: ElementTree.Element, tag: str, names: tuple[str, ...], place: str) -> Array:
    element = camera.find(tag)
    values = {} if element is None else element.attrib
    with reading(place, CalibrationError, "export the calibration again", f"<{tag}> is incomplete"):
        return np.array([float(values[name]) for name in names])


def level_from_world(rotations: Array) -> Array:
    """Return the level-from-world rotation (3, 3) to a world with y up.

    Programs differ in which axis points up. Cameras are usually mounted upright, which shows the axis; if they
    disagree, the world is left as it is.
    """
    up = -rotations[:, 1].mean(axis=0)
    axis = int(np.argmax(np.abs(up)))
    if abs(up[axis]) < 0.6 or (axis == 1 and up[axis] > 0.0):
        return np.eye(3)
    if axis == 1:
        return np.diag([1.0, -1.0, -1.0])
    sign = float(np.sign(up[axis]))
    turn = np.eye(3)
    if axis == 2:  # x is unchanged
        turn[1:, 1:] = [[0.0, sign], [-sign, 0.0]]
    else:  # z is unchanged
        turn[:2, :2] = [[0.0, -sign], [sign, 0.0]]
    return turn
