"""Image trajectories of markers that only one camera sees in a tracked take.

A marker that the other camera loses keeps moving in the first one's image, so it is followed there, and where that is
not possible looked for where its trajectory before and after the gap has it. That is done forwards and backwards in
time; what both find is the marker.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, IntArray
from ..geometry.camera import CameraRig
from ..geometry.gated_assignment import assign
from ..markers.marker_frame import MarkerFrame, undistort_blobs
from ..markers.marker_take import SingleViews
from .trajectory_linking import Tracking

_GATE_M = 0.03  # at the marker's depth, from where it is expected
_GATE_M_S = 0.5  # growth with the time since it was last seen in this image
_GATE_MOST_M = 0.08
_OPEN_S = 0.25  # a marker is looked for so long before it is first and after it is last located
_FRESH_S = 0.1  # a movement in the image older than this is of no use


@dataclass
class _Image:
    """Last image positions (M, 2), velocities per second and times (M,) of markers."""

    points: Array
    velocities: Array
    times_s: Array

    @classmethod
    def empty(cls, markers: int) -> "_Image":
        return cls(np.full((markers, 2), np.nan), np.zeros((markers, 2)), np.full(markers, -np.inf))

    def expected(self, time_s: float, projected: Array) -> Array:
        """Return expected image positions (M, 2): by velocity, or as projected."""
        passed = time_s - self.times_s
        moved = self.points + self.velocities * np.where(np.isfinite(passed), passed, 0.0)[:, None]
        return np.where((np.abs(passed) < _FRESH_S)[:, None], moved, projected)

    def see(self, markers: IntArray, points: Array, time_s: float) -> None:
        passed = time_s - self.times_s[markers]
        known = (passed != 0.0) & (np.abs(passed) < _FRESH_S)
        step = (points - self.points[markers]) / np.where(known, passed, 1.0)[:, None]
        self.velocities[markers] = np.where(known[:, None], step, 0.0)
        self.points[markers], self.times_s[markers] = points, time_s


def single_views(tracking: Tracking, frames: Sequence[MarkerFrame], rig: CameraRig) -> SingleViews:
    """Return single cameras' views of markers that the tracked take does not locate.

    Args:
        tracking: of the frames, in which each point that belongs to a marker is labelled.
    """
    take = tracking.take
    frames = [undistort_blobs(frame, rig.cameras) for frame in frames]
    expected_m = _bridge_gaps(take.positions_m, take.times_s)
    cameras = np.full(take.visible.shape, -1, dtype=np.int64)
    points = np.full((*take.visible.shape, 2), np.nan)
    nearest = np.full(take.visible.shape, np.inf)
    for index, camera in enumerate(rig.cameras):
        views = [
            _View(
                take.times_s[f],
                frame.normalised[index],
                _blobs_of(frame, tracking.labels[f], len(take.names), index),
                np.flatnonzero(~take.visible[f] & np.isfinite(expected_m[f, :, 0])),
                camera.to_camera(expected_m[f]),
            )
            for f, frame in enumerate(frames)
        ]
        blobs, far = _follow_markers(views)
        back = _follow_markers(views[::-1])[0][::-1]
        # where the two ways meet at another blob, markers have been exchanged on one of them
        better = (blobs >= 0) & (blobs == back) & (far < nearest)
        for f, marker in np.argwhere(better):
            cameras[f, marker], nearest[f, marker] = index, far[f, marker]
            points[f, marker] = views[f].points[blobs[f, marker]]
    return SingleViews(rig, cameras, points)


@dataclass(frozen=True)
class _View:
    """One camera's image and the markers expected in it.

    Args:
        points: (N, 2) normalised coordinates of its blobs.
        located: (M,) blob of each located marker, -1 for none.
        expected_m: (M, 3) expected markers in the camera's frame.
    """

    time_s: float
    points: Array
    located: IntArray
    hidden: IntArray
    expected_m: Array


def _blobs_of(frame: MarkerFrame, labels: IntArray, count: int, camera: int) -> IntArray:
    blobs = np.full(count, -1, dtype=np.int64)
    blobs[labels[labels >= 0]] = frame.point_blobs[labels >= 0, camera]
    return blobs


def _follow_markers(views: Sequence[_View]) -> tuple[IntArray, Array]:
    """Return blobs (F, M) of hidden markers, -1 for none, and their distances."""
    count = len(views[0].located)
    blobs = np.full((len(views), count), -1, dtype=np.int64)
    far = np.full((len(views), count), np.inf)
    image = _Image.empty(count)
    for f, view in enumerate(views):
        located = np.flatnonzero(view.located >= 0)
        free = np.setdiff1d(np.arange(len(view.points)), view.located[located])
        rows, columns, distances = _find_hidden(image, view, free)
        blobs[f, rows], far[f, rows] = columns, distances
        image.see(located, view.points[view.located[located]], view.time_s)
        image.see(rows, view.points[columns], view.time_s)
    return blobs, far


def _find_hidden(image: _Image, view: _View, free: IntArray) -> tuple[IntArray, IntArray, Array]:
    """Return hidden markers (N,), their blobs (N,) and distances from expectation."""
    nothing = np.empty(0, dtype=np.int64)
    if len(view.hidden) == 0 or len(free) == 0:
        return nothing, nothing, np.empty(0)
    depth = np.maximum(view.expected_m[:, 2:], 0.1)
    expected = image.expected(view.time_s, view.expected_m[:, :2] / depth)
    gates = np.minimum(_GATE_M + _GATE_M_S * np.abs(view.time_s - image.times_s), _GATE_MOST_M)
    distances = np.linalg.norm(expected[view.hidden, None] - view.points[free][None], axis=-1) * depth[view.hidden]
    relative = distances / gates[view.hidden, None]
    rows, columns = assign(relative**2)
    return view.hidden[rows], free[columns], relative[rows, columns]


def _bridge_gaps(positions_m: Array, times_s: Array) -> Array:
    """Interpolate trajectories (F, M, 3) over gaps; extend them a little at the ends."""
    result = positions_m.copy()
    for marker in range(positions_m.shape[1]):
        known = np.flatnonzero(np.isfinite(positions_m[:, marker, 0]))
        if len(known) == 0:
            continue
        near = (times_s > times_s[known[0]] - _OPEN_S) & (times_s < times_s[known[-1]] + _OPEN_S)
        for axis in range(3):
            line = np.interp(times_s, times_s[known], positions_m[known, marker, axis])
            result[near, marker, axis] = line[near]
    return result
