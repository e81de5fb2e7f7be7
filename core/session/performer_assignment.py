"""Assignment of each frame's blobs to several performers in view of the same cameras.

One joint assignment matches each blob (without images, each point) to an expected marker of any tracked performer. A
performer's share is the frame without the blobs of the others. Untracked performers share what is left.
"""

from collections.abc import Sequence

import numpy as np

from ..geometry.arrays import IntArray, Mask
from ..geometry.gated_assignment import assign
from ..labelling.initial_labelling import REACH_M
from ..labelling.labeller import assign_blobs, assign_points
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_frame_subset import without_blobs, without_points
from .session import Session

_NOBODY = -1
_PATIENCE_S = 1.0  # longest wait for all untracked performers in their order; after it, bodies are assigned anyway
_SEARCH_S = 0.1  # pause between two searches for several bodies, each of which takes as long as several frames
_UNLIKE = 1e3  # cost of a body that does not fit a performer's markers
_ORDER_COST = 1.0  # cost of each position by which a body is out of order, added to the cost of its labels


class PerformerAssignment:
    """Splits frames between performers.

    Args:
        sessions: Sessions with the same cameras, in the performers' order from left to right when first seen.
    """

    def __init__(self, sessions: Sequence[Session]) -> None:
        self._sessions = tuple(sessions)
        rig = sessions[0].rig
        self._cameras = rig.cameras if rig else ()
        self._waiting_since_s: float | None = None
        self._searched_s = -np.inf

    def split_frame(self, frame: MarkerFrame) -> list[MarkerFrame]:
        """Return each performer's share of a frame; labels given by the source belong to the first performer."""
        if frame.is_labelled:
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
        """Return the owner of each blob, by camera; without images, the owner of each point."""
        expected = [session.expected_markers(frame.time_s) for session in self._sessions]
        followed = [(index, *found) for index, found in enumerate(expected) if found is not None]
        seen = frame.blobs if self._has_images(frame) else (frame.points_m,)
        owners = [np.full(len(rows), _NOBODY) for rows in seen]
        if not followed:
            return owners
        performers = np.concatenate([np.full(len(gates), index) for index, _, gates in followed])
        markers = np.concatenate([markers for _, markers, _ in followed])
        gates = np.concatenate([gates for _, _, gates in followed])
        for index, owner in enumerate(owners):
            if self._has_images(frame):
                rows, columns, _ = assign_blobs(frame.blobs[index], self._cameras[index], markers, gates)
            else:
                rows, columns = assign_points(frame.points_m, frame.covariances_m2, markers, gates)
            owner[rows] = performers[columns]
        return owners

    def _has_images(self, frame: MarkerFrame) -> bool:
        return len(self._cameras) > 0 and len(frame.blobs) == len(self._cameras)

    def _share(self, frame: MarkerFrame, owners: Sequence[IntArray], index: int) -> MarkerFrame:
        """Return the frame without the blobs or points of other performers."""
        others = [(owner != _NOBODY) & (owner != index) for owner in owners]
        if self._has_images(frame):
            return without_blobs(frame, [np.flatnonzero(taken) for taken in others])
        return without_points(frame, others[0])

    def _propose_bodies(self, frame: MarkerFrame, waiting: Sequence[int]) -> list[MarkerFrame]:
        """Return the share of each untracked performer: one body, or nothing while it is unclear which body."""
        if self._waiting_since_s is None:
            self._waiting_since_s = frame.time_s
        if frame.time_s - self._searched_s < _SEARCH_S:
            return [_nothing(frame)] * len(waiting)
        self._searched_s = frame.time_s
        bodies = self._find_bodies(frame, waiting)
        given = self._assign_bodies(frame, waiting, bodies)
        in_order = [(row, row) for row in range(len(waiting))]
        if given != in_order and frame.time_s - self._waiting_since_s < _PATIENCE_S:
            given = []
        owners = np.full(len(frame.points_m), _NOBODY)
        for row, column in given:
            owners[bodies[column]] = row
        known = {row for row, _ in given}
        return [
            # points far from all bodies may belong to a limb of any performer
            self._without(frame, (owners != row) & (owners != _NOBODY)) if row in known else _nothing(frame)
            for row in range(len(waiting))
        ]

    def _find_bodies(self, frame: MarkerFrame, waiting: Sequence[int]) -> list[IntArray]:
        """Return the indices of the points on each untracked body, from left to right."""
        left, expected_m = np.arange(len(frame.points_m)), []
        for index in waiting:
            start = self._sessions[index].label_initially(frame.points_m[left])
            if start is not None:
                expected_m.append(start.expected_m)
                left = left[start.labels < 0]
        if not expected_m:
            return []
        # the first body found may have taken points that are nearer to another
        markers, gates = np.concatenate(expected_m), np.full(sum(len(body) for body in expected_m), REACH_M)
        points, columns = assign_points(frame.points_m, frame.covariances_m2, markers, gates)
        owners = np.repeat(np.arange(len(expected_m)), [len(body) for body in expected_m])[columns]
        bodies = [np.sort(points[owners == index]) for index in range(len(expected_m))]
        return sorted(bodies, key=lambda body: float(np.mean(frame.points_m[body, 0])))

    def _assign_bodies(
        self, frame: MarkerFrame, waiting: Sequence[int], bodies: Sequence[IntArray]
    ) -> list[tuple[int, int]]:
        """Return pairs of performer and body, matched by how well they fit, then by order from left to right."""
        costs = np.zeros((len(waiting), len(bodies)))
        for row, index in enumerate(waiting):
            for column, body in enumerate(bodies):
                start = self._sessions[index].label_initially(frame.points_m[body])
                costs[row, column] = _ORDER_COST * abs(row - column) + (start.cost if start else _UNLIKE)
        rows, columns = assign(costs, _UNLIKE)
        return list(zip(rows.tolist(), columns.tolist(), strict=True))

    def _without(self, frame: MarkerFrame, taken: Mask) -> MarkerFrame:
        """Return the frame without the points in a mask (N,) and without their blobs."""
        if not self._has_images(frame):
            return without_points(frame, taken)
        kept = [set(column[column >= 0].tolist()) for column in frame.point_blobs[~taken].T]
        gone = [
            np.array(sorted(set(column[column >= 0].tolist()) - own), dtype=np.int64)
            for column, own in zip(frame.point_blobs[taken].T, kept, strict=True)
        ]
        return without_blobs(frame, gone)


def _nothing(frame: MarkerFrame) -> MarkerFrame:
    """Return the frame without any points, rays or blobs."""
    return MarkerFrame(frame.number, frame.time_s, notes=frame.notes)
