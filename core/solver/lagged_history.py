"""Earlier markers and poses: those of the performer, and those before each database frame.

The markers of a single frame do not show how the motion continues: whether a foot in the air rises or falls, how fast
an arm swings. Earlier markers, in the frame of the current root, describe the motion of limbs and body at any frame
rate and without a solved pose. Earlier solved poses supply the rest, such as the twist of an arm.
"""

import math
from bisect import bisect_left
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..database.store import Database
from ..geometry import rotations as rot
from ..geometry.arrays import Array, FloatArray, IntArray
from ..kernel.library import Packed, address, checked, contiguous, function, stage
from .database_markers import DatabaseMarkers
from .subject_model import RootPose

_UNIT = np.float32(1.0 / 32_760)  # unit of stored matrix entries; rounding moves a hand by less than 0.1 mm
_CHUNK = 8192  # frames processed at once
_COLUMNS = 32  # number of components that the kernel computes at once
_TOLERANCE = 0.3  # largest difference of a remembered value's age from a lag, as a share of the lag


@dataclass(frozen=True)
class LaggedHistory:
    """The most recent values of a quantity, with their times."""

    longest_s: float = 0.0  # longest lag; 0 to remember nothing
    times_s: tuple[float, ...] = ()  # ascending
    values: tuple[Array, ...] = ()

    def remember(self, time_s: float, value: Array) -> "LaggedHistory":
        """Return the history with one value added; a time that is not later than the last one starts a new history."""
        if not self.longest_s:
            return self
        if self.times_s and time_s <= self.times_s[-1]:
            return LaggedHistory(self.longest_s, (time_s,), (value,))
        times_s = (*self.times_s, time_s)
        first = bisect_left(times_s, time_s - 2.0 * self.longest_s)
        return LaggedHistory(self.longest_s, times_s[first:], (*self.values, value)[first:])

    def recent(self, time_s: float, lags_s: Sequence[float], shape: tuple[int, ...]) -> Array:
        """Return the values (L, ...) at each lag before a time, NaN where unknown.

        Args:
            shape: Shape of a value.
        """
        found = np.full((len(lags_s), *shape), np.nan)
        for row, value in zip(found, self.before(time_s, lags_s), strict=True):
            if value is not None:
                row[...] = value
        return found

    def before(self, time_s: float, lags_s: Sequence[float]) -> list[Array | None]:
        """Return the value at each lag before a time; None where it is unknown."""
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
    """Access to the earlier frames of database frames in the same clip; in a time-reversed copy, to later frames.

    Args:
        lags_s: Ascending lags.
    """

    def __init__(self, database: Database, lags_s: tuple[float, ...]) -> None:
        self.lags_s = lags_s
        self._lags = np.array([max(1, round(lag * database.fps)) for lag in lags_s], dtype=np.int64)
        self._ends = np.array([(clip.start, clip.stop - 1) for clip in database.clips])
        self._clip_of_frame = database.clip_of_frame

    def backwards(self) -> "LaggedFrames":
        """Return a time-reversed copy."""
        found = copy(self)
        found._lags = -self._lags
        return found

    def packed(self) -> Packed:
        """These lags as the kernel takes them."""
        return Packed(len(self._lags), self._lags, self._ends, self._clip_of_frame)

    def of(self, frames: IntArray) -> IntArray:
        """Return the frames (K, L) at each lag before frames (K,), clamped to their clips."""
        first, last = self._ends.take(self._clip_of_frame.take(frames), axis=0).T[..., None]
        return np.minimum(np.maximum(frames[:, None] - self._lags, first), last)


class LaggedMarkers:
    """Access to earlier markers (M, 3) in the frame of the current root, NaN where not located."""

    def __init__(self, database: Database, markers: DatabaseMarkers, earlier: LaggedFrames) -> None:
        self._markers, self._earlier = markers, earlier
        self._root_matrices: NDArray[np.int16] = np.empty((database.frames, 9), dtype=np.int16)
        for start in range(0, database.frames, _CHUNK):
            part = rot.to_matrix(rot.normalize(database.root_rotations[start : start + _CHUNK])).reshape(-1, 9)
            self._root_matrices[start : start + _CHUNK] = np.rint(part / _UNIT)
        self._root_positions_m = np.asarray(database.root_positions_m)

    def backwards(self) -> "LaggedMarkers":
        """Return a time-reversed copy."""
        found = copy(self)
        found._earlier = self._earlier.backwards()
        return found

    def observed(self, history: LaggedHistory, time_s: float, root: RootPose) -> Array:
        """Return earlier observed markers (L, M, 3) in the root's frame, NaN where unknown."""
        return root.to_root_frame(self.recent(history, time_s))

    def recent(self, history: LaggedHistory, time_s: float) -> Array:
        """Return earlier observed markers (L, M, 3) in the world, NaN where unknown."""
        return history.recent(time_s, self.lags_s, (self._markers.count, 3))

    @property
    def lags_s(self) -> tuple[float, ...]:
        """Ascending lags."""
        return self._earlier.lags_s

    def tilt_rad(self, root: RootPose, frames: IntArray) -> float:
        """Return the angle between the vertical in the axes of a root and the mean one in those of frames (K,)."""
        among = np.add.reduce((self._root_matrices.take(frames, axis=0)[:, 3:6] * _UNIT).astype(np.float64))
        cosine = float(among @ root.matrix[1]) / max(float(np.linalg.norm(among)), 1e-9)
        return math.acos(min(max(cosine, -1.0), 1.0))

    def packed(self) -> Packed:
        """These markers as the kernel takes them."""
        roots = self._root_matrices, float(_UNIT), np.ascontiguousarray(self._root_positions_m, dtype=np.float32)
        return Packed(self._markers.packed(), self._earlier.packed(), *roots)

    def of_frames(self, frames: IntArray) -> FloatArray:
        """Return the markers (K, L, M, 3) before database frames (K,), in the frames of the roots of those."""
        rotations, positions_m = self._root_matrices, self._root_positions_m
        return markers_before(self._markers, rotations, positions_m, frames, self._earlier.of(frames))


_EARLIER = function("earlier_markers", "pnnpfnpfpppnnp")


def _compiled(
    markers: DatabaseMarkers, rotations: NDArray[np.int16], positions_m: FloatArray, frames: IntArray, earlier: IntArray
) -> FloatArray:
    found = np.empty((*earlier.shape, markers.count, 3), dtype=np.float32)
    stored = address(markers.rows), *markers.rows.shape, address(markers.places), float(markers.unit_m), markers.count
    roots = address(rotations), float(_UNIT), contiguous(positions_m, np.float32)
    checked(
        _EARLIER(
            *stored, *roots, contiguous(frames, np.int64), contiguous(earlier, np.int64), *earlier.shape, address(found)
        )
    )
    return found


@stage(_compiled)
def markers_before(
    markers: DatabaseMarkers, rotations: NDArray[np.int16], positions_m: FloatArray, frames: IntArray, earlier: IntArray
) -> FloatArray:
    """Return the markers (K, L, M, 3) of earlier frames (K, L) in the axes of the roots of frames (K,).

    Args:
        rotations: Root rotations (F, 9) of all frames, in units.
        positions_m: Root positions (F, 3) of all frames.
    """
    # for row vectors p, p R^T turns from the root's axes to the world's, and p R turns back
    away, back = ((rotations.take(each, axis=0) * _UNIT).reshape(*each.shape, 3, 3) for each in (earlier, frames))
    away = np.ascontiguousarray(away.swapaxes(-1, -2))
    turned = markers.take(earlier) @ away
    shifts = positions_m.take(earlier, axis=0) - positions_m.take(frames, axis=0)[:, None]
    turned += shifts[:, :, None]
    flat = turned.reshape(len(frames), turned.shape[1] * markers.count, 3)
    return np.asarray((flat @ back).reshape(turned.shape))


class LaggedPoses:
    """Access to earlier poses (D,), as leading principal components to keep the conditioned Gaussian small.

    Args:
        components: Orthonormal columns (D, C).
    """

    def __init__(self, database: Database, components: Array, earlier: LaggedFrames) -> None:
        self._components, self._earlier = components.astype(np.float32), earlier
        self._poses = np.asarray(database.poses).reshape(database.frames, -1)

    def backwards(self) -> "LaggedPoses":
        """Return a time-reversed copy."""
        found = copy(self)
        found._earlier = self._earlier.backwards()
        return found

    def observed(self, history: LaggedHistory, time_s: float) -> Array:
        """Return the principal components (L, C) of earlier solved poses, NaN where unknown."""
        return self.recent(history, time_s) @ self._components

    def recent(self, history: LaggedHistory, time_s: float) -> Array:
        """Return earlier solved poses (L, D), NaN where unknown."""
        return history.recent(time_s, self._earlier.lags_s, (len(self._components),))

    def packed(self) -> Packed:
        """These poses as the kernel takes them."""
        size, count = self._components.shape
        padded = np.zeros((size, -(-count // _COLUMNS) * _COLUMNS), dtype=np.float32)
        padded[:, :count] = self._components
        return Packed(self._poses, size, count, padded.shape[1], padded)

    def of_frames(self, frames: IntArray) -> FloatArray:
        """Return the principal components (K, L, C) of the poses before database frames (K,)."""
        earlier = self._earlier.of(frames)
        projected = self._poses.take(earlier.ravel(), axis=0) @ self._components
        return np.asarray(projected.reshape(*earlier.shape, self._components.shape[1]))
