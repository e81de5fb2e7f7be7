"""Rejection of impossible markers and times before a session uses a frame."""

import math
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from ..geometry.arrays import Array, FloatArray, IntArray, Mask
from .marker_frame import MarkerFrame
from .marker_frame_subset import without_blobs, without_points, without_rays


@dataclass(frozen=True)
class FrameLimits:
    """Limits for the contents of a marker frame."""

    longest_step_s: float = 1.0  # time between two frames above which times have jumped
    agreeing: int = 3  # successive frames that confirm a jump in time
    latest_s: float = 1e12
    far_m: float = 500.0  # distance from the world's origin at which no marker can be seen
    oblique: float = 20.0  # normalised coordinate of a ray 87 degrees off the camera's axis
    far_px: float = 1e5


_S = FrameLimits()


class FrameTimes:
    """Checks that each frame of a session is slightly later than the previous one.

    A jump in time is rejected until a few successive frames confirm it.

    Attributes:
        jumped: The last frame accepted is the first after a jump.
    """

    def __init__(self) -> None:
        self.jumped = False
        self._last_s: float | None = None
        self._astray_s, self._astray = math.nan, 0

    def admit(self, time_s: float) -> bool:
        """Return whether the next frame's time is possible."""
        if not abs(time_s) < _S.latest_s:
            return False
        self.jumped = self._last_s is not None and not 0.0 < time_s - self._last_s <= _S.longest_step_s
        if self.jumped:
            agrees = 0.0 < time_s - self._astray_s <= _S.longest_step_s
            self._astray, self._astray_s = self._astray + 1 if agrees else 1, time_s
            if self._astray < _S.agreeing:
                return False
        self._last_s, self._astray_s = time_s, math.nan
        return True


def usable_frame(frame: MarkerFrame, markers: int, cameras: int) -> MarkerFrame:
    """Return the frame without impossible blobs, points and rays, and with a note about them.

    Args:
        markers: Number of markers that labels can refer to.
        cameras: Number of cameras in the rig, 0 if there is no rig.
    """
    blobs = [_within(rows, _S.far_px) for rows in frame.blobs]
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
    if np.vdot(flat, flat) < limit**2:  # a quick test that nearly always passes
        return np.ones(len(rows), dtype=bool)
    return np.asarray(np.all(np.abs(rows) < limit, axis=1))


def _possible_points(frame: MarkerFrame, markers: int) -> Mask:
    """Return a mask (N,) of points that are not too far away and whose blobs and labels exist."""
    possible = _within(frame.points_m, _S.far_m) & _within(frame.covariances_m2.reshape(-1, 9), _S.far_m**2)
    possible &= np.logical_and.reduce(frame.covariances_m2.diagonal(axis1=1, axis2=2) > 0.0, axis=1)
    for column, rows in zip(frame.point_blobs.T, frame.blobs, strict=True):
        possible &= (column >= -1) & (column < len(rows))
    return possible & _possible_labels(frame.labels, markers)


def _possible_rays(frame: MarkerFrame, markers: int, cameras: int) -> Mask:
    """Return a mask (R,) of rays in a possible direction whose cameras, blobs and labels exist."""
    if not len(frame.single_cameras):
        return np.ones(0, dtype=bool)
    counts = [len(rows) for rows in frame.blobs]  # empty without images; then any blob may exist
    most = cameras or len(counts) or math.inf
    known = [
        0 <= camera < most and blob >= -1 and (not counts or (camera < len(counts) and blob < counts[camera]))
        for camera, blob in zip(frame.single_cameras.tolist(), frame.single_blobs.tolist(), strict=True)
    ]
    possible = np.array(known, dtype=bool) & _within(frame.single_points, _S.oblique)
    return possible & _possible_labels(frame.single_labels, markers)


def _possible_labels(labels: IntArray, markers: int) -> Mask:
    """Return a mask (N,) of labels that are -1, or an existing marker that no other point has as its label."""
    counts = Counter(labels.tolist())
    return np.array([n == -1 or (0 <= n < markers and counts[n] == 1) for n in labels.tolist()], dtype=bool)
