"""Labelled trajectories from the unlabelled points of a recorded take, without a body model.

Points are linked into tracklets by their motion. Tracklets are then assigned to markers by the distances between
markers, which the body preserves (exactly on one bone, roughly elsewhere), so a marker that was hidden gets its old
label back.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..errors import TakeError, counted
from ..geometry.arrays import Array, IntArray
from ..geometry.gated_assignment import assign
from ..geometry.point_patterns import point_distances
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_take import MarkerTake


@dataclass(frozen=True)
class LinkSettings:
    """Settings of `track_markers`, tuned on simulated and recorded takes; costs are squared standard deviations."""

    gate_m: float = 0.05  # largest distance between the expected position of a marker at rest and its point
    fastest_m_s: float = 3.0  # growth of this gate per second between frames; also the fastest walk
    widest_gate_m: float = 0.35
    young_gate: float = 0.6  # factor of the gate for a tracklet that may be a ghost
    ghost_frames: int = 3  # length up to which a tracklet may be a ghost
    bridge_frames: int = 2  # largest number of frames that a tracklet can miss
    slow_rate_s: float = 0.08  # time between frames above which a shift common to all points is used, not velocities
    slow_rounds: int = 3  # number of assignments, each with a corrected common shift
    depth_jump_m: float = 0.25  # additional gate along the line of sight
    depth_trust: float = 0.2  # share of the velocity along the line of sight that is used
    fair_share: float = 0.25  # share of the frames that must show as many points as there are markers
    structure_sigma_m: float = 0.012  # standard deviation of distances that are rigid
    continuity_m: float = 0.06  # standard deviation of a marker's movement across a gap
    continuity_m_s: float = 1.5  # growth of this deviation per second of the gap
    cost_cap: float = 16.0  # cap on the cost of one distance
    cost_limit: float = 10.0  # cost above which a tracklet belongs to another marker
    young_cost_limit: float = 4.0  # the same for a tracklet that may be a ghost
    long_frames: int = 10  # length from which tracklets are assigned in order of time, starting from the first
    overlap_frames: int = 2  # largest number of frames that two tracklets of one marker may share


_S = LinkSettings()


@dataclass(eq=False)
class Tracklet:
    """Points of one marker in successive frames: frame and point indices, last position and velocity."""

    frames: list[int] = field(default_factory=list)
    points: list[int] = field(default_factory=list)
    position_m: Array = field(default_factory=lambda: np.zeros(3))
    velocity_m_s: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def may_be_ghost(self) -> bool:
        """Whether the tracklet is so short that it may be a false match between two cameras."""
        return len(self.frames) <= _S.ghost_frames


@dataclass(frozen=True)
class Tracking:
    """Tracked take, with the marker of each point in every frame, -1 for none."""

    take: MarkerTake
    labels: tuple[IntArray, ...]
    dropped_tracklets: int


def track_markers(frames: Sequence[MarkerFrame], name: str, fps: float, count: int | None = None) -> Tracking:
    """Return trajectories of all markers, named M01, M02, ... from the highest down.

    Args:
        frames: Frames in order of time.
        count: Number of markers; by default the number of points that a quarter of the frames reach.

    Raises:
        TakeError: No frame shows enough points.
    """
    linker = _Linker(frames)
    tracklets = linker.join_points()
    alive: list[list[Tracklet]] = [[] for _ in frames]
    for tracklet in tracklets:
        for f in tracklet.frames:
            alive[f].append(tracklet)
    worn = count or _usual_count(tracklets, len(frames))
    seed = _seed_frame(alive, worn)
    identities = [[tracklet] for tracklet in sorted(alive[seed], key=lambda each: -len(each.frames))[:worn]]
    linker.positions = np.full((len(frames), worn, 3), np.nan)
    for marker, (tracklet,) in enumerate(identities):
        linker.fill(marker, tracklet)
    seeds = {id(tracklet) for (tracklet,) in identities}
    rest = [tracklet for tracklet in tracklets if id(tracklet) not in seeds]
    # long tracklets come first, so that short ones do not take their frames
    rest.sort(key=lambda each: (-min(len(each.frames), _S.long_frames), _frames_away(each, seed)))
    dropped = 0
    for tracklet in rest:
        found = linker.best_identity(tracklet)
        if found is None:
            dropped += 1
            continue
        identities[found].append(tracklet)
        linker.fill(found, tracklet)
    order = np.argsort(-np.nanmedian(linker.positions[..., 1], axis=0), kind="stable")
    labels = tuple(np.full(len(frame.points_m), -1, dtype=np.int64) for frame in frames)
    for marker, identity in enumerate(order):
        for tracklet in identities[identity]:
            for f, point in zip(tracklet.frames, tracklet.points, strict=True):
                labels[f][point] = marker
    take = MarkerTake(
        name,
        fps,
        tuple(f"M{i + 1:02d}" for i in range(worn)),
        linker.positions[:, order],
        np.array([frame.number for frame in frames]),
        np.array(linker.times_s),
    )
    return Tracking(take, labels, dropped)


class _Linker:
    """Links points into tracklets, and assigns tracklets to markers.

    Attributes:
        positions: Positions (F, M, 3) of the markers found so far.
    """

    def __init__(self, frames: Sequence[MarkerFrame]) -> None:
        self._points = [frame.points_m for frame in frames]
        self.times_s = [frame.time_s for frame in frames]
        self._depth_axes = [_depth_axis(frame) for frame in frames]
        self.positions = np.empty((len(frames), 0, 3))

    def join_points(self) -> list[Tracklet]:
        """Link all points into tracklets."""
        tracklets: list[Tracklet] = []
        active: list[Tracklet] = []
        for f, points in enumerate(self._points):
            active = [each for each in active if f - each.frames[-1] <= _S.bridge_frames + 1]
            rows, columns = self._follow(active, f)
            followers = {int(column): active[row] for row, column in zip(rows, columns, strict=True)}
            for point in range(len(points)):
                tracklet = followers.get(point)
                if tracklet is None:
                    tracklet = Tracklet()
                    active.append(tracklet)
                    tracklets.append(tracklet)
                self._extend(tracklet, f, point)
        return tracklets

    def _follow(self, active: Sequence[Tracklet], f: int) -> tuple[IntArray, IntArray]:
        """Return indices of active tracklets and of the points of a frame that continue them."""
        points = self._points[f]
        if not active or len(points) == 0:
            return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
        expected = np.array([tracklet.position_m for tracklet in active])
        passed_s = np.array([self.times_s[f] - self.times_s[tracklet.frames[-1]] for tracklet in active])
        gates = np.minimum(_S.gate_m + _S.fastest_m_s * passed_s, _S.widest_gate_m)
        slow = bool(np.median(passed_s) >= _S.slow_rate_s)
        if slow:
            expected = expected + _common_shift(expected, points, float(np.median(passed_s)))
        else:
            expected = expected + np.array([tracklet.velocity_m_s for tracklet in active]) * passed_s[:, None]
            gates *= np.where([tracklet.may_be_ghost for tracklet in active], _S.young_gate, 1.0)
        for _ in range(_S.slow_rounds if slow else 1):
            squares = _squared_gates(points[None] - expected[:, None], gates[:, None], self._depth_axes[f])
            rows, columns = assign(squares)
            if len(rows) >= 3:
                expected = expected + np.median(points[columns] - expected[rows], axis=0)
        return rows, columns

    def _extend(self, tracklet: Tracklet, f: int, point: int) -> None:
        position, axis = self._points[f][point], self._depth_axes[f]
        if tracklet.frames:
            passed_s = max(self.times_s[f] - self.times_s[tracklet.frames[-1]], 1e-4)
            velocity = (position - tracklet.position_m) / passed_s
            tracklet.velocity_m_s = velocity - (1.0 - _S.depth_trust) * (velocity @ axis) * axis
        tracklet.position_m = position
        tracklet.frames.append(f)
        tracklet.points.append(point)

    def fill(self, marker: int, tracklet: Tracklet) -> None:
        """Fill a marker's gaps from a tracklet, and shorten the tracklet to the frames used."""
        kept = [i for i, f in enumerate(tracklet.frames) if np.isnan(self.positions[f, marker, 0])]
        tracklet.frames, tracklet.points = [tracklet.frames[i] for i in kept], [tracklet.points[i] for i in kept]
        self.positions[tracklet.frames, marker] = self._places(tracklet)

    def _places(self, tracklet: Tracklet) -> Array:
        rows = zip(tracklet.frames, tracklet.points, strict=True)
        return np.array([self._points[f][point] for f, point in rows]).reshape(-1, 3)

    def best_identity(self, tracklet: Tracklet) -> int | None:
        """Return the marker to which a tracklet belongs, or None if no marker free at that time fits."""
        where, own = np.array(tracklet.frames), self._places(tracklet)
        taken = np.isfinite(self.positions[where, :, 0]).sum(axis=0)
        # a false point may have kept one tracklet going for a frame after the next began
        free = np.flatnonzero(taken <= min(_S.overlap_frames, len(where) // 4))
        if len(free) == 0:
            return None
        costs = [self._structure_cost(where, own, marker) + self._gap_cost(where, own, marker) for marker in free]
        best = int(np.argmin(costs))
        limit = _S.young_cost_limit if tracklet.may_be_ghost else _S.cost_limit
        return int(free[best]) if costs[best] < limit else None

    def _structure_cost(self, where: IntArray, own: Array, marker: int) -> float:
        """Return the mean squared deviation, in standard deviations, from usual distances to other markers."""
        usual = np.linalg.norm(self.positions - self.positions[:, marker : marker + 1], axis=2)
        usual[:, marker] = np.nan
        seen = np.isfinite(usual).sum(axis=0)
        there = np.isfinite(self.positions[where, :, 0]).any(axis=0) & (seen >= 2)
        if not there.any():
            return 0.0
        mean, spread = np.nanmean(usual[:, there], axis=0), np.nanstd(usual[:, there], axis=0)
        distance = np.linalg.norm(self.positions[where][:, there] - own[:, None], axis=2)
        sigma2 = spread**2 + _S.structure_sigma_m**2
        deviation = np.minimum((distance - mean) ** 2 / sigma2, _S.cost_cap)
        weight = np.where(np.isfinite(deviation), 1.0 / np.sqrt(sigma2), 0.0)
        return float(np.sum(np.nan_to_num(deviation) * weight) / weight.sum())

    def _gap_cost(self, where: IntArray, own: Array, marker: int) -> float:
        """Return the mean squared distance, in standard deviations, from the marker's positions before and after."""
        known = np.flatnonzero(np.isfinite(self.positions[:, marker, 0]))
        axis, costs = self._depth_axes[where[0]], []
        before, after = known[known < where[0]], known[known > where[-1]]
        for mine, point, nearest in ((where[0], own[0], before[-1:]), (where[-1], own[-1], after[:1])):
            for other in nearest:
                gap_s = abs(self.times_s[mine] - self.times_s[other])
                sigma = _S.continuity_m + _S.continuity_m_s * gap_s
                squared = _squared_gates(point - self.positions[other, marker], sigma, axis)
                costs.append(min(float(squared), _S.cost_cap))
        return float(np.mean(costs)) if costs else 0.0


def _squared_gates(difference: Array, across: Array | float, depth_axis: Array) -> Array:
    """Return squared distances within gates that are wider along the line of sight.

    Unsynchronised cameras see a marker that moves sideways at different positions, so its depth jumps between frames by
    far more than the marker moves.
    """
    depth = difference @ depth_axis
    lateral2 = np.sum(difference**2, axis=-1) - depth**2
    return np.asarray(lateral2 / across**2 + (depth / (across + _S.depth_jump_m)) ** 2)


def _depth_axis(frame: MarkerFrame) -> Array:
    """Return the unit vector (3,) along which the points of a frame are most uncertain."""
    if len(frame.points_m) == 0:
        return np.array([0.0, 0.0, 1.0])
    scaled = frame.covariances_m2 / np.trace(frame.covariances_m2, axis1=1, axis2=2)[:, None, None]
    return np.asarray(np.linalg.eigh(scaled.mean(axis=0))[1][:, -1])


def _common_shift(expected: Array, points: Array, passed_s: float) -> Array:
    """Return the shift (3,) of the body that brings the expected positions closest to the points."""
    shifts = np.concatenate((np.zeros((1, 3)), (points[None] - expected[:, None]).reshape(-1, 3)))
    shifts = shifts[np.linalg.norm(shifts, axis=1) <= _S.fastest_m_s * passed_s]
    nearest_m = [point_distances(expected + shift, points).min(axis=1) for shift in shifts]
    nearest = [np.minimum(each_m, _S.widest_gate_m).sum() for each_m in nearest_m]
    return np.asarray(shifts[np.argmin(nearest + 0.1 * np.linalg.norm(shifts, axis=1))])


def _usual_count(tracklets: Sequence[Tracklet], count: int) -> int:
    """Return the number of markers that a fair share of the frames show, ignoring short tracklets."""
    longest = [tracklet for tracklet in tracklets if not tracklet.may_be_ghost] or list(tracklets)
    shown = np.zeros(count, dtype=np.int64)
    for tracklet in longest:
        shown[tracklet.frames] += 1
    if np.sum(shown > 0) <= _S.fair_share * count:
        raise TakeError(
            "almost no markers were found", advice="check the threshold, the cameras' order and the calibration"
        )
    return int(np.sort(shown)[::-1][int(_S.fair_share * count)])


def _seed_frame(alive: Sequence[Sequence[Tracklet]], worn: int) -> int:
    """Return the frame that shows enough tracklets for all markers at once, and the longest ones."""
    scores = [
        sum(sorted((len(tracklet.frames) for tracklet in row), reverse=True)[:worn]) if len(row) >= worn else -1
        for row in alive
    ]
    if max(scores, default=-1) < 0:
        raise TakeError(
            f"no frame shows more than {max(map(len, alive), default=0)} of {counted(worn, 'marker')}",
            advice="check that both cameras see the markers, or choose the marker set that was worn",
        )
    return int(np.argmax(scores))


def _frames_away(tracklet: Tracklet, f: int) -> int:
    return max(tracklet.frames[0] - f, f - tracklet.frames[-1], 0)
