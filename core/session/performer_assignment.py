"""Several performers before the same cameras: what of a frame may be whose.

Those that are followed are labelled together: each blob, or point where there are no images, goes to the performer
whose marker is expected nearest to it in one assignment over all of them. A performer then gets all that is not
another's, so that its own session finds its markers as if it were alone. Those that are waited for share what is left.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..geometry.arrays import IntArray, Mask
from ..labelling.initial_labelling import MISSED_M
from ..labelling.labeller import assign_blobs, assign_points
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_frame_subset import without_blobs, without_points
from .frame_labelling import is_labelled
from .session import Session

IntArray = IntArray

_NOBODY = -1
_PATIENCE_S = 1.0  # for which nobody is given a body that may be another's: all who are waited for may come into view
_LOOK_S = 0.1  # from one look for several bodies to the next, as each takes as long as solving some frames
_UNLIKE_M = 1e3  # what it counts to be given a body that one's markers do not fit,
_ORDER_M = 0.015  # and another than that of one's place, against the distance to the closest example


class PerformerAssignment:
    """Gives each performer its share of every frame.

    Args:
        sessions: of the performers, in the order in which they stand from left to right, as the cameras see them, when
            they are first seen together. They have the same cameras.
    """

    def __init__(self, sessions: Sequence[Session]) -> None:
        self._sessions = tuple(sessions)
        rig = sessions[0].rig
        self._cameras = rig.cameras if rig else ()
        self._waiting_since_s: float | None = None
        self._looked_s = -np.inf

    def split_frame(self, frame: MarkerFrame) -> list[MarkerFrame]:
        """Return what each performer may take of the next frame; labels that a source knows are the first one's."""
        if is_labelled(frame):
            return [frame] + [_nothing(frame)] * (len(self._sessions) - 1)
        owners = self._owners(frame)
        shares = [self._share(frame, owners, index) for index in range(len(self._sessions))]
        waiting = [index for index, session in enumerate(self._sessions) if not session.is_tracking]
        if len(waiting) < 2:
            self._waiting_since_s = None
            return shares
        left = self._share(frame, owners, _NOBODY)
        for index, share in zip(waiting, self._propose_bodies(left, waiting), strict=True):
            shares[index] = share
        return shares

    def _owners(self, frame: MarkerFrame) -> list[IntArray]:
        """Return whose each blob of each camera is, or each point where the frame has no images."""
        expected = [session.expected_markers(frame.time_s) for session in self._sessions]
        followed = [(index, *found) for index, found in enumerate(expected) if found is not None]
        seen = frame.blobs if self._has_images(frame) else (frame.points_m,)
        owners = [np.full(len(rows), _NOBODY) for rows in seen]
        if not followed:
            return owners
        performers = np.concatenate([np.full(len(gates), index) for index, _, gates in followed])
        markers = np.concatenate([markers for _, markers, _ in followed])
        gates = np.concatenate([gates for _, _, gates in followed])
        for index, whose in enumerate(owners):
            if self._has_images(frame):
                rows, columns, _ = assign_blobs(frame.blobs[index], self._cameras[index], markers, gates)
            else:
                rows, columns = assign_points(frame.points_m, frame.covariances_m2, markers, gates)
            whose[rows] = performers[columns]
        return owners

    def _has_images(self, frame: MarkerFrame) -> bool:
        return len(self._cameras) > 0 and len(frame.blobs) == len(self._cameras)

    def _share(self, frame: MarkerFrame, owners: Sequence[IntArray], index: int) -> MarkerFrame:
        """Return the frame without what is owned by others than this performer."""
        others = [(whose != _NOBODY) & (whose != index) for whose in owners]
        if self._has_images(frame):
            return without_blobs(frame, [np.flatnonzero(taken) for taken in others])
        return without_points(frame, others[0])

    def _propose_bodies(self, frame: MarkerFrame, waiting: Sequence[int]) -> list[MarkerFrame]:
        """Return the share of each performer that is waited for: one body, or nothing as long as there is doubt."""
        if self._waiting_since_s is None:
            self._waiting_since_s = frame.time_s
        if frame.time_s - self._looked_s < _LOOK_S:
            return [_nothing(frame)] * len(waiting)
        self._looked_s = frame.time_s
        bodies = self._found(frame, waiting)
        given = self._assign_bodies(frame, waiting, bodies)
        in_order = [(row, row) for row in range(len(waiting))]
        if given != in_order and frame.time_s - self._waiting_since_s < _PATIENCE_S:
            given = []
        owners = np.full(len(frame.points_m), _NOBODY)
        for row, column in given:
            owners[bodies[column]] = row
        known = {row for row, _ in given}
        return [
            # what is near to no body may be a limb of any
            self._without(frame, (owners != row) & (owners != _NOBODY)) if row in known else _nothing(frame)
            for row in range(len(waiting))
        ]

    def _found(self, frame: MarkerFrame, waiting: Sequence[int]) -> list[IntArray]:
        """Return the points of bodies from left to right, of as many as are waited for at most."""
        left, expected_m = np.arange(len(frame.points_m)), []
        for index in waiting:
            start = self._sessions[index].label_initially(frame.points_m[left])
            if start is not None:
                expected_m.append(start.expected_m)
                left = left[start.labels < 0]
        if not expected_m:
            return []
        # one who was found first may have been given what is nearer to another
        markers, gates = np.concatenate(expected_m), np.full(sum(len(body) for body in expected_m), MISSED_M)
        points, columns = assign_points(frame.points_m, frame.covariances_m2, markers, gates)
        whose = np.repeat(np.arange(len(expected_m)), [len(body) for body in expected_m])[columns]
        bodies = [np.sort(points[whose == index]) for index in range(len(expected_m))]
        return sorted(bodies, key=lambda body: float(np.mean(frame.points_m[body, 0])))

    def _assign_bodies(
        self, frame: MarkerFrame, waiting: Sequence[int], bodies: Sequence[IntArray]
    ) -> list[tuple[int, int]]:
        """Return pairs of performer and body: by the fit of the markers, else from left to right."""
        costs = np.zeros((len(waiting), len(bodies)))
        for row, index in enumerate(waiting):
            for column, body in enumerate(bodies):
                start = self._sessions[index].label_initially(frame.points_m[body])
                costs[row, column] = _ORDER_M * abs(row - column) + (start.distance_m if start else _UNLIKE_M)
        rows, columns = linear_sum_assignment(costs)
        return [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if costs[r, c] < _UNLIKE_M]

    def _without(self, frame: MarkerFrame, taken: Mask) -> MarkerFrame:
        """Return the frame without some of its points, and without their blobs."""
        if not self._has_images(frame):
            return without_points(frame, taken)
        kept = [set(column[column >= 0].tolist()) for column in frame.point_blobs[~taken].T]
        gone = [
            np.array(sorted(set(column[column >= 0].tolist()) - own), dtype=np.int64)
            for column, own in zip(frame.point_blobs[taken].T, kept, strict=True)
        ]
        return without_blobs(frame, gone)


def _nothing(frame: MarkerFrame) -> MarkerFrame:
    """Return a frame in which nothing is seen."""
    return MarkerFrame(frame.number, frame.time_s, notes=frame.notes)
