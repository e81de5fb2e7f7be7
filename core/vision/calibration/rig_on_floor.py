"""Floor, origin and axes of the world, set from points or a board on the floor."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import cv2
import numpy as np
from numpy.typing import ArrayLike

from ...errors import CalibrationError, counted
from ...geometry.arrays import Array
from ...geometry.camera import Camera, CameraRig
from ...geometry.rigid_transform import principal_axes
from ...geometry.triangulation import triangulate
from .calibration_board import Board, BoardView


def rig_on_floor(rig: CameraRig, floor_points_m: ArrayLike, behind_m: float = 0.0, above_m: float = 0.0) -> CameraRig:
    """Return the rig in a world with the floor at y = 0, z towards the cameras and x to the performer's left.

    Args:
        floor_points_m: Points (N, 3) of the floor in the rig's current world, N >= 3, not on a line.
        behind_m: Distance from the centre of the points to the origin, away from the cameras.
        above_m: Height of the points above the floor, such as the radius of spherical markers lying on it.

    Raises:
        CalibrationError: The points do not determine a plane, or the cameras look straight down on them.
    """
    points = np.asarray(floor_points_m, dtype=np.float64)
    if len(points) < 3:
        raise CalibrationError(
            "at least three points are needed to find the floor", advice="lay the board on the floor"
        )
    middle, sizes, axes = principal_axes(points)
    if sizes[2] / np.sqrt(len(points)) > 0.01 or sizes[1] < 1e-3 * sizes[0]:  # 1 cm off a plane, or on a line
        raise CalibrationError(
            "the points on the floor do not determine a plane",
            advice="lay the board or the markers flat on level ground, not on one line",
        )
    centre = np.mean([camera.centre_m for camera in rig.cameras], axis=0)
    to_cameras = centre - middle
    up = axes[2] if axes[2] @ to_cameras > 0 else -axes[2]
    forward = to_cameras - up * (up @ to_cameras)
    if np.linalg.norm(forward) < 0.05:
        what = (
            "the cameras look straight down at the middle of the points on the floor, so there is no forward direction"
        )
        raise CalibrationError(what, advice="lay the board or the markers farther in front of the cameras")
    forward /= np.linalg.norm(forward)
    new_from_old = np.stack((np.cross(up, forward), up, forward))
    origin = middle - behind_m * forward - above_m * up
    cameras = []
    for camera in rig.cameras:
        rotation, translation = camera.rotation @ new_from_old.T, camera.translation_m + camera.rotation @ origin
        cameras.append(replace(camera, rotation=rotation, translation_m=translation))
    return CameraRig(tuple(cameras), dict(rig.metadata) | {"floor": "y = 0"})


def board_in_space(rig: CameraRig, views: Sequence[BoardView], board: Board) -> Array:
    """Return a board's corners (N, 3) in the rig's world from one moment of all cameras.

    Views of a chessboard, which may be numbered from either end, are ordered so that they agree best.

    Raises:
        CalibrationError: There is not one view per camera, a view shows only part of the board, or the views disagree.
    """
    if len(views) != len(rig):
        raise CalibrationError(
            f"the calibration is for {counted(len(rig), 'camera')}, but the images are from {len(views)}",
            advice="calibrate these cameras",
        )
    if any(len(view.ids) != len(board.points_m) for view in views):
        raise CalibrationError("not all cameras see the whole board", advice="lay it where all of them do")
    if len(views) == 1:
        return _seen_by_one(rig.cameras[0], views[0], board)
    orders = [(view, view.reverse()) if board.is_ambiguous and index else (view,) for index, view in enumerate(views)]
    best, least = np.zeros((0, 3)), np.inf
    for ordered in product(*orders):
        seen = [camera.undistort(view.pixels) for camera, view in zip(rig.cameras, ordered, strict=True)]
        weights = np.ones((len(board.points_m), len(views)))
        points, _, errors = triangulate(rig.cameras, np.stack(seen, axis=1), weights, 1.0)
        error = float(np.sqrt(np.mean(errors**2)))
        if error < least:
            best, least = points, error
    if not least < 3.0 / 640.0 * rig.cameras[0].image_size[0]:
        raise CalibrationError(
            f"the cameras do not agree on where the board is ({least:.1f} px)", advice="calibrate the cameras again"
        )
    return best


def _seen_by_one(camera: Camera, view: BoardView, board: Board) -> Array:
    normalised = camera.undistort(view.pixels)
    found, turn, shift = cv2.solvePnP(board.points_m, normalised, np.eye(3), np.zeros(5), flags=cv2.SOLVEPNP_IPPE)
    if not found:
        raise CalibrationError(
            "the board's position cannot be found in this picture", advice="lay the board closer to the camera"
        )
    local = board.points_m @ cv2.Rodrigues(turn)[0].T + np.ravel(shift)
    return np.asarray((local - camera.translation_m) @ camera.rotation)
