"""The world's floor, and the scale, from markers that lie on the floor."""

from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import pdist

from ...errors import CalibrationError
from ...geometry.arrays import Array, IntArray
from ...geometry.camera import CameraRig
from ...geometry.rigid_transform import principal_axes

FEWEST = 3
STILL_S = 1.0
_LEAST_LOOKS = 5
_STILL_M = 0.01  # from one look to another: noise of a point far from the cameras, less than anybody's step
_LEAST_SPREAD_M = 0.2  # of the markers across their longest line: closer ones tell little of how the floor lies


class FloorWatch:
    """Watch of located points until they are still markers on the floor.

    Attributes:
        advice: next step in plain words; "" once `points_m` is known.
        points_m: (N, 3) mean positions of the markers over a second in which they lay still; None until then.
    """

    def __init__(self) -> None:
        self.advice = f"lay {FEWEST} or more markers on the floor"
        self.points_m: Array | None = None
        self._past: deque[tuple[float, Array]] = deque()

    def see(self, time_s: float, points_m: Array) -> None:
        """Take the points (N, 3) of a moment."""
        if len(points_m) < FEWEST:
            seen = f"; {len(points_m)} located" if len(points_m) else ""
            self._begin_again(f"lay {FEWEST} or more markers on the floor, where both cameras see them{seen}")
            return
        if self._past:
            order = _as_before(self._past[0][1], points_m)
            if order is None:
                self._begin_again("let them lie still")
            else:
                points_m = points_m[order]
        self._past.append((time_s, points_m))
        if len(self._past) < _LEAST_LOOKS or time_s - self._past[0][0] < STILL_S:
            self.advice = "let them lie still"
            return
        mean = np.mean([points for _, points in self._past], axis=0)
        if _thinnest_m(mean) < _LEAST_SPREAD_M:
            self._begin_again("lay them further apart, not on one line")
            return
        self.advice, self.points_m = "", mean

    def _begin_again(self, advice: str) -> None:
        self._past.clear()
        self.advice = advice


def _as_before(before_m: Array, points_m: Array) -> IntArray | None:
    """Return the order (N,) of points as before; None when they changed or moved."""
    if len(points_m) != len(before_m):
        return None
    apart = np.linalg.norm(before_m[:, None] - points_m[None], axis=2)
    order = np.argmin(apart, axis=1)
    unmoved = apart[np.arange(len(order)), order] < _STILL_M
    return order if np.all(unmoved) and len(np.unique(order)) == len(order) else None


def _thinnest_m(points_m: Array) -> float:
    """Return how wide points (N, 3) are across the longest line through them."""
    middle, _, axes = principal_axes(points_m)
    across = (points_m - middle) @ axes[1]
    return float(across.max() - across.min())


def scaled_to(rig: CameraRig, points_m: ArrayLike, longest_m: float) -> tuple[CameraRig, Array, float]:
    """Return rig and points (N, 3), scaled to a longest distance of `longest_m`.

    The third value is the factor.

    Raises:
        CalibrationError: no positive distance is given.
    """
    if not 0.0 < longest_m < np.inf:
        raise CalibrationError(
            f"{longest_m:g} m is no distance between markers", advice="measure from middle to middle"
        )
    points = np.asarray(points_m, dtype=np.float64)
    factor = longest_m / float(pdist(points).max())
    cameras = tuple(replace(camera, translation_m=camera.translation_m * factor) for camera in rig.cameras)
    return replace(rig, cameras=cameras), points * factor, factor
