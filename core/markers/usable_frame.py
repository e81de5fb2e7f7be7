"""The door of a session: marker frames without impossible markers and times."""

import math
from dataclasses import replace
from enum import Enum

import numpy as np

from ..geometry.arrays import Array, FloatArray, IntArray, Mask
from .marker_frame import MarkerFrame
from .marker_frame_subset import without_blobs, without_points, without_rays

LONGEST_STEP_S = 1.0  # from one frame to the next; a longer gap starts a session again
_AGREEING = 3  # frames in a row that make a jump in time believed
_LATEST_S = 1e12
_FAR_M = 500.0  # from the world's origin: no marker can be seen there
_OBLIQUE = 20.0  # normalised coordinates of a ray; 87 degrees off the camera's axis
_FAR_PX = 1e5
_LEAST_EIGENVALUE = -1e-6  # of a covariance, as a share of its largest: rounding


class Passage(Enum):
    """Passage of a frame by its time."""

    FOLLOWS = "follows the frame before"
    AFTER_GAP = "is the first after a gap"
    REFUSED = "cannot be"


class FrameTimes:
    """Times of the frames of a session: each is a little later than the one before.

    A time that is not is refused, until a few frames in a row agree that it goes on from there.
    """

    def __init__(self) -> None:
        self._last_s: float | None = None
        self._astray_s = math.nan
        self._astray = 0

    def admit(self, time_s: float) -> Passage:
        """Return the passage of the next frame by its time."""
        if not abs(time_s) < _LATEST_S:
            return Passage.REFUSED
        if self._last_s is None or 0.0 < time_s - self._last_s <= LONGEST_STEP_S:
            self._last_s, self._astray = time_s, 0
            return Passage.FOLLOWS
        agrees = self._astray > 0 and 0.0 < time_s - self._astray_s <= LONGEST_STEP_S
        self._astray, self._astray_s = self._astray + 1 if agrees else 1, time_s
        if self._astray < _AGREEING:
            return Passage.REFUSED
        self._last_s, self._astray = time_s, 0
        return Passage.AFTER_GAP


def usable_frame(frame: MarkerFrame, markers: int, cameras: int) -> MarkerFrame:
    """Return the frame without impossible blobs, points and rays, and a note of them.

    Args:
        markers: that labels may name.
        cameras: of the rig, 0 without one.
    """
    if _is_plainly_usable(frame, markers, cameras):
        return frame
    blobs = [~_within(rows, _FAR_PX) for rows in frame.blobs]
    points, rays = ~_possible_points(frame, markers), ~_possible_rays(frame, markers, cameras)
    counts = {"blob": sum(map(np.count_nonzero, blobs)), "point": np.count_nonzero(points)}
    counts["ray"] = np.count_nonzero(rays)
    if not any(counts.values()):
        return frame
    listed = ", ".join(f"{count} {name}{'s' * (count > 1)}" for name, count in counts.items() if count)
    rest = without_blobs(without_rays(without_points(frame, points), rays), [np.flatnonzero(row) for row in blobs])
    return replace(rest, notes=(*frame.notes, f"impossible, left out: {listed}"))


def _is_plainly_usable(frame: MarkerFrame, markers: int, cameras: int) -> bool:
    """Return, quickly, whether nothing is wrong; False: a closer look is needed."""
    counts = [len(rows) for rows in frame.blobs]
    if not (
        all(_square(rows) < _FAR_PX**2 for rows in frame.blobs)
        and _square(frame.points_m) < _FAR_M**2
        and _square(frame.covariances_m2) < _FAR_M**4
        and _square(frame.single_points) < _OBLIQUE**2
        and all(map(_are_indices, frame.point_blobs.T.tolist(), counts))
        and _are_labels(frame.labels, markers)
        and _are_labels(frame.single_labels, markers)
        and all(_known_rays(frame, cameras))
    ):
        return False
    try:
        np.linalg.cholesky(frame.covariances_m2)
    except np.linalg.LinAlgError:
        return False
    return True


def _are_indices(values: list[int], count: int) -> bool:
    return not values or (min(values) >= -1 and max(values) < count)


def _are_labels(labels: IntArray, markers: int) -> bool:
    values = labels.tolist()
    named = [value for value in values if value >= 0]
    return _are_indices(values, markers) and len(set(named)) == len(named)


def _square(values: Array | FloatArray) -> float:
    """Return the sum of squares; NaN or infinite where a value is no number."""
    flat = values.ravel()
    return float(np.vdot(flat, flat))


def _within(rows: Array | FloatArray, limit: float) -> Mask:
    return np.asarray(np.all(np.abs(rows) < limit, axis=1))


def _possible_points(frame: MarkerFrame, markers: int) -> Mask:
    """Return a mask (N,) of finite, near points with blobs and labels that exist."""
    covariances = frame.covariances_m2.reshape(-1, 9)
    possible = _within(frame.points_m, _FAR_M) & _within(covariances, _FAR_M**2)
    possible[possible] = _are_positive(frame.covariances_m2[possible])
    for column, rows in zip(frame.point_blobs.T, frame.blobs, strict=True):
        possible &= (column >= -1) & (column < len(rows))
    return possible & _possible_labels(frame.labels, markers)


def _are_positive(covariances: Array) -> Mask:
    least, _, most = np.linalg.eigvalsh(covariances).T
    return np.asarray((most > 0.0) & (least > _LEAST_EIGENVALUE * most))


def _possible_rays(frame: MarkerFrame, markers: int, cameras: int) -> Mask:
    """Return a mask (R,) of finite rays with cameras, blobs and labels that exist."""
    known = np.array(_known_rays(frame, cameras), dtype=bool)
    return known & _within(frame.single_points, _OBLIQUE) & _possible_labels(frame.single_labels, markers)


def _known_rays(frame: MarkerFrame, cameras: int) -> list[bool]:
    """Return for each ray whether camera and blob exist; without images any blob may."""
    counts = [len(rows) for rows in frame.blobs]
    most = cameras or len(counts) or math.inf
    return [
        0 <= camera < most and blob >= -1 and (not counts or (camera < len(counts) and blob < counts[camera]))
        for camera, blob in zip(frame.single_cameras.tolist(), frame.single_blobs.tolist(), strict=True)
    ]


def _possible_labels(labels: IntArray, markers: int) -> Mask:
    """Return a mask (N,) of labels that are -1, or a marker's and of no other point."""
    named = (labels >= 0) & (labels < markers)
    counts = np.bincount(labels[named], minlength=1)
    return (labels == -1) | (named & (counts[np.where(named, labels, 0)] == 1))
