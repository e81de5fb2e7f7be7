"""Markers and poses a moment ago, of the performer and of every database frame.

One moment's markers leave open how the motion goes on: whether a foot in the air rises or falls, how fast an arm
swings. Earlier markers in the frame of the present root hold the motion of the limbs and of the whole body, at any
frame rate and without a solved pose. Earlier poses hold the rest as far as it was solved, such as the twist of an arm.
"""

from bisect import bisect_left
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import sgemm

from ..database.store import Database
from ..geometry import rotations as rot
from ..geometry.arrays import Array, FloatArray, IntArray
from .database_markers import DatabaseMarkers
from .subject_model import RootPose

_UNIT = np.float32(1.0 / 32_760)  # of stored matrices' entries: less than a tenth of a millimetre at a hand
_CHUNK = 8192  # frames
_TOLERANCE = 0.3  # of the lag: how far off a remembered moment may be and still stand for it


@dataclass(frozen=True)
class LaggedHistory:
    """The latest arrays and their times.

    Args:
        longest_s: longest time looked back, 0 to remember nothing.
        times_s: ascending times of the values.
        values: arrays of one shape.
    """

    longest_s: float = 0.0
    times_s: tuple[float, ...] = ()
    values: tuple[Array, ...] = ()

    def remember(self, time_s: float, value: Array) -> "LaggedHistory":
        """Return the history with one more value; a falling time begins a new one."""
        if not self.longest_s:
            return self
        if self.times_s and time_s <= self.times_s[-1]:
            return LaggedHistory(self.longest_s, (time_s,), (value,))
        times_s = (*self.times_s, time_s)
        first = bisect_left(times_s, time_s - 2.0 * self.longest_s)
        return LaggedHistory(self.longest_s, times_s[first:], (*self.values, value)[first:])

    def before(self, time_s: float, lags_s: Sequence[float]) -> list[Array | None]:
        """Return the value at each lag before a time, None where unknown."""
        return [self._near(time_s - lag, _TOLERANCE * lag) for lag in lags_s]

    def _near(self, moment_s: float, tolerance_s: float) -> Array | None:
        index = bisect_left(self.times_s, moment_s)
        if index == len(self.times_s) or (
            index and moment_s - self.times_s[index - 1] <= self.times_s[index] - moment_s
        ):
            index -= 1
        if index < 0 or abs(self.times_s[index] - moment_s) > tolerance_s:
            return None
        return self.values[index]


class LaggedFrames:
    """Frames of the same clip before frames of a database; if backwards, after.

    Args:
        lags_s: ascending times looked back.
    """

    def __init__(self, database: Database, lags_s: tuple[float, ...]) -> None:
        self.lags_s = lags_s
        self._lags = np.array([max(1, round(lag * database.fps)) for lag in lags_s], dtype=np.int64)
        self._ends = np.array([(clip.start, clip.stop - 1) for clip in database.clips])
        self._clip_of_frame = database.clip_of_frame

    def backwards(self) -> "LaggedFrames":
        """Return the same for time that runs backwards."""
        found = copy(self)
        found._lags = -self._lags
        return found

    def of(self, frames: IntArray) -> IntArray:
        """Return (K, L) frames before those (K,), in a clip's beginning its first."""
        first, last = self._ends.take(self._clip_of_frame.take(frames), axis=0).T[..., None]
        return np.minimum(np.maximum(frames[:, None] - self._lags, first), last)


class LaggedMarkers:
    """Earlier markers (M, 3), NaN where not located, in the frame of the present root.

    Args:
        earlier: of the database.
    """

    def __init__(self, database: Database, markers: DatabaseMarkers, earlier: LaggedFrames) -> None:
        self._markers, self._earlier = markers, earlier
        self._root_matrices: NDArray[np.int16] = np.empty((database.frames, 9), dtype=np.int16)
        for start in range(0, database.frames, _CHUNK):
            part = rot.to_matrix(rot.normalize(database.root_rotations[start : start + _CHUNK])).reshape(-1, 9)
            self._root_matrices[start : start + _CHUNK] = np.rint(part / _UNIT)
        self._root_positions_m = np.asarray(database.root_positions_m)

    def backwards(self) -> "LaggedMarkers":
        """Return the same for time that runs backwards."""
        found = copy(self)
        found._earlier = self._earlier.backwards()
        return found

    def observed(self, history: LaggedHistory, time_s: float, root: RootPose) -> Array:
        """Return earlier observed markers (L, M, 3) in the root's frame, NaN if unknown."""
        unknown = np.full((self._markers.count, 3), np.nan)
        earlier = history.before(time_s, self._earlier.lags_s)
        return root.to_root_frame(np.array([unknown if each is None else each for each in earlier]))

    def of_frames(self, frames: IntArray) -> FloatArray:
        """Return the same for database frames (K,), (K, L, M, 3)."""
        earlier = self._earlier.of(frames)
        # row vectors: p R^T goes to the world's axes, p R from there into the root's
        away, back = (self._matrices(each) for each in (earlier, frames))
        away = np.ascontiguousarray(away.swapaxes(-1, -2))
        turned = self._markers.take(earlier) @ away
        shifts = self._root_positions_m.take(earlier, axis=0) - self._root_positions_m.take(frames, axis=0)[:, None]
        turned += shifts[:, :, None]
        flat = turned.reshape(len(frames), -1, 3)
        return np.asarray((flat @ back).reshape(turned.shape))

    def _matrices(self, frames: IntArray) -> FloatArray:
        """Return world from root (..., 3, 3) of database frames (...)."""
        return (self._root_matrices.take(frames, axis=0) * _UNIT).reshape(*frames.shape, 3, 3)


class LaggedPoses:
    """Earlier poses (D,), by their principal components.

    The other components hardly vary; leaving them out keeps the conditioned Gaussian small.

    Args:
        components: (D, C) orthonormal columns.
        earlier: of the database.
    """

    def __init__(self, database: Database, components: Array, earlier: LaggedFrames) -> None:
        self._components, self._earlier = components.astype(np.float32), earlier
        self._poses = np.asarray(database.poses).reshape(database.frames, -1)

    def backwards(self) -> "LaggedPoses":
        """Return the same for time that runs backwards."""
        found = copy(self)
        found._earlier = self._earlier.backwards()
        return found

    def observed(self, history: LaggedHistory, time_s: float) -> Array:
        """Return the components (L, C) of earlier solved poses, NaN if unknown."""
        unknown = np.full(len(self._components), np.nan)
        earlier = history.before(time_s, self._earlier.lags_s)
        return np.array([unknown if each is None else each for each in earlier]) @ self._components

    def of_frames(self, frames: IntArray) -> FloatArray:
        """Return the same for database frames (K,), (K, L, C)."""
        earlier = self._earlier.of(frames)
        # by SciPy's BLAS, as the NumPy of some Blenders has a slow one; transposed, which copies nothing
        projected = np.asarray(sgemm(1.0, self._components.T, self._poses.take(earlier.ravel(), axis=0).T)).T
        return projected.reshape(*earlier.shape, -1)
