"""Search for database motion that explains the keys of a sketch.

The time between keys is cut into stretches. For each, all windows of the database are turned and moved on the floor
(closed form, over points on the plane) to where they fit the controls best. Dynamic programming then chooses one for
each stretch: near the keys, somewhat near the curves between, and each going on from the one before.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

from ..errors import DatabaseError
from ..geometry.arrays import Array, IntArray, Mask
from .motion_library import BODY, MotionLibrary
from .sketch_file import FEET, Sketch

Complex = NDArray[np.complex128]

RATES = (1.0, 0.87, 1.15)  # at which a window may be played
CONTEXT_S = 0.2  # beyond a stretch that a window is compared, and blended with its neighbours
_SHORTEST_S, _LONGEST_S = 0.2, 0.55  # of a stretch
_CURVE_STEP_S = 0.12  # between two looks at a curve
_CURVE_WEIGHTS = 0.01, 0.15  # of such a look without and with full `follow`, a key's being 1
_FOOT_CURVE = 0.1  # of that weight for feet: they stand and step, and between keys a step or more apart no curve does
_OUTSIDE_WEIGHT = 0.001  # before a control's first key and after its last: where nothing else says where the body is
_CANDIDATES = 48  # windows of a stretch among which is chosen,
NEIGHBOURS = 160  # and that are known near the keys
_APART_S = 0.1  # two candidates of one clip begin at least so far apart
_JOIN_WEIGHT = 0.5  # of the change at a join (m2), the keys' being 1
_VELOCITY_S = 0.15  # that a change of velocity counts
_SAME_M, _MOST_SAME_M = 0.002, 0.01  # or s
# where no control says which way the body faces and where hands are, windows that go forwards are preferred (m2 a
# squared metre gone backwards, half of it sideways), and those with hanging hands (m2 a squared metre higher)
_FORWARDS_WEIGHT, _HANGING_WEIGHT = 0.3, 0.02
_MIDDLE = ("root", "lowerback", "upperback", "thorax", "lowerneck", "upperneck", "head")
_HANDS = ("lhand", "rhand")
_TAKEN_S = 0.5  # another explanation begins so far from those before


@dataclass(frozen=True)
class Looks:
    """Points of controls that windows are compared with.

    Args:
        times_s: (N,) since the sketch's first frame.
        columns: (N,) of the joints in the library.
        planar: (N,) z + i x, metres.
        heights_m, weights: (N,).
    """

    times_s: Array
    columns: IntArray
    planar: Complex
    heights_m: Array
    weights: Array

    def same(self, other: "Looks") -> bool:
        """Return whether all are where others are, but for 2 mm, more for a small weight."""
        if len(self.times_s) != len(other.times_s) or not np.array_equal(self.columns, other.columns):
            return False
        changes = [np.abs(one - two) for one, two in zip(vars(self).values(), vars(other).values(), strict=True)]
        near_m = np.minimum(_SAME_M / np.sqrt(np.maximum(self.weights, 1e-9)), _MOST_SAME_M)
        limits = _SAME_M, _SAME_M, near_m, near_m, _SAME_M
        return all(bool(np.all(change < limit)) for change, limit in zip(changes, limits, strict=True))

    def between(self, first_s: float, last_s: float) -> "Looks":
        """Return those of a time."""
        kept = (self.times_s >= first_s - 1e-6) & (self.times_s <= last_s + 1e-6)
        return Looks(*(values[kept] for values in vars(self).values()))


@dataclass(frozen=True)
class Stretch:
    """Time between two joins, in seconds since the sketch's first frame, with context."""

    first_s: float
    last_s: float
    before_s: float
    after_s: float

    def shows(self, times_s: Array) -> Mask:
        """Return (T,) whether times are in it or its context."""
        return np.asarray((times_s >= self.before_s - 1e-9) & (times_s <= self.after_s + 1e-9))


@dataclass(frozen=True)
class Windows:
    """Windows of the database placed at a stretch, nearest first.

    Args:
        starts: (K,) frames of the database at the stretch's first moment.
        rates: (K,) database seconds in a second.
        turns: (K,) exp(i yaw); shifts: (K,) metres on the plane.
        costs: (K,) mean squared distance from the controls, m2.
    """

    starts: IntArray
    rates: Array
    turns: Complex
    shifts: Complex
    costs: Array

    def picked(self, which: IntArray) -> "Windows":
        """Return some of them."""
        return Windows(*(values[which] for values in vars(self).values()))


def looks_of(sketch: Sketch, library: MotionLibrary, follow: float) -> Looks:
    """Return the points of a sketch: keys, and curves between as far as followed."""
    start, weight = sketch.frames[0], float(np.interp(follow, (0.0, 1.0), _CURVE_WEIGHTS))
    rows = []
    for control in sketch.controls:
        column = library.columns[control.joint]
        keys = np.column_stack(
            ((control.frames - start) / sketch.fps, control.positions_m, np.ones(len(control.frames)))
        )
        steps = np.arange(start, sketch.frames[-1], _CURVE_STEP_S * sketch.fps)
        times_s = (steps - start) / sketch.fps
        inside = (steps >= control.frames[0]) & (steps <= control.frames[-1])
        weights = np.where(inside, weight * (_FOOT_CURVE if control.joint in FEET else 1.0), _OUTSIDE_WEIGHT)
        between = np.abs(steps[:, None] - control.frames).min(axis=1) > 0.3 * _CURVE_STEP_S * sketch.fps
        curve = np.column_stack((times_s, control.curve(steps), weights))
        if control.height_is_free:
            keys[:, 2] = curve[:, 2] = np.median(library.heights_m[:, column])
        for part in (keys, curve[between]):
            rows.append(np.column_stack((part, np.full(len(part), column))))
    table = np.concatenate(rows)
    table = table[np.argsort(table[:, 0], kind="stable")]
    planar = table[:, 3] + 1j * table[:, 1]
    return Looks(table[:, 0], table[:, 5].astype(np.int64), planar, table[:, 2], table[:, 4])


def stretches_of(sketch: Sketch) -> list[Stretch]:
    """Return the stretches between the keys' times."""
    end_s = (sketch.frames[-1] - sketch.frames[0]) / sketch.fps
    keyed = np.unique(np.concatenate([control.frames for control in sketch.controls]))
    joins = [0.0]
    for time_s in ((keyed - sketch.frames[0]) / sketch.fps)[1:].tolist():
        if time_s - joins[-1] > _LONGEST_S:
            parts = int(np.ceil((time_s - joins[-1]) / _LONGEST_S))
            joins += [joins[-1] + (time_s - joins[-1]) * part / parts for part in range(1, parts)]
        if time_s - joins[-1] >= _SHORTEST_S:
            joins.append(time_s)
    if end_s - joins[-1] > 1e-6:
        joins[len(joins) - (len(joins) > 1) :] = [end_s]
    if len(joins) == 1:
        return [Stretch(0.0, 0.0, 0.0, 0.0)]
    return [
        Stretch(first_s, last_s, max(0.0, first_s - CONTEXT_S), min(end_s, last_s + CONTEXT_S))
        for first_s, last_s in pairwise(joins)
    ]


def nearest_windows(library: MotionLibrary, near: Looks, stretch: Stretch) -> Windows:
    """Return the windows nearest to the controls, well apart from each other.

    Args:
        near: looks in the time of the stretch and its context.

    Raises:
        DatabaseError: no clip is as long.
    """
    found = [_placed(library, near, stretch, rate) for rate in RATES]
    if not any(len(windows.starts) for windows in found):
        longest_s = stretch.after_s - stretch.before_s
        advice = "choose more behaviours, or build a database of longer clips"
        raise DatabaseError(f"has no clip of {longest_s:.1f} s to draw from", advice=advice)
    windows = Windows(*(np.concatenate(parts) for parts in zip(*(vars(f).values() for f in found), strict=True)))
    windows = replace(windows, costs=windows.costs + _unlikeliness(library, near, stretch, windows))
    order = np.argsort(windows.costs, kind="stable")[: 40 * NEIGHBOURS]
    apart = _APART_S * library.fps
    taken: set[int] = set()
    kept = []
    for index in order.tolist():
        place = int(windows.starts[index] / apart)
        if taken.isdisjoint((place - 1, place, place + 1)):
            taken.add(place)
            kept.append(index)
            if len(kept) == NEIGHBOURS:
                break
    return windows.picked(np.array(kept, dtype=np.int64))


def _unlikeliness(library: MotionLibrary, near: Looks, stretch: Stretch, windows: Windows) -> Array:
    """Return costs (K,), m2, of movements that no control asks for."""
    column, first = library.columns, windows.starts
    keyed = set(near.columns[near.weights > _OUTSIDE_WEIGHT].tolist())
    costs = np.zeros(len(first))
    for hand in (column[name] for name in _HANDS if column[name] not in keyed):
        above_m = library.heights_m[first, hand] - library.heights_m[first, column["root"]]
        costs += 0.5 * _HANGING_WEIGHT * np.maximum(above_m - library.hanging_m, 0.0) ** 2
    if keyed <= {column[name] for name in _MIDDLE if name in column}:
        last = first + np.round((stretch.last_s - stretch.first_s) * windows.rates * library.fps).astype(np.int64)
        way = library.planar[last, column["root"]] - library.planar[first, column["root"]]
        ahead = -1j * (library.planar[first, column["lfemur"]] - library.planar[first, column["rfemur"]])
        forwards = np.real(np.conj(ahead / np.maximum(np.abs(ahead), 1e-9)) * way)
        costs += 0.5 * _FORWARDS_WEIGHT * np.abs(way) * (np.abs(way) - forwards)
    return costs


def _placed(library: MotionLibrary, looks: Looks, stretch: Stretch, rate: float) -> Windows:
    """Return all windows of a rate, each placed where it fits best."""
    per_s = library.fps * rate
    first = floor((stretch.before_s - stretch.first_s) * per_s)
    starts = library.starts(first, ceil((stretch.after_s - stretch.first_s) * per_s))
    total = max(float(looks.weights.sum()), 1e-9)
    weights = (looks.weights / total).astype(np.float32)
    middle = complex(weights @ looks.planar) if len(weights) else 0j
    sums = np.zeros(len(starts), dtype=np.complex64)
    across, (squares, off) = np.zeros_like(sums), np.zeros((2, len(starts)), dtype=np.float32)
    for time_s, column, goal, height_m, weight in zip(
        looks.times_s, looks.columns, looks.planar, looks.heights_m, weights, strict=True
    ):
        frames = starts + round((time_s - stretch.first_s) * per_s)
        points = library.planar[:, column][frames]
        sums += weight * points
        squares += weight * (points.real**2 + points.imag**2)
        across += np.conj(points) * np.complex64(weight * (goal - middle))
        off += weight * (library.heights_m[:, column][frames] - np.float32(height_m)) ** 2
    squares -= sums.real**2 + sums.imag**2
    spread = float(weights @ np.abs(looks.planar - middle) ** 2) if len(weights) else 0.0
    sizes = np.abs(across)
    turns = np.where(sizes > 1e-9, across / np.maximum(sizes, 1e-9), 1.0).astype(np.complex128)
    costs = np.maximum(squares + spread - 2.0 * sizes, 0.0) + off
    return Windows(starts, np.full(len(starts), rate), turns, middle - turns * sums, costs)


def choose_windows(
    library: MotionLibrary, stretches: list[Stretch], candidates: list[Windows], variation: int = 0
) -> list[int]:
    """Return the index of the chosen window of each stretch (Viterbi 1967).

    Args:
        variation: how many better explanations to leave out; each excludes the motion that it drew from.
    """
    allowed = [np.ones(len(windows.starts), dtype=np.bool_) for windows in candidates]
    chosen = _best_path(library, stretches, candidates, allowed)
    for _ in range(variation):
        for windows, index, free in zip(candidates, chosen, allowed, strict=True):
            free &= np.abs(windows.starts - windows.starts[index]) > _TAKEN_S * library.fps
            if not free.any():
                free[:] = True
        chosen = _best_path(library, stretches, candidates, allowed)
    return chosen


def _best_path(
    library: MotionLibrary, stretches: list[Stretch], candidates: list[Windows], allowed: list[Mask]
) -> list[int]:
    kept = [np.flatnonzero(free)[:_CANDIDATES] for free in allowed]
    costs = candidates[0].costs[kept[0]]
    links = []
    for index in range(1, len(stretches)):
        before, after = (candidates[at].picked(kept[at]) for at in (index - 1, index))
        change = _changes(library, (before, stretches[index - 1]), (after, stretches[index]))
        totals = costs[:, None] + _JOIN_WEIGHT * change
        links.append(np.argmin(totals, axis=0))
        costs = totals.min(axis=0) + after.costs
    path = [int(np.argmin(costs))]
    for link in reversed(links):
        path.append(int(link[path[-1]]))
    return [int(kept[at][index]) for at, index in enumerate(reversed(path))]


def _changes(library: MotionLibrary, before: tuple[Windows, Stretch], after: tuple[Windows, Stretch]) -> Array:
    """Return (K, K) mean squared changes of the body where windows join, m2."""
    sides = [_state(library, windows, after[1].first_s - stretch.first_s) for windows, stretch in (before, after)]
    squares = [np.sum(side**2, axis=1) for side in sides]
    return np.maximum(squares[0][:, None] + squares[1] - 2.0 * sides[0] @ sides[1].T, 0.0) / len(BODY)


def _state(library: MotionLibrary, windows: Windows, time_s: float) -> Array:
    """Return (K, 6 B) places of the body's joints and how they change."""
    columns, step_s = [library.columns[name] for name in BODY], min(2.0 / library.fps, 0.5 * CONTEXT_S)
    now, then = (shown_at(library, windows, np.full(len(BODY), at_s), columns) for at_s in (time_s, time_s + step_s))
    return np.concatenate((now, _VELOCITY_S * (then - now) / step_s), axis=1)


def shown_at(library: MotionLibrary, windows: Windows, times_s: Array, columns: Sequence[int] | IntArray) -> Array:
    """Return (K, 3 N) places, m, where windows show joints (N,) at times (N,)."""
    frames = windows.starts[:, None] + np.round(times_s * windows.rates[:, None] * library.fps).astype(np.int64)
    planar = windows.turns[:, None] * library.planar[frames, columns] + windows.shifts[:, None]
    return np.concatenate((planar.real, planar.imag, library.heights_m[frames, columns]), axis=1)
