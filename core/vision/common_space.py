"""Floor area in which all cameras see a performer from head to foot."""

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, Mask
from ..geometry.camera import CameraRig
from ..geometry.triangulation import depths


@dataclass(frozen=True)
class CommonSpace:
    """Floor positions that all cameras see, on a grid in the world."""

    x_m: Array  # (X,) coordinates of the grid's columns
    z_m: Array  # (Z,) coordinates of the grid's rows
    seen: Mask  # (Z, X) positions where all cameras see a whole performer
    # largest rectangle of seen positions: lowest x and z, highest x and z; zeros if there is none
    rectangle_m: tuple[float, float, float, float]
    sharper_m: tuple[float, float, float, float]  # the same with images of twice the resolution

    @property
    def size_m(self) -> tuple[float, float]:
        """Width (x) and depth (z) of the rectangle."""
        return _size_m(self.rectangle_m)

    @property
    def outline_m(self) -> Array:
        """Closed line (K, 3) around the rectangle, on the floor; empty if there is none.

        It has many points, because lenses bend lines and parts of the line may lie behind the viewer.
        """
        left, back, right, front = self.rectangle_m
        if min(self.size_m) <= 0.0:
            return np.empty((0, 3))
        corners = np.array([(left, 0.0, back), (right, 0.0, back), (right, 0.0, front), (left, 0.0, front)])
        along = np.linspace(0.0, 1.0, 12, endpoint=False)[:, None]
        sides = [a + along * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
        return np.concatenate([*sides, corners[:1]])

    @property
    def text(self) -> str:
        """Size of the rectangle as a sentence, and that with sharper images if it is at least twice as large."""
        width, depth = self.size_m
        if min(width, depth) <= 0.0:
            return "nowhere do all cameras see you from head to foot: move them back, or turn them to the same place"
        wider, deeper = _size_m(self.sharper_m)
        more = (
            f"; with images twice as wide {wider:.1f} x {deeper:.1f} m" if wider * deeper > 2.0 * width * depth else ""
        )
        return f"you may walk {width:.1f} x {depth:.1f} m{more}"


def common_space(
    rig: CameraRig,
    height_m: float = 1.8,
    around_m: float = 0.35,
    marker_radius_m: float = 0.0125,
    smallest_px: float = 1.5,
) -> CommonSpace:
    """Return the floor within 6 m of the cameras where all of them see a whole performer with large enough markers.

    Args:
        rig: Cameras in a world with the floor at y = 0.
        height_m: Height of the performer.
        around_m: Space for arms and steps on each side.
        smallest_px: Smallest radius of a marker in the image whose centre can be measured accurately.
    """
    middle = np.mean([camera.centre_m for camera in rig.cameras], axis=0)
    steps = np.linspace(-6.0, 6.0, 241)
    x_m, z_m = middle[0] + steps, middle[2] + steps
    corners = [(x, y, z) for x in (-around_m, around_m) for y in (0.0, height_m) for z in (-around_m, around_m)]
    floor = np.stack((*np.meshgrid(x_m, z_m), np.zeros((len(z_m), len(x_m)))), axis=-1)[..., [0, 2, 1]]
    points = floor[..., None, :] + np.array(corners)
    shown = np.all([camera.shows(points).all(axis=-1) for camera in rig.cameras], axis=0)
    far = np.max([depths(camera, points).max(axis=-1) / camera.focal_px for camera in rig.cameras], axis=0)
    space, sharper = (shown & (far < share * marker_radius_m / smallest_px) for share in (1.0, 2.0))
    return CommonSpace(x_m, z_m, space, _largest_rectangle(space, x_m, z_m), _largest_rectangle(sharper, x_m, z_m))


def _size_m(rectangle_m: tuple[float, float, float, float]) -> tuple[float, float]:
    left, back, right, front = rectangle_m
    return right - left, front - back


def _largest_rectangle(seen: Mask, x_m: Array, z_m: Array) -> tuple[float, float, float, float]:
    """Return the largest rectangle of seen cells, found in each row's histogram of seen cells above."""
    best, found = 0, (0.0, 0.0, 0.0, 0.0)
    heights = np.zeros(len(x_m) + 1, dtype=np.int64)
    for row in range(len(z_m)):
        heights[:-1] = np.where(seen[row], heights[:-1] + 1, 0)
        open_bars: list[tuple[int, int]] = []  # first column, height
        for column, height in enumerate(heights.tolist()):
            first = column
            while open_bars and open_bars[-1][1] >= height:
                first, tall = open_bars.pop()
                if tall * (column - first) > best:
                    best = tall * (column - first)
                    top = row - tall + 1
                    found = (float(x_m[first]), float(z_m[top]), float(x_m[column - 1]), float(z_m[row]))
            open_bars.append((first, height))
    return found
