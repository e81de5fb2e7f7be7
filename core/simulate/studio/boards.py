"""Calibration boards in front of the simulated cameras."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import repeat

import cv2
import numpy as np

from ...errors import SettingsError
from ...geometry import rotations as rot
from ...geometry.arrays import Array, FloatArray, Image
from ...geometry.camera import Camera, CameraRig
from ...vision.calibration.calibration_board import Board, charuco_board
from ...vision.sources.image_set import ClosableSource, ImageSet
from .lens import undistorted_grid
from .render import Renderer
from .studio_rig import looking_at

DEFAULT_BOARD = Board("chessboard", 9, 6, 0.08)
_FIRST_NUMBER = 10_000_000  # first frame number of board pictures; no performance is that long


@dataclass(frozen=True)
class BoardSettings:
    """Settings for placing and drawing boards."""

    candidates: int = 600  # number of random poses from which the best are chosen
    samples: int = 4  # samples per pixel along each axis
    rim: float = 1.7  # distance from the outer corners to the edge of the paper, in squares
    cell_px: int = 64  # side of the image regions that board positions should cover
    print_px: int = 120  # side of a printed ChArUco square; with the common marker sizes, code cells are whole pixels


_SETTINGS = BoardSettings()


@dataclass(frozen=True)
class BoardPose:
    """Pose of a board: p_world = world_from_board @ p_board + position_m."""

    world_from_board: Array
    position_m: Array

    def points(self, board_points_m: Array) -> Array:
        """Return points (..., 3) of the board in world axes."""
        return np.asarray(board_points_m @ self.world_from_board.T + self.position_m)


@dataclass(frozen=True)
class BoardPicture:
    """Images of a board in one position, and its true corners (C, K, 2), pixels."""

    number: int
    pose: BoardPose
    images: tuple[Image, ...]
    corners: Array


def board_poses(rig: CameraRig, board: Board, count: int) -> tuple[BoardPose, ...]:
    """Return poses of a tilted board that all cameras see whole.

    Each is the random candidate that best covers the image regions that earlier ones have covered least.

    Raises:
        SettingsError: There is no pose in which all cameras see the board.
    """
    rng = np.random.default_rng([0, 4])
    focus = _focus(rig)
    candidates = []
    for _ in range(_SETTINGS.candidates):
        pose = _candidate(rig, board, focus, rng)
        cells = _covered(rig, board, pose)
        if cells is not None:
            candidates.append((pose, cells))
    if not candidates:
        raise SettingsError("nowhere in the room do all cameras see the whole board", advice="use a smaller board")
    visits = np.zeros(len(candidates[0][1]))
    chosen = []
    for _ in range(min(count, len(candidates))):
        gains = [float((cells / (1.0 + visits) ** 2).sum() / cells.sum() ** 0.5) for _, cells in candidates]
        pose, cells = candidates.pop(int(np.argmax(gains)))
        visits += cells
        chosen.append(pose)
    return tuple(chosen)


def board_pictures(renderer: Renderer, board: Board = DEFAULT_BOARD, count: int = 24) -> Iterator[BoardPicture]:
    """Yield `count` pictures of the board, with the true corners."""
    for number, pose in enumerate(board_poses(renderer.rig, board, count)):
        images = _with_noise(renderer, _drawn(renderer, board, pose), number)
        corners = np.array([camera.project(pose.points(board.points_m)) for camera in renderer.rig.cameras])
        yield BoardPicture(number, pose, images, corners)


def _drawn(renderer: Renderer, board: Board, pose: BoardPose, samples: int = _SETTINGS.samples) -> list[Image]:
    """Return each camera's image of the room with a board, without noise."""
    images = [renderer.lit_room(i) for i in range(len(renderer.rig))]
    for image, camera in zip(images, renderer.rig.cameras, strict=True):
        draw_board(image, camera, board, pose, samples)
    return images


def _with_noise(renderer: Renderer, drawn: Sequence[Image], number: int) -> tuple[Image, ...]:
    images = tuple(image.copy() for image in drawn)
    for i, image in enumerate(images):
        renderer.add_noise(image, i, _FIRST_NUMBER + number)
    return images


def board_on_floor(board: Board = DEFAULT_BOARD) -> tuple[BoardPose, float]:
    """Return the pose of a board on the floor and its distance from the origin, metres."""
    # at this distance, all cameras see the whole board
    flat, before_m = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), 0.6
    return BoardPose(flat, [0.0, 0.0, before_m] - flat @ board.points_m.mean(axis=0)), before_m


class CarriedBoard(ClosableSource):
    """Image source of a board that is carried around and held still for six images in each position."""

    def __init__(self, renderer: Renderer, board: Board, poses: Sequence[BoardPose]) -> None:
        self.fps = 8.0
        self._renderer = renderer
        self._board = board
        self._poses = tuple(poses)

    def __iter__(self) -> Iterator[ImageSet]:
        """Yield image sets until the board has been in all positions, or until `close`."""
        for number, drawn in enumerate(self._all_drawn()):
            if self._closed:
                return
            images = _with_noise(self._renderer, drawn, number)
            yield ImageSet(number, (number / self.fps,) * len(images), images)

    def _all_drawn(self) -> Iterator[list[Image]]:
        for number, pose in enumerate(self._poses):
            for step in (1, 2, 3) if number else ():
                yield _drawn(self._renderer, self._board, _between(self._poses[number - 1], pose, step / 4), 2)
            yield from repeat(_drawn(self._renderer, self._board, pose), 6)


def _between(start: BoardPose, end: BoardPose, f: float) -> BoardPose:
    a, b = (rot.from_matrix(pose.world_from_board) for pose in (start, end))
    turn = rot.slerp(a, b, np.asarray(f))
    return BoardPose(rot.to_matrix(turn), start.position_m + f * (end.position_m - start.position_m))


def draw_board(image: Image, camera: Camera, board: Board, pose: BoardPose, samples: int = _SETTINGS.samples) -> None:
    """Draw a board into an image, in place, with lens distortion, anti-aliasing and blur.

    Args:
        samples: Samples per pixel along each axis.
    """
    outline = camera.project(pose.points(_outline(board)))
    pad = 3
    low, high = np.floor(outline.min(axis=0)) - pad, np.ceil(outline.max(axis=0)) + pad
    left, top = max(int(low[0]), 0), max(int(low[1]), 0)
    right, bottom = min(int(high[0]) + 1, image.shape[1]), min(int(high[1]) + 1, image.shape[0])
    if left >= right or top >= bottom:
        return
    normalised = undistorted_grid(camera, _fine(left, right, samples), _fine(top, bottom, samples))
    camera_from_board = camera.rotation @ pose.world_from_board
    homography = np.column_stack((camera_from_board[:, :2], camera.to_camera(pose.position_m)))
    x, y, w = np.einsum(
        "ij,hwj->ihw", np.linalg.inv(homography), np.dstack((normalised, np.ones(normalised.shape[:2])))
    )
    paper, ink = (_shrunk(layer, bottom - top, right - left, samples) for layer in _pattern(board, x / w, y / w))
    light = 0.72 + 0.28 * abs(float(camera_from_board[2, 2]))
    value = light * (205.0 * (paper - ink) + 26.0 * ink)
    patch = image[top:bottom, left:right]
    patch[:] = np.clip(np.rint(patch * (1.0 - paper[..., None]) + value[..., None]), 0, 255).astype(np.uint8)


def _fine(start: int, stop: int, samples: int) -> Array:
    return np.asarray(start - 0.5 + (np.arange((stop - start) * samples) + 0.5) / samples)


def _pattern(board: Board, x: Array, y: Array) -> tuple[FloatArray, FloatArray]:
    """Return masks (0 or 1) of paper and of ink at positions on the board, metres."""
    column, row = x / board.square_m, y / board.square_m
    columns, rows = board.corner_grid
    paper = (
        (column > -_SETTINGS.rim)
        & (column < columns - 1 + _SETTINGS.rim)
        & (row > -_SETTINGS.rim)
        & (row < rows - 1 + _SETTINGS.rim)
    )
    squares = (column > -1.0) & (column < columns) & (row > -1.0) & (row < rows)
    if board.kind == "chessboard":
        dark = squares & ((np.floor(column) + np.floor(row)) % 2 == 0)
    else:
        printed = charuco_board(board).generateImage(
            (_SETTINGS.print_px * (columns + 1), _SETTINGS.print_px * (rows + 1))
        )
        across = np.clip(_SETTINGS.print_px * (column + 1.0), 0, printed.shape[1] - 1).astype(np.int64)
        down = np.clip(_SETTINGS.print_px * (row + 1.0), 0, printed.shape[0] - 1).astype(np.int64)
        dark = squares & (printed[down, across] < 128)
    return paper.astype(np.float32), dark.astype(np.float32)


def _shrunk(layer: FloatArray, height: int, width: int, samples: int) -> Array:
    blurred = cv2.GaussianBlur(layer, (0, 0), 0.5 * samples, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred.reshape(height, samples, width, samples).mean(axis=(1, 3)), dtype=np.float64)


def _outline(board: Board) -> Array:
    """Return points (N, 3) along the edge of the paper, metres."""
    low, high = np.array([-_SETTINGS.rim, -_SETTINGS.rim]), np.array(board.corner_grid) - 1 + _SETTINGS.rim
    f = np.linspace(0.0, 1.0, 12)[:, None]
    corners = [low, np.array([high[0], low[1]]), high, np.array([low[0], high[1]])]
    sides = [a + f * (b - a) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    flat = np.concatenate(sides) * board.square_m
    return np.column_stack((flat, np.zeros(len(flat))))


def _focus(rig: CameraRig) -> Array:
    """Return the point nearest to all optical axes."""
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for camera in rig.cameras:
        across = np.eye(3) - np.outer(camera.rotation[2], camera.rotation[2])
        normal += across
        right += across @ camera.centre_m
    # a small weight on a point 3 m ahead determines the point for parallel axes and for a single camera
    ahead = np.mean([camera.centre_m + 3.0 * camera.rotation[2] for camera in rig.cameras], axis=0)
    return np.linalg.solve(normal + 1e-3 * np.eye(3), right + 1e-3 * ahead)


def _candidate(rig: CameraRig, board: Board, focus: Array, rng: np.random.Generator) -> BoardPose:
    """Return a random board pose, turned roughly towards the cameras."""
    middle = np.mean([camera.centre_m for camera in rig.cameras], axis=0)
    place = focus + rng.uniform(-0.05, 0.62) * (middle - focus) + rng.uniform(-1.0, 1.0, 3) * (1.3, 1.0, 0.2)
    # board axes: x right, y down as the cameras see it, so its normal points away from them
    facing = looking_at(middle, place).T
    tilt = rot.to_matrix(rot.from_rotation_vector(rng.uniform(-1.0, 1.0, 3) * np.radians((38.0, 38.0, 25.0))))
    turn = facing @ tilt
    centre = np.array([board.columns - 1, board.rows - 1, 0.0]) * 0.5 * board.square_m
    return BoardPose(turn, place - turn @ centre)


def _covered(rig: CameraRig, board: Board, pose: BoardPose) -> Array | None:
    """Return a mask (0 or 1) of the image regions with corners; None unless all cameras see the whole board."""
    cells = []
    rim, corners = pose.points(_outline(board)), pose.points(board.points_m)
    for camera in rig.cameras:
        width, height = camera.image_size
        pixels = camera.project(rim)
        if not np.all((pixels > 2.0) & (pixels < np.array([width - 3.0, height - 3.0]))):
            return None
        towards = camera.centre_m - rim.mean(axis=0)
        if abs(float(towards @ pose.world_from_board[:, 2])) < 0.7 * float(np.linalg.norm(towards)):
            return None
        grid = np.zeros((height // _SETTINGS.cell_px + 1, width // _SETTINGS.cell_px + 1))
        index = (camera.project(corners) // _SETTINGS.cell_px).astype(int)
        grid[index[:, 1], index[:, 0]] = 1.0
        cells.append(grid.ravel())
    return np.concatenate(cells)
