"""Board views of each camera, and the parts of its image that they cover."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ...geometry.arrays import Array, Image, Mask
from ...geometry.camera import CameraRig
from .board_quality import covered_cells, with_edge_widths
from .board_watch import GUIDANCE, BoardPlacement, placement_of
from .calibration_board import Board, BoardView

REGIONS = 3
"""Number of image regions, across and down, in which guidance asks for the board."""

_CELLS = (24, 18)  # number of cells across and down


@dataclass
class CameraCoverage:
    """Views taken by one camera, and the cells of its image that the board has covered."""

    name: str
    title: str
    size: tuple[int, int]
    covered: Mask = field(default_factory=lambda: np.zeros(_CELLS[::-1], dtype=bool))
    reachable: Mask = field(default_factory=lambda: np.ones(_CELLS[::-1], dtype=bool))
    views: dict[str, BoardView] = field(default_factory=dict)
    placements: list[BoardPlacement] = field(default_factory=list)

    def add(self, key: str, image: Image, board: Board, view: BoardView) -> None:
        """Add a view."""
        self.views[key] = with_edge_widths(view, image, board)
        self.placements.append(placement_of(view, board, self.size))
        self.covered |= covered_cells([view], self.size, _CELLS) > 0

    @property
    def fraction(self) -> float:
        """Covered share of the reachable cells."""
        return float((self.covered & self.reachable).sum() / max(self.reachable.sum(), 1))

    def region_fractions(self) -> Array:
        """Return the covered share (REGIONS, REGIONS) of each region's reachable cells, NaN if it has too few."""
        rows, columns = _CELLS[1] // REGIONS, _CELLS[0] // REGIONS
        shape = (REGIONS, rows, REGIONS, columns)
        reachable = self.reachable.reshape(shape).sum(axis=(1, 3))
        covered = (self.covered & self.reachable).reshape(shape).sum(axis=(1, 3))
        too_few = reachable < GUIDANCE.reachable_share * rows * columns
        return np.where(too_few, np.nan, covered / np.maximum(reachable, 1))


def least_covered(cameras: Sequence[CameraCoverage]) -> float:
    """Return the covered share of the camera with the least coverage; 0 without cameras."""
    return min((camera.fraction for camera in cameras), default=0.0)


def update_reachable(cameras: Sequence[CameraCoverage], rig: CameraRig, board: Board) -> None:
    """Mark the cells of each camera in which the other cameras see the board as well."""
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
            mask |= np.all([other.shows(points) for other in rig.cameras if other is not camera], axis=0)
        seen.reachable = mask
