"""Board points found by another program, read from JSON."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import CalibrationError, counted
from ...geometry.arrays import Array
from ...system.files import read_bytes, reading
from .calibration_board import BoardView
from .rig_fit import CameraViews

_LAYOUT = (
    "image_size [w, h], board_points_mm [[x, y], ...], image_points_cam1 and image_points_cam2 [[[u, v], ...], ...]"
)


def load_board_points(path: str | Path) -> tuple[Array, tuple[CameraViews, CameraViews]]:
    """Return board points (N, 3) in metres and views of the left and right camera.

    The file contains `image_size`, `board_points_mm` (N, 2), and `image_points_cam1` and `image_points_cam2`: for each
    moment, a list of N pixel positions (the first pixel is 0; null where the point is not seen).

    Raises:
        CalibrationError: The file does not have these contents.
    """
    raw = read_bytes(path)
    with reading(path, CalibrationError, f"expected {_LAYOUT}", "does not contain board points"):
        content = json.loads(raw)
        size = (int(content["image_size"][0]), int(content["image_size"][1]))
        flat = np.asarray(content["board_points_mm"], dtype=np.float64).reshape(len(content["board_points_mm"]), -1)
        points = np.zeros((len(flat), 3))
        points[:, :2] = flat[:, :2] / 1000.0
        left = _views(content["image_points_cam1"], len(points))
        right = _views(content["image_points_cam2"], len(points))
    if np.ptp(points[:, :2], axis=0).min() <= 0.0:
        what, advice = "the board's points lie on one line or in one place", "export all points of the board"
        raise CalibrationError(what, where=str(path), advice=advice)
    return points, (CameraViews("left", size, left), CameraViews("right", size, right))


def _views(moments: list[Any], count: int) -> dict[str, BoardView]:
    views = {}
    for i, pixels in enumerate(moments):
        rows = [(np.nan, np.nan) if pixel is None else pixel for pixel in pixels]
        table = np.asarray(rows, dtype=np.float64).reshape(-1, 2)
        if len(table) != count:
            raise ValueError(f"moment {i + 1} has {counted(len(table), 'point')}, but the board has {count}")
        seen = np.flatnonzero(np.isfinite(table).all(axis=1))
        if len(seen) >= 6:
            views[f"{i + 1:06d}"] = BoardView(seen, table[seen])
    return views
