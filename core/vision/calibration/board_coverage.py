"""Board views of each camera, and the covered parts of its image."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from ...geometry.arrays import Array, Image, Mask
from ...geometry.camera import Camera, CameraRig
from .board_quality import edge_widths
from .board_watch import BoardPlacement, placement_of
from .calibration_board import Board, BoardView

REGIONS = 3  # of an image, each way
ENOUGH_COVERED = 0.45  # of the part of an image that all cameras can see together
_CELLS = (24, 18)  # of an image, across and down
_TOO_FEW_CELLS = 0.3  # of a region within reach: guidance leaves it out
_WIDEST = 1.2  # normalised coordinates further out are not of this lens


@dataclass
class CameraCoverage:
    """Views taken by one camera, and the cells of its image that the board covered."""

    name: str
    title: str
    size: tuple[int, int]
    covered: Mask = field(default_factory=lambda: np.zeros(_CELLS[::-1], dtype=bool))
    reachable: Mask = field(default_factory=lambda: np.ones(_CELLS[::-1], dtype=bool))
    views: dict[str, BoardView] = field(default_factory=dict)
    placements: list[BoardPlacement] = field(default_factory=list)
    widths_px: list[tuple[float, float]] = field(default_factory=list)

    def add(self, key: str, image: Image, board: Board, view: BoardView) -> None:
        """Add a view."""
        self.views[key] = view
        self.placements.append(placement_of(view, board, self.size))
        self.widths_px.append(edge_widths(image, board, view))
        scale = np.array(_CELLS) / np.array(self.size)
        cells = np.zeros(_CELLS[::-1], dtype=np.uint8)
        hull = cv2.convexHull(np.round((view.pixels + 0.5) * scale - 0.5).astype(np.int32).reshape(-1, 1, 2))
        cv2.fillConvexPoly(cells, hull, (1.0,))
        self.covered |= cells > 0

    @property
    def fraction(self) -> float:
        """Covered share of the reachable cells."""
        return float((self.covered & self.reachable).sum() / max(self.reachable.sum(), 1))

    def region_fractions(self) -> Array:
        """Return the covered share of regions (REGIONS, REGIONS), NaN out of reach."""
        rows, columns = _CELLS[1] // REGIONS, _CELLS[0] // REGIONS
        shape = (REGIONS, rows, REGIONS, columns)
        reachable = self.reachable.reshape(shape).sum(axis=(1, 3))
        covered = (self.covered & self.reachable).reshape(shape).sum(axis=(1, 3))
        return np.where(reachable < _TOO_FEW_CELLS * rows * columns, np.nan, covered / np.maximum(reachable, 1))


def least_covered(cameras: Sequence[CameraCoverage]) -> float:
    """Return the covered fraction of the camera with the least; 0 without cameras."""
    return min((camera.fraction for camera in cameras), default=0.0)


def update_reachable(cameras: Sequence[CameraCoverage], rig: CameraRig, board: Board) -> None:
    """Mark per camera the cells where other cameras see the board as well."""
    columns, rows = board.corner_grid
    side_m = float(np.sqrt((columns - 1) * (rows - 1))) * board.square_m
    for seen, camera in zip(cameras, rig.cameras, strict=True):
        width, height = camera.image_size
        x, y = (np.arange(cells) + 0.5 for cells in _CELLS)
        pixels = np.stack(np.meshgrid(x * width / _CELLS[0], y * height / _CELLS[1]), axis=-1) - 0.5
        rays = camera.rays(camera.undistort(pixels))
        sizes = [placement.size * width for placement in seen.placements]
        mask = np.zeros(_CELLS[::-1], dtype=bool)
        for distance_m in camera.focal_px * side_m / np.array([min(sizes), float(np.median(sizes)), max(sizes)]):
            points = camera.centre_m + distance_m * rays
            mask |= np.all([_in_image(other, points) for other in rig.cameras if other is not camera], axis=0)
        seen.reachable = mask


def _in_image(camera: Camera, points_m: Array) -> Mask:
    local = camera.to_camera(points_m)
    ahead = (local[..., 2] > 0.0) & (np.abs(local[..., :2]) < _WIDEST * local[..., 2:]).all(axis=-1)
    pixels = camera.project(points_m)
    inside = (pixels > -0.5) & (pixels < np.array(camera.image_size) - 0.5)
    return np.asarray(ahead & inside.all(axis=-1))
