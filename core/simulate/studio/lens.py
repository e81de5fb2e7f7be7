"""Undistorted coordinates of pixel grids."""

import numpy as np

from ...geometry.arrays import Array
from ...geometry.camera import Camera
from ...geometry.cubic_curves import cubic_spline


def undistorted_grid(camera: Camera, xs: Array, ys: Array) -> Array:
    """Return undistorted coordinates (len(ys), len(xs), 2) of a grid of pixels; `xs` and `ys` ascend.

    The lens is inverted at every eighth pixel, with cubic splines in between: accurate to about 1e-5 pixels, and many
    times faster than inverting it at every pixel.
    """
    nodes_x, nodes_y = _nodes(xs), _nodes(ys)
    coarse = camera.undistort(np.stack(np.meshgrid(nodes_x, nodes_y), axis=-1))
    rows = cubic_spline(nodes_y, coarse, ys)
    return cubic_spline(nodes_x, rows.swapaxes(0, 1), xs).swapaxes(0, 1)


def _nodes(values: Array) -> Array:
    count = max(int(np.ceil((values[-1] - values[0]) / 8.0)) + 1, 4)
    return np.linspace(values[0] - 1.0, values[-1] + 1.0, count)
