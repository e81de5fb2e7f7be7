"""When and where the feet of a sketch stand.

Between two keys that one place of the toes explains, a foot stands, and the ankle turns about the toes. Between
others it steps, no longer than the way needs and when fewest of the database's examples stand; else it stands whenever
enough of them do. Between keys more than a stride apart it steps when the database's motion does. So do feet without a
key.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter1d

from ..geometry.arrays import Array, IntArray, Mask, runs
from .key_curves import curve_positions

_STANDS = 0.5  # share of the examples that stand
_MAY_STAND = 0.3  # between keys with a way such a share of the largest there is enough
_STAYED_M, _STAYED_M_S = 0.04, 0.1  # a foot stands between two keys that are no further apart, at no higher speed
# it stands on its toes between two keys of which the toes' places differ by less (the second where most examples
# stand), the ankles by less on the floor, and the length of the foot by less
_TOES_M, _STEADY_TOES_M, _ANKLES_M, _LENGTH_M = 0.03, 0.05, 0.1, 0.015
_SOME_STAND, _MOST_STAND = 0.3, 0.7
_STEP_M_S, _SHORTEST_STEP_S = 2.0, 0.07  # mean speed of a step,
_FASTEST_M_S = 5.0  # and from one place to the next
_LONGEST_STEP = 0.35  # share of the time between two keys that a step takes unless examples take longer
# between two keys further apart, in metres and seconds, a foot takes several steps: it stands where most examples do,
# and the database's motion is slower, in metres a second
_STRIDE_M, _STRIDE_S, _SLOW_M_S = 0.6, 1.2, 0.5
_SHORTEST_CONTACT_S, _CONTACT_S = 0.05, 0.13  # shorter ones are none, and those between last the second
_MOVING_S = 0.01  # a frame of a step counts as that many shares for each metre that the database's motion moves then
_CLEAR_M, _LIFTED_S = 0.025, 0.1  # a stepping foot is so far above the floor, so long after it has left it
_LIFTED_M_S = 1.0  # at this speed; less at a lower one
_FLOOR_M = 0.12  # a foot that stands higher, or lower, stands on something else
_STEEPEST, _LEAST_AHEAD = 0.95, 0.3  # of the foot's length, within which toes are turned onto the floor
_PULL = 0.3  # of the toes' wanted place on where they stand, the length of the foot being 1
_ROUNDS = 4


@dataclass(frozen=True)
class Foot:
    """A foot in the database's motion, and its keys.

    Args:
        ankle_m, toes_m: (F, 3) in the database's motion.
        displacement_m: (F, 3) to the keys, without contacts.
        keyed: (K,) frames with a key, ascending.
        by_toes: whether the keys are the toes', not the ankle's.
    """

    ankle_m: Array
    toes_m: Array
    displacement_m: Array
    keyed: IntArray
    by_toes: bool = False

    @property
    def wanted_ankle_m(self) -> Array:
        """(F, 3) without contacts."""
        return self.ankle_m + self.displacement_m

    @property
    def wanted_toes_m(self) -> Array:
        """(F, 3) without contacts."""
        return self.toes_m + self.displacement_m

    @property
    def length_m(self) -> Array:
        """(F,) from ankle to toes."""
        return np.asarray(np.linalg.norm(self.toes_m - self.ankle_m, axis=1))


@dataclass(frozen=True)
class HeldFoot:
    """Targets of a foot: ankle_m and toes_m (F, 3), and whether it stands (F,)."""

    ankle_m: Array
    toes_m: Array
    stands: Mask


def held_foot(foot: Foot, share: Array, floor_m: float | None, fps: float) -> HeldFoot:
    """Return a foot that stays in place while it stands, and is lifted while it steps.

    Args:
        share: (F,) of the database's examples in which it stands.
        floor_m: height of standing toes on the floor, for those near it; None to leave them.
    """
    added, places = np.zeros((len(share), 6)), np.full_like(foot.toes_m, np.nan)  # to the wanted ankle and toes
    known = np.zeros(len(share), dtype=np.bool_)
    known[foot.keyed] = True
    for first, stop in stances_of(foot, share, fps):
        inside = np.arange(first, stop)
        ankles, places[inside] = _standing(foot, inside, floor_m)
        added[inside] = np.hstack((ankles - foot.wanted_ankle_m[inside], places[inside] - foot.wanted_toes_m[inside]))
        known[inside] = True
    if known.any():
        # what contacts add fades between them
        added = curve_positions(np.flatnonzero(known).astype(np.float64), added[known], np.arange(float(len(share))))
    ankle_m, toes_m = foot.wanted_ankle_m + added[:, :3], foot.wanted_toes_m + added[:, 3:]
    up_m = lift_of(toes_m, places, foot.keyed, fps)[:, None] * np.array([0.0, 1.0, 0.0])
    ankle_m, toes_m = ankle_m + up_m, toes_m + up_m
    way = toes_m - ankle_m
    way *= (foot.length_m / np.maximum(np.linalg.norm(way, axis=1), 1e-9))[:, None]
    stands = np.isfinite(places[:, 0])
    return HeldFoot(toes_m - way, toes_m, stands) if foot.by_toes else HeldFoot(ankle_m, ankle_m + way, stands)


def _standing(foot: Foot, inside: IntArray, floor_m: float | None) -> tuple[Array, Array]:
    """Return ankle and toes (N, 3) in the frames of one stance."""
    own = foot.keyed[(foot.keyed >= inside[0]) & (foot.keyed <= inside[-1])]
    wanted, offset = foot.wanted_toes_m, foot.ankle_m - foot.toes_m
    if len(own) and not foot.by_toes:
        goals = foot.wanted_ankle_m[own]
        place = toes_place(goals, _toes_on_floor(foot, own, inside), foot.length_m[own])
        turn, reach_m = goals - place - offset[own], np.linalg.norm(goals - place, axis=1)
        way = offset[inside] + _between(inside, own, turn)
        way *= (np.interp(inside, own, reach_m) / np.maximum(np.linalg.norm(way, axis=1), 1e-9))[:, None]
        return place + way, np.repeat(place[None], len(inside), axis=0)
    if len(own):
        places = _between(inside, own, wanted[own])
    else:
        place = wanted[inside].mean(axis=0)
        if floor_m is not None and abs(place[1] - floor_m) < _FLOOR_M:
            place[1] = floor_m
        places = np.repeat(place[None], len(inside), axis=0)
    return places + offset[inside], places


def _between(inside: IntArray, own: IntArray, values: Array) -> Array:
    """Return values (K, 3) of some frames at the frames (N,) of a stance."""
    return curve_positions(own.astype(np.float64), values, inside.astype(np.float64))


def toes_place(ankles_m: Array, toes_m: Array, lengths_m: Array) -> Array:
    """Return the place (3,) of toes, a foot's length from all ankles (K, 3).

    Args:
        toes_m: (K, 3) wanted places, to stay near.
        lengths_m: (K,) of the foot.
    """
    middle = place = toes_m.mean(axis=0)
    for _ in range(_ROUNDS):
        way = place - ankles_m
        far_m = np.maximum(np.linalg.norm(way, axis=1), 1e-9)
        rows = np.concatenate((way / far_m[:, None], _PULL * np.eye(3)))
        off_m = np.append(far_m - lengths_m, _PULL * (place - middle))
        place = place - np.linalg.lstsq(rows, off_m, rcond=None)[0]
    return np.asarray(place)


def _toes_on_floor(foot: Foot, own: IntArray, inside: IntArray) -> Array:
    """Return wanted toes (K, 3) in frames of a stance, turned onto a near floor."""
    toes, ankles, lengths_m = foot.wanted_toes_m[own], foot.wanted_ankle_m[own], foot.length_m[own]
    way, low_m = toes - ankles, foot.toes_m[inside, 1].min()
    down_m, ahead_m = low_m - ankles[:, 1], np.hypot(way[:, 0], way[:, 2])
    near = (np.abs(toes[:, 1] - low_m) < _FLOOR_M) & (ahead_m > _LEAST_AHEAD * lengths_m)
    near &= np.abs(down_m) < _STEEPEST * lengths_m
    way *= (np.sqrt(np.maximum(lengths_m**2 - down_m**2, 0.0)) / np.maximum(ahead_m, 1e-9))[:, None]
    way[:, 1] = down_m
    return np.where(near[:, None], ankles + way, toes)


def stances_of(foot: Foot, share: Array, fps: float) -> list[tuple[int, int]]:
    """Return [first, stop) of each time that a foot stands in one place.

    Args:
        share: (F,) of the database's examples in which it stands.
    """
    stands, joint_m = share > _STANDS, foot.wanted_toes_m if foot.by_toes else foot.wanted_ankle_m
    for first, last in zip(foot.keyed[:-1].tolist(), foot.keyed[1:].tolist(), strict=True):
        between = slice(first, last + 1)
        if _rests(foot, first, last, float(share[between].mean()), fps):
            stands[between] = True
            continue
        way_m = float(np.linalg.norm(joint_m[last] - joint_m[first]))
        shortest = min(max(way_m / _STEP_M_S, _SHORTEST_STEP_S) * fps, _LONGEST_STEP * (last - first))
        in_steps = stands[between] & _is_slow(foot.wanted_toes_m[between], fps)
        if way_m > _STRIDE_M and last - first > _STRIDE_S * fps and np.sum(~in_steps) >= shortest:
            stands[between] = in_steps
            continue
        least = _MAY_STAND * float(share[between].max())
        begin, stop = _step(share[between], foot.wanted_toes_m[between], max(2, round(shortest)), least)
        stands[between] = share[between] > least
        stands[first + begin : first + stop] = False
    shortest_stance = round(_SHORTEST_CONTACT_S * fps)
    found = [(first, stop) for first, stop in runs(stands) if stop - first >= shortest_stance]
    found = [_widened(share, first, stop, round(_CONTACT_S * fps)) for first, stop in found]
    return _with_time_to_step(found, foot.wanted_toes_m, share, fps)


def _is_slow(toes_m: Array, fps: float) -> Mask:
    """Return whether toes (F, 3) are slow enough to stand."""
    return np.asarray(np.linalg.norm(np.gradient(toes_m, axis=0), axis=1) * fps < _SLOW_M_S)


def _with_time_to_step(found: list[tuple[int, int]], toes_m: Array, share: Array, fps: float) -> list[tuple[int, int]]:
    """Return stances, shortened where the next place is too far for the time between."""
    result, least = [list(each) for each in found], round(_CONTACT_S * fps)
    places = [toes_m[first:stop].mean(axis=0) for first, stop in found]
    for (before, after), (place, then) in zip(pairwise(result), pairwise(places), strict=True):
        needed = np.linalg.norm(then - place) / _FASTEST_M_S * fps
        while after[0] - before[1] < needed:
            can_leave, can_land = (stop - first > least for first, stop in (before, after))
            if not can_leave and not can_land:
                break
            if can_leave and (not can_land or share[before[1] - 1] < share[after[0]]):
                before[1] -= 1
            else:
                after[0] += 1
    return [(first, stop) for first, stop in result]


def _widened(share: Array, first: int, stop: int, least: int) -> tuple[int, int]:
    """Return a stance of at least so many frames, longer where more examples stand."""
    while stop - first < least:
        before = share[first - 1] if first > 0 else -1.0
        after = share[stop] if stop < len(share) else -1.0
        if max(before, after) < 0.0:
            break
        first, stop = (first - 1, stop) if before > after else (first, stop + 1)
    return first, stop


def _rests(foot: Foot, first: int, last: int, share: float, fps: float) -> bool:
    """Return whether a foot may stand in one place between two keys.

    Args:
        share: mean of the examples that stand there.
    """
    ends, joint_m = np.array([first, last]), foot.wanted_toes_m if foot.by_toes else foot.wanted_ankle_m
    way = joint_m[last] - joint_m[first]
    if np.linalg.norm(way) < min(_STAYED_M, _STAYED_M_S * (last - first) / fps):
        return True
    if foot.by_toes or np.hypot(way[0], way[2]) > _ANKLES_M or share < _SOME_STAND:
        return False
    toes = _toes_on_floor(foot, ends, np.arange(first, last + 1))
    place = toes_place(joint_m[ends], toes, foot.length_m[ends])
    off_m = np.abs(np.linalg.norm(joint_m[ends] - place, axis=1) - foot.length_m[ends])
    most_m = _TOES_M if share < _MOST_STAND else _STEADY_TOES_M
    return bool(off_m.max() < _LENGTH_M and np.linalg.norm(toes - place, axis=1).max() < most_m)


def _step(share: Array, toes_m: Array, shortest: int, least: float) -> tuple[int, int]:
    """Return [begin, stop) of a step where fewest examples stand.

    Args:
        share, toes_m: (N,) and (N, 3) from one key to the next.
        shortest: frames that it takes at least.
        least: share up to which it goes on.
    """
    if len(share) < 4:
        return 1, max(1, len(share) - 1)
    ones = np.ones(min(shortest, len(share) - 2))
    speeds = np.linalg.norm(np.gradient(toes_m, axis=0), axis=1)
    counts = np.convolve(share - _MOVING_S * speeds, ones, mode="valid")[1:-1]  # neither key is left out
    begin = 1 + int(np.argmin(counts)) if len(counts) else 1
    stop = begin + len(ones)
    while begin > 0 and share[begin - 1] <= least:
        begin -= 1
    while stop < len(share) and share[stop] <= least:
        stop += 1
    return begin, stop


def lift_of(toes_m: Array, places_m: Array, keyed: IntArray, fps: float) -> Array:
    """Return how far (F,) to lift toes (F, 3) over the floor while they step.

    Args:
        places_m: (F, 3) where they stand, else NaN; the floor lies there.
        keyed: (K,) frames that are left as they are.
    """
    fixed = np.isfinite(places_m[:, 0])
    if not fixed.any():
        return np.zeros(len(toes_m))
    ground_m = np.interp(np.arange(len(toes_m)), np.flatnonzero(fixed), places_m[fixed, 1])
    speeds = np.linalg.norm(np.gradient(toes_m[:, [0, 2]], axis=0), axis=1) * fps
    fixed[keyed] = True
    near = np.minimum(distance_transform_edt(~fixed) / (_LIFTED_S * fps), 1.0)
    ease = near**2 * (3.0 - 2.0 * near) * np.minimum(speeds / _LIFTED_M_S, 1.0)
    lift_m = ease * np.maximum(ground_m + _CLEAR_M - toes_m[:, 1], 0.0)
    return np.where(fixed, 0.0, gaussian_filter1d(lift_m, _LIFTED_S * fps / 3.0))
