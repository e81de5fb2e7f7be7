"""Search for database motion that explains the keys of a sketch.

The time between keys is divided into stretches. For each stretch, all windows of the database are turned and moved on
the floor to where they fit the controls best (in closed form, on points of the plane). Dynamic programming then chooses
one window per stretch: near the keys, roughly near the curves between them, and continuing the previous window.
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

_MIDDLE = ("root", "lowerback", "upperback", "thorax", "lowerneck", "upperneck", "head")
_HANDS = ("lhand", "rhand")


@dataclass(frozen=True)
class RetrievalSettings:
    """Settings of the search; a key has weight 1."""

    rates: tuple[float, ...] = (1.0, 0.87, 1.15)  # speeds at which a window may be played
    context_s: float = 0.2  # time beyond a stretch that is also compared, and blended with the neighbours
    stretch_s: tuple[float, float] = (0.2, 0.55)  # shortest and longest stretch
    curve_step_s: float = 0.12  # interval between two samples of a curve
    curve_weights: tuple[float, float] = (0.01, 0.15)  # weights of a sample for a `follow` of 0 and of 1
    foot_curve: float = 0.1  # factor of that weight for feet, which are planted and step where a curve glides
    outside_weight: float = 0.001  # weight of a sample before or after a control's keys: a tie-breaker
    candidates: int = 48  # windows per stretch from which dynamic programming chooses
    neighbours: int = 160  # windows per stretch that are kept
    apart_s: float = 0.1  # shortest interval between the starts of two windows from one clip
    join_weight: float = 0.5  # weight of the body's mean squared change where windows join
    velocity_s: float = 0.15  # time by which a change of velocity is multiplied to compare it with a distance
    same_m: float = 0.002  # samples that moved less (m or s) count as unchanged
    most_same_m: float = 0.01  # upper limit of this distance for samples with a small weight
    # cost of moving backwards if no control shows the heading, half of it for moving sideways, m2 per m2
    forwards_weight: float = 0.3
    hanging_weight: float = 0.02  # cost of hands without a control above their hanging height, m2 per m2
    taken_s: float = 0.5  # a variation uses no window that starts within this time of one used before


SETTINGS = RetrievalSettings()


@dataclass(frozen=True)
class Samples:
    """Keys and curve samples that windows are compared with.

    Args:
        times_s: Times (N,) since the sketch's first frame.
        columns: Columns (N,) of the joints in the library.
        planar: Positions (N,) z + i x on the floor, metres.
        heights_m: Heights (N,).
        weights: Weights (N,), 1 for keys.
    """

    times_s: Array
    columns: IntArray
    planar: Complex
    heights_m: Array
    weights: Array

    def same(self, other: "Samples") -> bool:
        """Return whether no sample has moved, within tolerances that are larger for small weights."""
        if len(self.times_s) != len(other.times_s) or not np.array_equal(self.columns, other.columns):
            return False
        changes = [np.abs(one - two) for one, two in zip(vars(self).values(), vars(other).values(), strict=True)]
        same_m = SETTINGS.same_m
        near_m = np.minimum(same_m / np.sqrt(np.maximum(self.weights, 1e-9)), SETTINGS.most_same_m)
        limits = same_m, same_m, near_m, near_m, same_m
        return all(bool(np.all(change < limit)) for change, limit in zip(changes, limits, strict=True))

    def between(self, first_s: float, last_s: float) -> "Samples":
        """Return the samples from one time to another."""
        kept = (self.times_s >= first_s - 1e-6) & (self.times_s <= last_s + 1e-6)
        return Samples(*(values[kept] for values in vars(self).values()))


@dataclass(frozen=True)
class Stretch:
    """Time between two joins (first to last) and with context (before to after), s since the sketch's first frame."""

    first_s: float
    last_s: float
    before_s: float
    after_s: float

    def shows(self, times_s: Array) -> Mask:
        """Return a mask (T,) of the times in the stretch or its context."""
        return np.asarray((times_s >= self.before_s - 1e-9) & (times_s <= self.after_s + 1e-9))


@dataclass(frozen=True)
class Windows:
    """Windows of the database placed at a stretch, nearest first.

    Args:
        starts: Database frames (K,) at the stretch's start.
        rates: Database seconds (K,) per second.
        turns: Yaws (K,) as exp(i yaw).
        shifts: Shifts (K,) on the floor, metres.
        costs: Mean squared distances (K,) from the controls, m2.
    """

    starts: IntArray
    rates: Array
    turns: Complex
    shifts: Complex
    costs: Array

    def picked(self, which: IntArray) -> "Windows":
        """Return the windows with the given indices."""
        return Windows(*(values[which] for values in vars(self).values()))


def samples_of(sketch: Sketch, library: MotionLibrary, follow: float) -> Samples:
    """Return the keys of a sketch and samples of its curves, weighted by `follow`."""
    start, weight = sketch.frames[0], float(np.interp(follow, (0.0, 1.0), SETTINGS.curve_weights))
    step = SETTINGS.curve_step_s * sketch.fps
    rows = []
    for control in sketch.controls:
        column = library.columns[control.joint]
        times_s = (control.frames - start) / sketch.fps
        keys = np.column_stack((times_s, control.positions_m, np.ones(len(times_s))))
        steps = np.arange(start, sketch.frames[-1], step)
        inside = (steps >= control.frames[0]) & (steps <= control.frames[-1])
        foot_curve = SETTINGS.foot_curve if control.joint in FEET else 1.0
        weights = np.where(inside, weight * foot_curve, SETTINGS.outside_weight)
        between = np.abs(steps[:, None] - control.frames).min(axis=1) > 0.3 * step
        curve = np.column_stack(((steps - start) / sketch.fps, control.curve(steps), weights))
        if control.height_is_free:
            keys[:, 2] = curve[:, 2] = np.median(library.heights_m[:, column])
        for part in (keys, curve[between]):
            rows.append(np.column_stack((part, np.full(len(part), column))))
    table = np.concatenate(rows)
    table = table[np.argsort(table[:, 0], kind="stable")]
    planar = table[:, 3] + 1j * table[:, 1]
    return Samples(table[:, 0], table[:, 5].astype(np.int64), planar, table[:, 2], table[:, 4])


def stretches_of(sketch: Sketch) -> list[Stretch]:
    """Return the stretches between the keys' times."""
    end_s = (sketch.frames[-1] - sketch.frames[0]) / sketch.fps
    keyed = np.unique(np.concatenate([control.frames for control in sketch.controls]))
    joins = [0.0]
    shortest_s, longest_s = SETTINGS.stretch_s
    for time_s in ((keyed - sketch.frames[0]) / sketch.fps)[1:].tolist():
        if time_s - joins[-1] > longest_s:
            parts = int(np.ceil((time_s - joins[-1]) / longest_s))
            joins += [joins[-1] + (time_s - joins[-1]) * part / parts for part in range(1, parts)]
        if time_s - joins[-1] >= shortest_s:
            joins.append(time_s)
    if end_s - joins[-1] > 1e-6:
        joins[len(joins) - (len(joins) > 1) :] = [end_s]
    if len(joins) == 1:
        return [Stretch(0.0, 0.0, 0.0, 0.0)]
    return [
        Stretch(first_s, last_s, max(0.0, first_s - SETTINGS.context_s), min(end_s, last_s + SETTINGS.context_s))
        for first_s, last_s in pairwise(joins)
    ]


def nearest_windows(library: MotionLibrary, near: Samples, stretch: Stretch) -> Windows:
    """Return the windows nearest to the controls, spaced apart from each other.

    Args:
        near: Samples within the stretch and its context.

    Raises:
        DatabaseError: No clip is long enough.
    """
    found = [_placed(library, near, stretch, rate) for rate in SETTINGS.rates]
    if not any(len(windows.starts) for windows in found):
        longest_s = stretch.after_s - stretch.before_s
        advice = "choose more behaviours, or build a database of longer clips"
        raise DatabaseError(f"has no usable clip of at least {longest_s:.1f} s", advice=advice)
    windows = Windows(*(np.concatenate(parts) for parts in zip(*(vars(f).values() for f in found), strict=True)))
    windows = replace(windows, costs=windows.costs + _unlikeliness(library, near, stretch, windows))
    order = np.argsort(windows.costs, kind="stable")[: 40 * SETTINGS.neighbours]
    apart = SETTINGS.apart_s * library.fps
    taken: set[int] = set()
    kept = []
    for index in order.tolist():
        place = int(windows.starts[index] / apart)
        if taken.isdisjoint((place - 1, place, place + 1)):
            taken.add(place)
            kept.append(index)
            if len(kept) == SETTINGS.neighbours:
                break
    return windows.picked(np.array(kept, dtype=np.int64))


def _unlikeliness(library: MotionLibrary, near: Samples, stretch: Stretch, windows: Windows) -> Array:
    """Return costs (K,), m2, of movements that no control asks for."""
    column, first = library.columns, windows.starts
    keyed = set(near.columns[near.weights > SETTINGS.outside_weight].tolist())
    costs = np.zeros(len(first))
    for hand in (column[name] for name in _HANDS if column[name] not in keyed):
        above_m = library.heights_m[first, hand] - library.heights_m[first, column["root"]]
        costs += 0.5 * SETTINGS.hanging_weight * np.maximum(above_m - library.hanging_m, 0.0) ** 2
    if keyed <= {column[name] for name in _MIDDLE if name in column}:
        last = first + np.round((stretch.last_s - stretch.first_s) * windows.rates * library.fps).astype(np.int64)
        way = library.planar[last, column["root"]] - library.planar[first, column["root"]]
        ahead = -1j * (library.planar[first, column["lfemur"]] - library.planar[first, column["rfemur"]])
        forwards = np.real(np.conj(ahead / np.maximum(np.abs(ahead), 1e-9)) * way)
        costs += 0.5 * SETTINGS.forwards_weight * np.abs(way) * (np.abs(way) - forwards)
    return costs


def _placed(library: MotionLibrary, near: Samples, stretch: Stretch, rate: float) -> Windows:
    """Return all windows of one rate, each placed where it fits best."""
    per_s = library.fps * rate
    first = floor((stretch.before_s - stretch.first_s) * per_s)
    starts = library.starts(first, ceil((stretch.after_s - stretch.first_s) * per_s))
    total = max(float(near.weights.sum()), 1e-9)
    weights = (near.weights / total).astype(np.float32)
    middle = complex(weights @ near.planar) if len(weights) else 0j
    sums = np.zeros(len(starts), dtype=np.complex64)
    across, (squares, off) = np.zeros_like(sums), np.zeros((2, len(starts)), dtype=np.float32)
    for time_s, column, goal, height_m, weight in zip(
        near.times_s, near.columns, near.planar, near.heights_m, weights, strict=True
    ):
        frames = starts + round((time_s - stretch.first_s) * per_s)
        points = library.planar[:, column][frames]
        sums += weight * points
        squares += weight * (points.real**2 + points.imag**2)
        across += np.conj(points) * np.complex64(weight * (goal - middle))
        off += weight * (library.heights_m[:, column][frames] - np.float32(height_m)) ** 2
    squares -= sums.real**2 + sums.imag**2
    spread = float(weights @ np.abs(near.planar - middle) ** 2) if len(weights) else 0.0
    sizes = np.abs(across)
    turns = np.where(sizes > 1e-9, across / np.maximum(sizes, 1e-9), 1.0).astype(np.complex128)
    costs = np.maximum(squares + spread - 2.0 * sizes, 0.0) + off
    return Windows(starts, np.full(len(starts), rate), turns, middle - turns * sums, costs)


def choose_windows(
    library: MotionLibrary, stretches: list[Stretch], candidates: list[Windows], variation: int = 0
) -> list[int]:
    """Return the index of the chosen window of each stretch (Viterbi 1967).

    Args:
        variation: Number of better explanations to skip; the motion that they use is excluded.
    """
    allowed = [np.ones(len(windows.starts), dtype=np.bool_) for windows in candidates]
    chosen = _best_path(library, stretches, candidates, allowed)
    for _ in range(variation):
        for windows, index, free in zip(candidates, chosen, allowed, strict=True):
            free &= np.abs(windows.starts - windows.starts[index]) > SETTINGS.taken_s * library.fps
            if not free.any():
                free[:] = True
        chosen = _best_path(library, stretches, candidates, allowed)
    return chosen


def _best_path(
    library: MotionLibrary, stretches: list[Stretch], candidates: list[Windows], allowed: list[Mask]
) -> list[int]:
    kept = [np.flatnonzero(free)[: SETTINGS.candidates] for free in allowed]
    costs = candidates[0].costs[kept[0]]
    links = []
    for index in range(1, len(stretches)):
        before, after = (candidates[at].picked(kept[at]) for at in (index - 1, index))
        change = _changes(library, (before, stretches[index - 1]), (after, stretches[index]))
        totals = costs[:, None] + SETTINGS.join_weight * change
        links.append(np.argmin(totals, axis=0))
        costs = totals.min(axis=0) + after.costs
    path = [int(np.argmin(costs))]
    for link in reversed(links):
        path.append(int(link[path[-1]]))
    return [int(kept[at][index]) for at, index in enumerate(reversed(path))]


def _changes(library: MotionLibrary, before: tuple[Windows, Stretch], after: tuple[Windows, Stretch]) -> Array:
    """Return mean squared changes (K, K) of the body where windows join, m2."""
    sides = [_state(library, windows, after[1].first_s - stretch.first_s) for windows, stretch in (before, after)]
    squares = [np.sum(side**2, axis=1) for side in sides]
    return np.maximum(squares[0][:, None] + squares[1] - 2.0 * sides[0] @ sides[1].T, 0.0) / len(BODY)


def _state(library: MotionLibrary, windows: Windows, time_s: float) -> Array:
    """Return the positions of the body's joints and their changes (K, 6 B)."""
    columns, step_s = [library.columns[name] for name in BODY], min(2.0 / library.fps, 0.5 * SETTINGS.context_s)
    now, then = (shown_at(library, windows, np.full(len(BODY), at_s), columns) for at_s in (time_s, time_s + step_s))
    return np.concatenate((now, SETTINGS.velocity_s * (then - now) / step_s), axis=1)


def shown_at(library: MotionLibrary, windows: Windows, times_s: Array, columns: Sequence[int] | IntArray) -> Array:
    """Return the positions (K, 3 N), metres, of joints (N,) at times (N,) in each of K windows."""
    frames = windows.starts[:, None] + np.round(times_s * windows.rates[:, None] * library.fps).astype(np.int64)
    planar = windows.turns[:, None] * library.planar[frames, columns] + windows.shifts[:, None]
    return np.concatenate((planar.real, planar.imag, library.heights_m[frames, columns]), axis=1)
