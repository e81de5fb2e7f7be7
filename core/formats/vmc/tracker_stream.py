"""Live marker frames from trackers received by VMC."""

from dataclasses import dataclass

import numpy as np

from ...geometry.arrays import IntArray
from ...markers.label_matching import match_labels
from ...markers.marker_frame import MarkerFrame
from ...markers.marker_set import MarkerSet
from ...system.steady_clock import SteadyClock
from .frame_assembler import LIMITS, FrameAssembler, Key, VmcFrame, tracker_names
from .tracker_points import axis_names, axis_points
from .vmc_packets import TRACKERS


@dataclass(frozen=True)
class StreamSettings:
    """Uncertainty and timing of tracker frames."""

    sigma_m: float = 0.001  # standard deviation of positions
    pause_s: float = 0.25  # time between two frames above which the missing frames are counted
    period_s: float = 1.0 / 60.0  # assumed time between two frames until their rate is known
    least_step_s: float = 0.001  # smallest step between frame times, for frames that arrive at the same moment


_SETTINGS = StreamSettings()


class TrackerStream:
    """Marker frames from VMC packets with trackers that are named like the markers of a set.

    A frame is complete as soon as it contains everything the last one did, without waiting for the next.

    Args:
        marker_set: Markers that are used; names, including those of `axis_points`, are matched by `match_labels`.
    """

    def __init__(self, marker_set: MarkerSet) -> None:
        self.gathering = FrameAssembler()
        self._marker_set = marker_set
        self._labels: dict[Key, IntArray] = {}  # labels (4,) of each tracker and its axis points
        self._expected: frozenset[Key] = frozenset()
        self._clock = SteadyClock()
        self._begun_s: float | None = None
        self._number = 0
        self._time_s = 0.0

    @property
    def trackers(self) -> tuple[str, ...]:
        """Names of all trackers that have arrived."""
        return tuple(tracker_names(self._labels).values())

    def add(self, packet: bytes, arrival_s: float) -> list[MarkerFrame]:
        """Add a packet and return the marker frames that it completed, as `FrameAssembler.add` does."""
        frames = [self._marker_frame(frame) for frame in self.gathering.add(packet, arrival_s)]
        if self._expected and self.gathering.has_all(self._expected):
            frames += [self._marker_frame(frame) for frame in self.gathering.end()]
        return [frame for frame in frames if frame is not None]

    def _marker_frame(self, frame: VmcFrame) -> MarkerFrame | None:
        """Return the markers in a frame, or None if it contains no marker of the set."""
        placed = {key: each for key, each in frame.placed.items() if key[0] in TRACKERS}
        if not self._labels.keys() >= placed.keys():
            self._match_trackers(list(placed))
        self._expected = frozenset(placed)
        labels = np.concatenate([self._labels[key] for key in placed]) if placed else np.empty(0, dtype=np.int64)
        worn = labels >= 0
        if not np.any(worn):
            return None
        points = np.empty((len(placed), 4, 3))
        points[:, 0] = [each.position_m for each in placed.values()]
        points[:, 1:] = axis_points(points[:, 0], np.array([each.rotation for each in placed.values()]))
        self._count(frame.arrival_s)
        covariances = np.broadcast_to(_SETTINGS.sigma_m**2 * np.eye(3), (int(worn.sum()), 3, 3))
        return MarkerFrame(self._number, self._time_s, points.reshape(-1, 3)[worn], covariances, labels[worn])

    def _match_trackers(self, keys: list[Key]) -> None:
        """Match trackers to markers again after new ones have arrived."""
        before = self._labels if len(self._labels) < LIMITS.placed else {}
        known = tracker_names([*before, *keys])
        spelled = {key: (name, *axis_names(name)) for key, name in known.items()}
        match = match_labels([name for names in spelled.values() for name in names], self._marker_set)
        index = {label: self._marker_set.names.index(marker) for marker, label in match.label_of.items()}
        self._labels = {key: np.array([index.get(name, -1) for name in names]) for key, names in spelled.items()}

    def _count(self, arrival_s: float) -> None:
        """Set the number and the time of the next frame."""
        if self._begun_s is None:
            self._begun_s = arrival_s
            self._clock.steady(0.0)
            return
        period_s = self._time_s / self._number if self._number else _SETTINGS.period_s
        time_s = max(self._clock.steady(arrival_s - self._begun_s), self._time_s + _SETTINGS.least_step_s)
        passed_s = time_s - self._time_s
        self._number += max(round(passed_s / period_s), 1) if passed_s > _SETTINGS.pause_s else 1
        self._time_s = time_s
