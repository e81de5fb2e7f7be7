"""Labelled trajectories without a body model, from unlabelled points.

First points are joined to tracklets of trajectory by temporal coherence; then tracklets are joined to markers by the
distances between markers, which a body keeps (those on one limb exactly, others roughly), so that a marker that was
lost gets its own label back. The whole take is known: this is for recorded images.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.distance import cdist

from ..errors import TakeError
from ..geometry.arrays import Array, IntArray
from ..geometry.gated_assignment import assign
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_take import MarkerTake

_GATE_M = 0.05
_GATE_SPEED_M_S = 3.0
_YOUNG_GATE = 0.6
_GATE_MOST_M = 0.35
_SLOW_RATE_S = 0.08  # between frames further apart than this a velocity says little
_SLOW_ROUNDS = 3
_FASTEST_WALK_M_S = 3.0
_DEPTH_JUMP_M = 0.25
_DEPTH_TRUST = 0.2  # of the velocity along the line of sight
_BRIDGE_FRAMES = 2
_FAIR_SHARE = 0.25  # of the frames: single markers are hidden more often than all are shown
_GHOST_FRAMES = 3  # a tracklet of no more frames than this that fits no marker is a false marker
_STRUCTURE_SIGMA_M = 0.012
_CONTINUITY_M = 0.06
_CONTINUITY_M_S = 1.5
_COST_CAP = 16.0
_COST_LIMIT = 10.0
_YOUNG_COST_LIMIT = 4.0
_LONG_FRAMES = 10
_OVERLAP_FRAMES = 2


@dataclass
class Tracklet:
    """Points of one marker in successive frames: frame and point indices."""

    frames: list[int] = field(default_factory=list)
    points: list[int] = field(default_factory=list)
    position_m: Array = field(default_factory=lambda: np.zeros(3))
    velocity_m_s: Array = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Tracking:
    """Tracked take, and per frame the marker (or -1) of each point."""

    take: MarkerTake
    labels: tuple[IntArray, ...]
    dropped_tracklets: int


def track_markers(frames: Sequence[MarkerFrame], name: str, fps: float, count: int | None = None) -> Tracking:
    """Return trajectories of all markers: M01, M02, ... from the highest down.

    Args:
        frames: in order of time.
        count: how many markers are worn; None: as many as are seen at once in a quarter of the frames.

    Raises:
        TakeError: no frame shows enough points.
    """
    tracklets = _join_points(frames)
    table = _alive(tracklets, len(frames))
    worn = count or _usual_count(tracklets, len(frames))
    seed = _seed_frame(tracklets, table, worn)
    identities = [[tracklet] for tracklet in sorted(table[seed], key=lambda p: -len(tracklets[p].frames))[:worn]]
    used = {tracklet for row in identities for tracklet in row}
    rest = [p for p in range(len(tracklets)) if p not in used]
    # long tracklets first: short ones must not take their place
    rest.sort(key=lambda p: (-min(len(tracklets[p].frames), _LONG_FRAMES), _distance_in_time(tracklets[p], seed)))
    positions = np.full((len(frames), worn, 3), np.nan)
    for marker, row in enumerate(identities):
        _fill(positions, marker, tracklets[row[0]], frames)
    dropped = 0
    for p in rest:
        found = _best_identity(tracklets[p], positions, frames)
        if found is None:
            dropped += 1
            continue
        identities[found].append(p)
        _fill(positions, found, tracklets[p], frames)
    order = np.argsort(-np.nanmedian(positions[..., 1], axis=0), kind="stable")
    labels = _labels(frames, tracklets, [identities[i] for i in order])
    take = MarkerTake(
        name,
        fps,
        tuple(f"M{i + 1:02d}" for i in range(worn)),
        positions[:, order],
        np.array([frame.number for frame in frames]),
        np.array([frame.time_s for frame in frames]),
    )
    return Tracking(take, labels, dropped)


def _join_points(frames: Sequence[MarkerFrame]) -> list[Tracklet]:
    tracklets: list[Tracklet] = []
    active: list[int] = []
    axes = _depth_axes(frames)
    for f, frame in enumerate(frames):
        active = [p for p in active if f - tracklets[p].frames[-1] <= _BRIDGE_FRAMES + 1]
        rows, columns = _follow([tracklets[p] for p in active], frames, f, axes[f])
        taken = set(columns.tolist())
        for row, column in zip(rows, columns, strict=True):
            _extend(tracklets[active[row]], frames, f, int(column), axes[f])
        for column in range(len(frame.points_m)):
            if column not in taken:
                tracklet = Tracklet()
                _extend(tracklet, frames, f, column, axes[f])
                active.append(len(tracklets))
                tracklets.append(tracklet)
    return tracklets


def _follow(
    active: Sequence[Tracklet], frames: Sequence[MarkerFrame], f: int, depth_axis: Array
) -> tuple[IntArray, IntArray]:
    """Return pairs of active tracklets and points of frame f."""
    points = frames[f].points_m
    if not active or len(points) == 0:
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    last = np.array([tracklet.position_m for tracklet in active])
    passed = np.array([frames[f].time_s - frames[tracklet.frames[-1]].time_s for tracklet in active])
    velocity = np.array([tracklet.velocity_m_s for tracklet in active])
    slow = bool(np.median(passed) >= _SLOW_RATE_S)
    expected = last if slow else last + velocity * passed[:, None]
    gates = np.minimum(_GATE_M + _GATE_SPEED_M_S * passed, _GATE_MOST_M)
    if not slow:  # a short one may be false and must not take a marker's place
        gates *= np.where([len(tracklet.frames) <= _GHOST_FRAMES for tracklet in active], _YOUNG_GATE, 1.0)
    else:
        expected = expected + _common_shift(expected, points, float(np.median(passed)))
    for _ in range(_SLOW_ROUNDS if slow else 1):
        rows, columns = assign(_squared_gates(points[None] - expected[:, None], gates[:, None], depth_axis))
        if len(rows) >= 3:
            expected = expected + np.median(points[columns] - expected[rows], axis=0)
    return rows, columns


def _squared_gates(difference: Array, across: Array | float, depth_axis: Array) -> Array:
    """Return squared distances in gates that are wider along the line of sight.

    Unsynchronised cameras see a marker that moves sideways at different places: its depth jumps from frame to frame
    by far more than it moves.
    """
    depth = difference @ depth_axis
    lateral2 = np.sum(difference**2, axis=-1) - depth**2
    return np.asarray(lateral2 / across**2 + (depth / (across + _DEPTH_JUMP_M)) ** 2)


def _depth_axes(frames: Sequence[MarkerFrame]) -> list[Array]:
    """Return per frame the unit vector of its points' largest uncertainty."""
    axes = []
    for frame in frames:
        if len(frame.points_m) == 0:
            axes.append(np.array([0.0, 0.0, 1.0]))
            continue
        scaled = frame.covariances_m2 / np.trace(frame.covariances_m2, axis1=1, axis2=2)[:, None, None]
        axes.append(np.asarray(np.linalg.eigh(scaled.mean(axis=0))[1][:, -1]))
    return axes


def _common_shift(expected: Array, points: Array, passed_s: float) -> Array:
    """Return the body's shift that brings most expected positions near a point."""
    shifts = (points[None] - expected[:, None]).reshape(-1, 3)
    shifts = np.concatenate((np.zeros((1, 3)), shifts))
    lengths = np.linalg.norm(shifts, axis=1)
    shifts = shifts[lengths <= _FASTEST_WALK_M_S * passed_s]
    best, best_cost = shifts[0], np.inf
    for shift in shifts:
        nearest = cdist(expected + shift, points).min(axis=1)
        cost = float(np.minimum(nearest, _GATE_MOST_M).sum() + 0.1 * np.linalg.norm(shift))
        if cost < best_cost:
            best, best_cost = shift, cost
    return np.asarray(best)


def _extend(tracklet: Tracklet, frames: Sequence[MarkerFrame], f: int, point: int, depth_axis: Array) -> None:
    position = frames[f].points_m[point]
    if tracklet.frames:
        passed = max(frames[f].time_s - frames[tracklet.frames[-1]].time_s, 1e-4)
        velocity = (position - tracklet.position_m) / passed
        tracklet.velocity_m_s = velocity - (1.0 - _DEPTH_TRUST) * (velocity @ depth_axis) * depth_axis
    tracklet.position_m = position
    tracklet.frames.append(f)
    tracklet.points.append(point)


def _alive(tracklets: Sequence[Tracklet], count: int) -> list[list[int]]:
    table: list[list[int]] = [[] for _ in range(count)]
    for p, tracklet in enumerate(tracklets):
        for f in tracklet.frames:
            table[f].append(p)
    return table


def _usual_count(tracklets: Sequence[Tracklet], count: int) -> int:
    """Return how many markers a fair share of the frames shows, short tracklets aside."""
    longest = [tracklet for tracklet in tracklets if len(tracklet.frames) > _GHOST_FRAMES] or list(tracklets)
    shown = np.zeros(count, dtype=np.int64)
    for tracklet in longest:
        shown[tracklet.frames] += 1
    if np.sum(shown > 0) <= _FAIR_SHARE * count:
        raise TakeError(
            "hardly any markers were found", advice="check the threshold, the cameras' order and the calibration"
        )
    return int(np.sort(shown)[::-1][int(_FAIR_SHARE * count)])


def _seed_frame(tracklets: Sequence[Tracklet], table: Sequence[Sequence[int]], worn: int) -> int:
    """Return the frame where the longest tracklets for all markers are seen at once."""
    scores = [
        sum(sorted((len(tracklets[p].frames) for p in row), reverse=True)[:worn]) if len(row) >= worn else -1
        for row in table
    ]
    if max(scores, default=-1) < 0:
        most = max((len(row) for row in table), default=0)
        raise TakeError(
            f"at most {most} of {worn} markers are located at once",
            advice="check that both cameras see the markers, or give the right marker set",
        )
    return int(np.argmax(scores))


def _distance_in_time(tracklet: Tracklet, f: int) -> int:
    return max(tracklet.frames[0] - f, f - tracklet.frames[-1], 0)


def _fill(positions: Array, marker: int, tracklet: Tracklet, frames: Sequence[MarkerFrame]) -> None:
    """Fill a marker's gaps from a tracklet; cut the rest off the tracklet."""
    kept = [i for i, f in enumerate(tracklet.frames) if np.isnan(positions[f, marker, 0])]
    tracklet.frames, tracklet.points = [tracklet.frames[i] for i in kept], [tracklet.points[i] for i in kept]
    for f, point in zip(tracklet.frames, tracklet.points, strict=True):
        positions[f, marker] = frames[f].points_m[point]


def _best_identity(tracklet: Tracklet, positions: Array, frames: Sequence[MarkerFrame]) -> int | None:
    """Return a tracklet's marker, None when no free one fits."""
    where = np.array(tracklet.frames)
    own = np.array([frames[f].points_m[point] for f, point in zip(tracklet.frames, tracklet.points, strict=True)])
    taken = np.isfinite(positions[where, :, 0]).sum(axis=0)
    # a false point may have ended one tracklet a frame after the next began
    free = np.flatnonzero(taken <= min(_OVERLAP_FRAMES, len(where) // 4))
    if len(free) == 0:
        return None
    costs = np.array(
        [_structure_cost(where, own, marker, positions) + _gap_cost(where, own, marker, positions, frames)
         for marker in free]
    )  # fmt: skip
    best = int(costs.argmin())
    limit = _COST_LIMIT if len(where) > _GHOST_FRAMES else _YOUNG_COST_LIMIT
    return int(free[best]) if costs[best] < limit else None


def _structure_cost(where: IntArray, own: Array, marker: int, positions: Array) -> float:
    """Return the squared deviation, in sigmas, from usual distances to other markers."""
    usual = np.linalg.norm(positions - positions[:, marker : marker + 1], axis=2)
    usual[:, marker] = np.nan
    seen = np.isfinite(usual).sum(axis=0)
    there = np.isfinite(positions[where, :, 0]).any(axis=0) & (seen >= 2)
    if not there.any():
        return 0.0
    mean, spread = np.nanmean(usual[:, there], axis=0), np.nanstd(usual[:, there], axis=0)
    distance = np.linalg.norm(positions[where][:, there] - own[:, None], axis=2)
    sigma2 = spread**2 + _STRUCTURE_SIGMA_M**2
    deviation = np.minimum((distance - mean) ** 2 / sigma2, _COST_CAP)
    weight = np.where(np.isfinite(deviation), 1.0 / np.sqrt(sigma2), 0.0)
    return float(np.sum(np.nan_to_num(deviation) * weight) / weight.sum())


def _gap_cost(where: IntArray, own: Array, marker: int, positions: Array, frames: Sequence[MarkerFrame]) -> float:
    """Return the squared distance, in sigmas, to the marker before and after."""
    known = np.flatnonzero(np.isfinite(positions[:, marker, 0]))
    axis = _depth_axes([frames[int(where[0])]])[0]
    costs = []
    before, after = known[known < where[0]], known[known > where[-1]]
    for mine, point, nearest in ((where[0], own[0], before[-1:]), (where[-1], own[-1], after[:1])):
        if len(nearest) == 0:
            continue
        other = int(nearest[0])
        gap_s = abs(frames[int(mine)].time_s - frames[other].time_s)
        sigma = _CONTINUITY_M + _CONTINUITY_M_S * gap_s
        squared = _squared_gates(point - positions[other, marker], sigma, axis)
        costs.append(min(float(squared), _COST_CAP))
    return float(np.mean(costs)) if costs else 0.0


def _labels(
    frames: Sequence[MarkerFrame], tracklets: Sequence[Tracklet], identities: Sequence[Sequence[int]]
) -> tuple[IntArray, ...]:
    labels = tuple(np.full(len(frame.points_m), -1, dtype=np.int64) for frame in frames)
    for marker, row in enumerate(identities):
        for p in row:
            for f, point in zip(tracklets[p].frames, tracklets[p].points, strict=True):
                labels[f][point] = marker
    return labels
