"""The door of a session: marker frames without impossible markers and times."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np

from ..geometry.arrays import Array, FloatArray, IntArray, Mask
from .marker_frame import MarkerFrame
from .marker_frame_subset import without_blobs, without_points, without_rays

_LONGEST_STEP_S = 1.0  # from one frame to the next; a longer gap starts a session again
_AGREEING = 3  # frames in a row that make a jump in time believed
_LATEST_S = 1e12
_FAR_M = 500.0  # from the world's origin: no marker can be seen there
_OBLIQUE = 20.0  # normalised coordinates of a ray; 87 degrees off the camera's axis
_FAR_PX = 1e5


class FrameTimes:
    """Times of the frames of a session: each is a little later than the one before.

    Another time is refused, until a few frames in a row agree that it goes on from there.

    Attributes:
        jumped: whether the last frame admitted is the first after a gap.
    """

    def __init__(self) -> None:
        self.jumped = False
        self._last_s: float | None = None
        self._astray_s, self._astray = math.nan, 0

    def admit(self, time_s: float) -> bool:
        """Return whether the next frame's time is possible."""
        if not abs(time_s) < _LATEST_S:
            return False
        self.jumped = self._last_s is not None and not 0.0 < time_s - self._last_s <= _LONGEST_STEP_S
        if self.jumped:
            agrees = 0.0 < time_s - self._astray_s <= _LONGEST_STEP_S
            self._astray, self._astray_s = self._astray + 1 if agrees else 1, time_s
            if self._astray < _AGREEING:
                return False
        self._last_s, self._astray_s = time_s, math.nan
        return True


def usable_frame(frame: MarkerFrame, markers: int, cameras: int) -> MarkerFrame:
    """Return the frame without impossible blobs, points and rays, and a note of them.

    Args:
        markers: that labels may name.
        cameras: of the rig, 0 without one.
    """
    blobs = [_within(rows, _FAR_PX) for rows in frame.blobs]
    points, rays = _possible_points(frame, markers), _possible_rays(frame, markers, cameras)
    if points.all() and rays.all() and all(rows.all() for rows in blobs):
        return frame
    blobs, points, rays = [~rows for rows in blobs], ~points, ~rays
    bad = {"blob": blobs, "point": [points], "ray": [rays]}
    counts = {name: sum(map(np.count_nonzero, rows)) for name, rows in bad.items()}
    listed = ", ".join(f"{count} {name}{'s' * (count > 1)}" for name, count in counts.items() if count)
    rest = without_blobs(without_rays(without_points(frame, points), rays), [np.flatnonzero(row) for row in blobs])
    return replace(rest, notes=(*frame.notes, f"impossible, left out: {listed}"))


def _within(rows: Array | FloatArray, limit: float) -> Mask:
    flat = rows.ravel()
    if np.vdot(flat, flat) < limit**2:  # quicker, and almost always
        return np.ones(len(rows), dtype=bool)
    return np.asarray(np.all(np.abs(rows) < limit, axis=1))


def _possible_points(frame: MarkerFrame, markers: int) -> Mask:
    """Return a mask (N,) of finite, near points with blobs and labels that exist."""
    possible = _within(frame.points_m, _FAR_M) & _within(frame.covariances_m2.reshape(-1, 9), _FAR_M**2)
    possible &= np.logical_and.reduce(frame.covariances_m2.diagonal(axis1=1, axis2=2) > 0.0, axis=1)
    for column, rows in zip(frame.point_blobs.T, frame.blobs, strict=True):
        possible &= (column >= -1) & (column < len(rows))
    return possible & _possible_labels(frame.labels, markers)


def _possible_rays(frame: MarkerFrame, markers: int, cameras: int) -> Mask:
    """Return a mask (R,) of finite rays with cameras, blobs and labels that exist."""
    if not len(frame.single_cameras):
        return np.ones(0, dtype=bool)
    counts = [len(rows) for rows in frame.blobs]  # none without images: any blob may exist
    most = cameras or len(counts) or math.inf
    known = [
        0 <= camera < most and blob >= -1 and (not counts or (camera < len(counts) and blob < counts[camera]))
        for camera, blob in zip(frame.single_cameras.tolist(), frame.single_blobs.tolist(), strict=True)
    ]
    possible = np.array(known, dtype=bool) & _within(frame.single_points, _OBLIQUE)
    return possible & _possible_labels(frame.single_labels, markers)


def _possible_labels(labels: IntArray, markers: int) -> Mask:
    """Return a mask (N,) of labels that are -1, or a marker's and of no other point."""
    values = labels.tolist()
    if not any(value != -1 for value in values):
        return np.ones(len(values), dtype=bool)
    counts = Counter(values)
    known = [value == -1 or (0 <= value < markers and counts[value] == 1) for value in values]
    return np.array(known, dtype=bool)
