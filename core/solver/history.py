"""Where the markers were a moment before, of the performer and of every database frame.

One moment's markers leave open what the next shows: whether a foot in the air is lifted or set down, how fast an arm
swings. Earlier markers in the frame of the present root hold the motion of the limbs and of the whole body, whatever
the rate of the cameras, and need no pose that was solved before.
"""

from bisect import bisect_left

import numpy as np
from numpy.typing import NDArray

from .. import rotations as rot
from ..database.store import Database
from .subject_model import RootPose

Array = NDArray[np.float64]
FloatArray = NDArray[np.float32]
IntArray = NDArray[np.int64]

_TOLERANCE = 0.3  # of the time looked back: how far off a remembered moment may be and still stand for it


class MarkerHistory:
    """Earlier markers in the frame of the present root.

    Args:
        database: gives clips, roots and rate.
        markers_m: (F, M, 3) the subject's markers of the database frames with the root at rest.
        lags_s: ascending times looked back.
    """

    def __init__(self, database: Database, markers_m: FloatArray, lags_s: tuple[float, ...]) -> None:
        self._markers = markers_m
        self._root_matrices = rot.to_matrix(database.root_rotations).astype(np.float32)
        self._root_positions_m = database.root_positions_m
        self._lags_s = lags_s
        self._lags = np.array([max(1, round(lag * database.fps)) for lag in lags_s], dtype=np.int64)
        self._starts = np.array([clip.start for clip in database.clips])[database.clip_of_frame]
        self.reset()

    def reset(self) -> None:
        """Forget what was seen."""
        self._times_s: list[float] = []
        self._points: list[Array] = []

    def continue_from(self, other: "MarkerHistory") -> None:
        """Take over what another saw."""
        self._times_s, self._points = other._times_s.copy(), other._points.copy()

    def remember(self, time_s: float, points_m: Array) -> None:
        """Keep the markers (M, 3) in the world, NaN where not located, seen at a time."""
        if self._times_s and time_s <= self._times_s[-1]:  # a recording that starts again: another moment's past
            self.reset()
        self._times_s.append(time_s)
        self._points.append(points_m)
        forgotten = bisect_left(self._times_s, time_s - 2.0 * self._lags_s[-1])
        del self._times_s[:forgotten], self._points[:forgotten]

    def observed(self, time_s: float, root: RootPose) -> Array:
        """Return where the markers were before a time, (L, M, 3) in the frame of the root, NaN where unknown."""
        result = np.full((len(self._lags_s), *self._markers.shape[1:]), np.nan)
        for row, lag in zip(result, self._lags_s, strict=True):
            moment = time_s - lag
            after = bisect_left(self._times_s, moment)
            near = [i for i in (after - 1, after) if 0 <= i < len(self._times_s)]
            closest = min(near, key=lambda i: abs(self._times_s[i] - moment), default=None)
            if closest is not None and abs(self._times_s[closest] - moment) <= _TOLERANCE * lag:
                row[:] = root.to_root_frame(self._points[closest])
        return result

    def of_frames(self, frames: IntArray) -> FloatArray:
        """Return the same for database frames (K,), (K, L, M, 3); before its first frame a clip stood still."""
        earlier = np.maximum(frames[:, None] - self._lags, self._starts[frames][:, None])
        back = self._root_matrices[frames]
        # row vectors: p R is R^T p, from the world into the root's frame
        turns = np.swapaxes(self._root_matrices[earlier], -1, -2) @ back[:, None]
        shifts = (self._root_positions_m[earlier] - self._root_positions_m[frames][:, None])[:, :, None] @ back[:, None]
        return np.asarray(self._markers[earlier] @ turns + shifts)
