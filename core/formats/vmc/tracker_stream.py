"""Trackers that come by VMC as marker frames, live."""

import numpy as np

from ...geometry.arrays import IntArray
from ...markers.label_matching import match_labels
from ...markers.marker_frame import MarkerFrame
from ...markers.marker_set import MarkerSet
from ...system.steady_clock import SteadyClock
from .frame_assembler import MOST_PLACED, FrameAssembler, Key, VmcFrame, tracker_names
from .tracker_points import AXES, axis_names, axis_points
from .vmc_packets import TRACKERS

_SIGMA_M = 0.001  # uncertainty given to positions that come without one
_PAUSE_S = 0.25  # between two frames: the numbers of those that are missing are left out
_USUAL_PERIOD_S = 1.0 / 60.0  # a single frame has no rate
_LEAST_STEP_S = 0.001  # between two frames that the network has held up and then hands over at once
_POINTS = 1 + len(AXES)  # of a tracker


class TrackerStream:
    """Marker frames of VMC packets with trackers named as markers of a set.

    A frame is handed over as soon as all is there that was in the last one, so it need not wait for the next.

    Args:
        marker_set: worn; of what comes, its markers alone count. Names agree as `match_labels` says, those of
            `axis_points` among them.
    """

    def __init__(self, marker_set: MarkerSet) -> None:
        self.gathering = FrameAssembler()
        self._marker_set = marker_set
        self._labels: dict[Key, IntArray] = {}  # (4,) of each tracker and its axes' points, -1: no marker
        self._expected: frozenset[Key] = frozenset()
        self._clock = SteadyClock()
        self._begun_s: float | None = None
        self._number = 0
        self._time_s = 0.0

    @property
    def trackers(self) -> tuple[str, ...]:
        """Names of all that have come."""
        return tuple(tracker_names(self._labels).values())

    def add(self, packet: bytes, arrival_s: float) -> list[MarkerFrame]:
        """Add a packet and return the marker frames that ended, as `FrameAssembler.add`."""
        frames = [self._marker_frame(frame) for frame in self.gathering.add(packet, arrival_s)]
        if self._expected and self.gathering.has_all(self._expected):
            frames += [self._marker_frame(frame) for frame in self.gathering.end()]
        return [frame for frame in frames if frame is not None]

    def _marker_frame(self, frame: VmcFrame) -> MarkerFrame | None:
        """Return the markers of a frame, None where it has none of the set's."""
        placed = {key: each for key, each in frame.placed.items() if key[0] in TRACKERS}
        if not self._labels.keys() >= placed.keys():
            self._match_trackers(list(placed))
        self._expected = frozenset(placed)
        labels = np.concatenate([self._labels[key] for key in placed]) if placed else np.empty(0, dtype=np.int64)
        worn = labels >= 0
        if not np.any(worn):
            return None
        points = np.empty((len(placed), _POINTS, 3))
        points[:, 0] = [each.position_m for each in placed.values()]
        points[:, 1:] = axis_points(points[:, 0], np.array([each.rotation for each in placed.values()]))
        self._count(frame.arrival_s)
        covariances = np.broadcast_to(_SIGMA_M**2 * np.eye(3), (int(worn.sum()), 3, 3))
        return MarkerFrame(self._number, self._time_s, points.reshape(-1, 3)[worn], covariances, labels[worn])

    def _match_trackers(self, keys: list[Key]) -> None:
        """Match trackers to markers again because some are new."""
        before = self._labels if len(self._labels) < MOST_PLACED else {}
        known = tracker_names([*before, *keys])
        spelled = {key: (name, *axis_names(name)) for key, name in known.items()}
        match = match_labels([name for names in spelled.values() for name in names], self._marker_set)
        index = {label: self._marker_set.names.index(marker) for marker, label in match.label_of.items()}
        self._labels = {key: np.array([index.get(name, -1) for name in names]) for key, names in spelled.items()}

    def _count(self, arrival_s: float) -> None:
        """Find number and time of the next frame."""
        if self._begun_s is None:
            self._begun_s = arrival_s
            self._clock.steady(0.0)
            return
        period_s = self._time_s / self._number if self._number else _USUAL_PERIOD_S
        time_s = max(self._clock.steady(arrival_s - self._begun_s), self._time_s + _LEAST_STEP_S)
        passed_s = time_s - self._time_s
        self._number += max(round(passed_s / period_s), 1) if passed_s > _PAUSE_S else 1
        self._time_s = time_s
