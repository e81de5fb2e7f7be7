"""What was a moment before, of the performer and of every database frame: where the markers were, and the pose.

One moment's markers leave open what the next shows: whether a foot in the air is lifted or set down, how fast an arm
swings. Earlier markers in the frame of the present root hold the motion of the limbs and of the whole body, whatever
the rate of the cameras, and need no pose that was solved before. Earlier poses hold what markers never show, such as
the twist of an arm, as far as it was solved.
"""

from bisect import bisect_left

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import sgemm

from ..database.store import Database
from ..geometry import rotations as rot
from .subject_model import RootPose

Array = NDArray[np.float64]
FloatArray = NDArray[np.float32]
IntArray = NDArray[np.int64]

_TOLERANCE = 0.3  # of the time looked back: how far off a remembered moment may be and still stand for it


class Past:
    """Arrays and the times that they belong to, as far back as is looked.

    Args:
        lags_s: ascending times looked back.
    """

    def __init__(self, lags_s: tuple[float, ...]) -> None:
        self._lags_s = lags_s
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._times_s: list[float] = []
        self._values: list[Array] = []

    def continue_from(self, other: "Past") -> None:
        """Take over what another remembers."""
        self._times_s, self._values = other._times_s.copy(), other._values.copy()

    def remember(self, time_s: float, value: Array) -> None:
        """Keep what was at a time."""
        if self._times_s and time_s <= self._times_s[-1]:  # a recording that starts again: another moment's past
            self.reset()
        self._times_s.append(time_s)
        self._values.append(value)
        forgotten = bisect_left(self._times_s, time_s - 2.0 * self._lags_s[-1])
        del self._times_s[:forgotten], self._values[:forgotten]

    def before(self, time_s: float) -> list[Array | None]:
        """Return, for every time looked back, what was then, None where unknown."""
        return [self._near(time_s - lag, _TOLERANCE * lag) for lag in self._lags_s]

    def _near(self, moment_s: float, tolerance_s: float) -> Array | None:
        after = bisect_left(self._times_s, moment_s)
        near = [i for i in (after - 1, after) if 0 <= i < len(self._times_s)]
        closest = min(near, key=lambda i: abs(self._times_s[i] - moment_s), default=None)
        if closest is None or abs(self._times_s[closest] - moment_s) > tolerance_s:
            return None
        return self._values[closest]


class EarlierFrames:
    """Database frames a while before others of the same clip.

    Args:
        database: gives clips and rate.
        lags_s: times looked back.
    """

    def __init__(self, database: Database, lags_s: tuple[float, ...]) -> None:
        self._lags = np.array([max(1, round(lag * database.fps)) for lag in lags_s], dtype=np.int64)
        self._starts = np.array([clip.start for clip in database.clips])[database.clip_of_frame]

    def of(self, frames: IntArray) -> IntArray:
        """Return (K, L) frames before those (K,); before its first frame a clip stood still."""
        return np.asarray(np.maximum(frames[:, None] - self._lags, self._starts[frames][:, None]))


class MarkerHistory(Past):
    """Earlier markers (M, 3), NaN where not located, in the frame of the present root.

    Args:
        database: gives clips, roots and rate.
        markers_m: (F, M, 3) the subject's markers of the database frames with the root at rest.
        lags_s: ascending times looked back.
    """

    def __init__(self, database: Database, markers_m: FloatArray, lags_s: tuple[float, ...]) -> None:
        super().__init__(lags_s)
        self._markers = markers_m
        self._root_matrices = rot.to_matrix(database.root_rotations).astype(np.float32)
        self._root_positions_m = database.root_positions_m
        self._earlier = EarlierFrames(database, lags_s)

    def observed(self, time_s: float, root: RootPose) -> Array:
        """Return where the markers were before a time, (L, M, 3) in the frame of the root, NaN where unknown."""
        result = np.full((len(self._lags_s), *self._markers.shape[1:]), np.nan)
        for row, points in zip(result, self.before(time_s), strict=True):
            if points is not None:
                row[:] = root.to_root_frame(points)
        return result

    def of_frames(self, frames: IntArray) -> FloatArray:
        """Return the same for database frames (K,), (K, L, M, 3)."""
        earlier = self._earlier.of(frames)
        back = self._root_matrices[frames]
        # row vectors: p R is R^T p, from the world into the root's frame
        turns = np.swapaxes(self._root_matrices[earlier], -1, -2) @ back[:, None]
        shifts = (self._root_positions_m[earlier] - self._root_positions_m[frames][:, None])[:, :, None] @ back[:, None]
        return np.asarray(self._markers[earlier] @ turns + shifts)


class PoseHistory(Past):
    """Earlier poses (D,), by their principal components.

    The others hardly vary; leaving them out keeps what is conditioned on small.

    Args:
        database: gives clips, poses and rate.
        components: (D, C) orthonormal columns.
        lags_s: ascending times looked back.
    """

    def __init__(self, database: Database, components: Array, lags_s: tuple[float, ...]) -> None:
        super().__init__(lags_s)
        self._components = components.astype(np.float32)
        # by SciPy's BLAS, as the NumPy of some Blenders has a slow one; transposed, which copies nothing
        poses = database.poses.reshape(database.frames, -1)
        self._projected = np.asarray(sgemm(1.0, self._components.T, poses.T)).T
        self._earlier = EarlierFrames(database, lags_s)

    def observed(self, time_s: float) -> Array:
        """Return the components of the poses before a time, (L, C), NaN where unknown."""
        result = np.full((len(self._lags_s), self._components.shape[1]), np.nan)
        for row, pose in zip(result, self.before(time_s), strict=True):
            if pose is not None:
                row[:] = pose @ self._components
        return result

    def of_frames(self, frames: IntArray) -> FloatArray:
        """Return the same for database frames (K,), (K, L, C)."""
        return np.asarray(self._projected[self._earlier.of(frames)])
