"""Calibrate the simulated cameras as a user calibrates real ones, floor included."""

from typing import Any

import numpy as np

from ..errors import CaptureError
from ..geometry.camera import CameraRig
from ..geometry.triangulation import triangulate
from ..vision.calibration.calibrate import CalibrationResult, calibrate_from_points
from ..vision.calibration.calibration_board import find_board
from ..vision.calibration.rig_fit import CameraViews
from ..vision.calibration.rig_on_floor import rig_on_floor
from .studio.boards import DEFAULT_BOARD, board_on_floor, board_pictures, draw_board
from .studio.simulated_source import SimulatedSource

_BOARD_VIEWS = 24


def calibrate_studio(source: SimulatedSource) -> CalibrationResult:
    """Return the cameras calibrated from their pictures of the board."""
    board = DEFAULT_BOARD
    names = [camera.name for camera in source.rig.cameras]
    views: list[dict[str, Any]] = [{} for _ in names]
    for picture in board_pictures(source.renderer, board, _BOARD_VIEWS):
        for i, image in enumerate(picture.images):
            view = find_board(image, board)
            if view is not None:
                views[i][f"{picture.number:06d}"] = view
    sizes = [camera.image_size for camera in source.rig.cameras]
    cameras = [CameraViews(name, size, seen) for name, size, seen in zip(names, sizes, views, strict=True)]
    return calibrate_from_points(board.points_m, cameras)


def studio_on_floor(rig: CameraRig, source: SimulatedSource) -> CameraRig:
    """Return the cameras with the world on the floor, from one board picture each.

    Raises:
        CaptureError: a camera does not show the board.
    """
    board = DEFAULT_BOARD
    pose, before_m = board_on_floor(board)
    corners = []
    for i, camera in enumerate(source.rig.cameras):
        image = source.renderer.lit_room(i)
        draw_board(image, camera, board, pose)
        source.renderer.add_noise(image, i, 0)
        view = find_board(image, board)
        if view is None:
            raise CaptureError("the board on the floor was not found", where=f"camera {camera.name}")
        corners.append(rig.cameras[i].undistort(view.pixels))
    seen = np.stack(corners, axis=1)
    points, _, _ = triangulate(rig.cameras, seen, np.ones(seen.shape[:2]), 0.3)
    return rig_on_floor(rig, points, before_m)
