"""Calibration of the simulated cameras in the way a user calibrates real ones, including the floor."""

import numpy as np

from ..errors import CaptureError
from ..geometry.camera import CameraRig
from ..geometry.triangulation import triangulate
from ..vision.calibration.calibrate import CalibrationResult, calibrate_from_points
from ..vision.calibration.calibration_board import Board, BoardView, find_board
from ..vision.calibration.rig_fit import CameraViews
from ..vision.calibration.rig_on_floor import rig_on_floor
from .studio.boards import DEFAULT_BOARD, board_on_floor, board_pictures, draw_board
from .studio.render import Renderer
from .studio.simulated_source import SimulatedSource


def views_of_board(renderer: Renderer, board: Board, count: int) -> dict[str, dict[str, BoardView]]:
    """Return each camera's views of a board in `count` positions, by position number."""
    views: dict[str, dict[str, BoardView]] = {camera.name: {} for camera in renderer.rig.cameras}
    for picture in board_pictures(renderer, board, count):
        for seen, image in zip(views.values(), picture.images, strict=True):
            view = find_board(image, board)
            if view is not None:
                seen[f"{picture.number:06d}"] = view
    return views


def calibrate_studio(source: SimulatedSource, pictures: int = 24) -> CalibrationResult:
    """Return the calibration of the cameras from `pictures` board pictures per camera."""
    views = views_of_board(source.renderer, DEFAULT_BOARD, pictures)
    cameras = [CameraViews(camera.name, camera.image_size, views[camera.name]) for camera in source.rig.cameras]
    return calibrate_from_points(DEFAULT_BOARD.points_m, cameras)


def studio_on_floor(rig: CameraRig, source: SimulatedSource) -> CameraRig:
    """Return the rig in a world with the floor at y = 0, found from one picture of the board per camera.

    Raises:
        CaptureError: The board is not found in a camera's picture.
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
            what, advice = "the board on the floor was not found", "use cameras that see the whole board"
            raise CaptureError(what, where=f"camera {camera.name}", advice=advice)
        corners.append(rig.cameras[i].undistort(view.pixels))
    seen = np.stack(corners, axis=1)
    points, _, _ = triangulate(rig.cameras, seen, np.ones(seen.shape[:2]), 0.3)
    return rig_on_floor(rig, points, before_m)
