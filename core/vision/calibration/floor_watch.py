"""Floor and scale of the world, found from markers that lie on the floor."""

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ...errors import CalibrationError
from ...geometry.arrays import Array, IntArray
from ...geometry.camera import CameraRig
from ...geometry.rigid_transform import principal_axes


@dataclass(frozen=True)
class FloorSettings:
    """Conditions for taking markers to be on the floor."""

    fewest: int = 3  # number of points that determine a plane
    still_s: float = 1.0  # time for which the points must lie still
    least_moments: int = 5  # fewest observations in that time
    still_m: float = 0.01  # largest motion of a still point: more than noise far from the cameras, less than a step
    least_width_m: float = 0.2  # smallest extent perpendicular to the longest line through the markers


FLOOR = FloorSettings()


class FloorWatch:
    """Observation of triangulated points until they can be taken for markers that lie still on the floor.

    Attributes:
        advice: Next step; "" once `points_m` is known.
        points_m: Mean positions (N, 3) of the markers while they lay still; None until then.
    """

    def __init__(self) -> None:
        self.advice = f"lay {FLOOR.fewest} or more markers on the floor"
        self.points_m: Array | None = None
        self._past: deque[tuple[float, Array]] = deque()

    def see(self, time_s: float, points_m: Array) -> None:
        """Process the points (N, 3) of a moment."""
        if len(points_m) < FLOOR.fewest:
            self._past.clear()
            seen = f"; {len(points_m)} located" if len(points_m) else ""
            self.advice = f"lay {FLOOR.fewest} or more markers on the floor, where both cameras see them{seen}"
            return
        if self._past:
            order = _as_before(self._past[0][1], points_m)
            if order is None:
                self._past.clear()
            else:
                points_m = points_m[order]
        self._past.append((time_s, points_m))
        if len(self._past) < FLOOR.least_moments or time_s - self._past[0][0] < FLOOR.still_s:
            self.advice = "let them lie still"
            return
        mean = np.mean([points for _, points in self._past], axis=0)
        middle, _, axes = principal_axes(mean)
        if np.ptp((mean - middle) @ axes[1]) < FLOOR.least_width_m:
            self._past.clear()
            self.advice = "lay them further apart, not on one line"
            return
        self.advice, self.points_m = "", mean


def _as_before(before_m: Array, points_m: Array) -> IntArray | None:
    """Return the indices (N,) that sort points as before; None if their number has changed or one has moved."""
    if len(points_m) != len(before_m):
        return None
    apart = np.linalg.norm(before_m[:, None] - points_m[None], axis=2)
    order = np.argmin(apart, axis=1)
    unmoved = apart[np.arange(len(order)), order] < FLOOR.still_m
    return order if np.all(unmoved) and len(np.unique(order)) == len(order) else None


def scaled_to(rig: CameraRig, points_m: ArrayLike, longest_m: float) -> tuple[CameraRig, Array, float]:
    """Return rig and points (N, 3), scaled until the largest distance between points is `longest_m`, and the factor."""
    if not 0.0 < longest_m < np.inf:
        raise CalibrationError(f"markers cannot be {longest_m:g} m apart", advice="measure from centre to centre")
    points = np.asarray(points_m, dtype=np.float64)
    factor = longest_m / float(np.linalg.norm(points[:, None] - points, axis=-1).max())
    cameras = tuple(replace(camera, translation_m=camera.translation_m * factor) for camera in rig.cameras)
    return replace(rig, cameras=cameras), points * factor, factor
