"""Floor area where all cameras see a performer from head to foot."""

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, Mask
from ..geometry.camera import Camera, CameraRig

_STEP_M = 0.05
_PIECES = 12  # of a side of the outline
_REACH_M = 6.0  # from the middle between the cameras, to all sides
SMALLEST_PX = 1.5  # radius of a marker in the image: a smaller one has no exact centre
_FOLDED = 0.01  # a lens model folds directions far outside the image back into it, which moves them


@dataclass(frozen=True)
class CommonSpace:
    """Floor positions that all cameras see, on a grid in world metres.

    Args:
        x_m, z_m: (X,), (Z,) positions of the grid.
        seen: (Z, X) whether a performer who stands there is seen whole by all cameras.
        rectangle_m: least x, least z, greatest x and greatest z of the largest rectangle in it; zeros without one.
    """

    x_m: Array
    z_m: Array
    seen: Mask
    rectangle_m: tuple[float, float, float, float]

    @property
    def size_m(self) -> tuple[float, float]:
        """Width (x) and depth (z) of the rectangle."""
        left, back, right, front = self.rectangle_m
        return right - left, front - back

    @property
    def outline_m(self) -> Array:
        """(K, 3) closed line around the rectangle, on the floor; empty without one.

        It has many points, as lenses bend lines, and part of it may lie behind the viewer.
        """
        left, back, right, front = self.rectangle_m
        if min(self.size_m) <= 0.0:
            return np.empty((0, 3))
        corners = np.array([(left, 0.0, back), (right, 0.0, back), (right, 0.0, front), (left, 0.0, front)])
        along = np.linspace(0.0, 1.0, _PIECES, endpoint=False)[:, None]
        sides = [a + along * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
        return np.concatenate([*sides, corners[:1]])

    @property
    def text(self) -> str:
        """Size of the rectangle as a sentence."""
        width, depth = self.size_m
        if min(width, depth) <= 0.0:
            return "nowhere do all cameras see you from head to foot: move them back, or turn them to one place"
        return f"you may walk {width:.1f} x {depth:.1f} m"


def common_space(
    rig: CameraRig, height_m: float = 1.8, around_m: float = 0.35, marker_radius_m: float = 0.0125
) -> CommonSpace:
    """Return the floor where all cameras see a performer, large enough.

    Args:
        rig: its world has the floor at y = 0.
        height_m: of the performer, floor to head.
        around_m: room for arms and steps on each side.
    """
    middle = np.mean([camera.centre_m for camera in rig.cameras], axis=0)
    steps = np.arange(-_REACH_M, _REACH_M + 0.5 * _STEP_M, _STEP_M)
    x_m, z_m = middle[0] + steps, middle[2] + steps
    corners = [(x, y, z) for x in (-around_m, around_m) for y in (0.0, height_m) for z in (-around_m, around_m)]
    floor = np.stack((*np.meshgrid(x_m, z_m), np.zeros((len(z_m), len(x_m)))), axis=-1)[..., [0, 2, 1]]
    points = floor[..., None, :] + np.array(corners)
    farthest_m = marker_radius_m / SMALLEST_PX
    seen = np.all([_in_image(c, points, farthest_m * c.focal_px).all(axis=-1) for c in rig.cameras], axis=0)
    return CommonSpace(x_m, z_m, seen, _largest_rectangle(seen, x_m, z_m))


def _in_image(camera: Camera, points_m: Array, farthest_m: float) -> Mask:
    """Return (...) whether a camera's image shows points (..., 3) no farther away."""
    local = camera.to_camera(points_m)
    ahead = (local[..., 2] > 0.1) & (local[..., 2] < farthest_m)
    normalised = local[..., :2] / np.where(ahead, local[..., 2], 1.0)[..., None]
    pixels = camera.to_pixels(normalised)
    inside = ahead & np.all((pixels >= 0.0) & (pixels <= np.array(camera.image_size) - 1.0), axis=-1)
    back = camera.undistort(pixels[inside])
    inside[inside] = np.abs(back - normalised[inside]).max(axis=-1, initial=0.0) < _FOLDED
    return np.asarray(inside)


def _largest_rectangle(seen: Mask, x_m: Array, z_m: Array) -> tuple[float, float, float, float]:
    """Return the largest rectangle of seen cells, by histograms of open columns."""
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
