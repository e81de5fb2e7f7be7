"""Stances: when and where the feet of a sketch are planted.

A foot stays planted between two keys if one position of the toes explains both, with the ankle turning about the toes.
Between other keys the foot steps: for no longer than the distance requires, and when the fewest of the database's
examples are planted. Otherwise it is planted whenever enough examples are. Between keys more than a stride apart, and
without keys, it steps when the database's motion does.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..body.window_filters import frames_to, gaussian
from ..geometry.arrays import Array, IntArray, Mask, runs
from ..geometry.least_squares import gauss_newton
from .key_interpolation import curve_positions


@dataclass(frozen=True)
class StanceSettings:
    """Settings for the stances; the planted fraction is the share of the examples in which the foot is planted."""

    stands: float = 0.5  # planted fraction above which a foot is planted
    # smallest mean planted fraction with which one stance spans two keys; between other keys, the foot steps while the
    # fraction is below this share of its maximum there
    may_stand: float = 0.3
    most_stand: float = 0.7  # planted fraction from which the desired toes of one stance may differ more
    stayed_m: float = 0.04  # largest distance between two keys in one stance
    stayed_m_s: float = 0.1  # largest mean speed between two keys in one stance
    ankles_m: float = 0.1  # largest horizontal distance between the ankles at two keys of a stance on the toes
    length_m: float = 0.015  # largest error of the foot's length in a stance
    # largest distance of the desired toes from the stance's: normally, and if the planted fraction reaches `most_stand`
    toes_m: tuple[float, float] = (0.03, 0.05)
    step_m_s: float = 2.0  # mean speed of a step
    shortest_step_s: float = 0.07
    longest_step: float = 0.35  # longest step, fraction of the time between two keys, unless examples step for longer
    fastest_m_s: float = 5.0  # largest speed from one stance to the next
    stride_m: float = 0.6  # smallest distance between two keys that takes several steps
    stride_s: float = 1.2  # shortest time between two such keys
    slow_m_s: float = 0.5  # largest speed of a foot that is planted between those steps
    shortest_contact_s: float = 0.05  # shortest contact that counts
    contact_s: float = 0.13  # duration to which shorter contacts are extended, if they count
    moving_s: float = 0.01  # planted fraction that weighs as much as a toe speed of 1 m per frame when a step is placed
    clear_m: float = 0.025  # height of the toes above the ground during a step
    lifted_s: float = 0.1  # time from lift-off until this height is reached
    lifted_m_s: float = 1.0  # speed from which this height is reached; slower feet stay lower
    floor_m: float = 0.12  # height difference above which a foot stands on something other than the floor
    steepest: float = 0.95  # largest height of an ankle whose toes are turned onto the floor, in foot lengths
    least_ahead: float = 0.3  # smallest horizontal distance of those toes from the ankle, in foot lengths
    pull: float = 0.3  # weight of the toes' desired position, relative to the foot's length


SETTINGS = StanceSettings()


@dataclass(frozen=True)
class Foot:
    """A foot in the database's motion, and its keys.

    Args:
        ankle_m: Ankle positions (F, 3) in the database's motion.
        toes_m: Toe positions (F, 3) in the database's motion.
        displacement_m: Displacements (F, 3) that lead to the keys, without contacts.
        keyed: Frames (K,) with a key, ascending.
        by_toes: Whether the keys are for the toes instead of the ankle.
    """

    ankle_m: Array
    toes_m: Array
    displacement_m: Array
    keyed: IntArray
    by_toes: bool = False

    @property
    def wanted_ankle_m(self) -> Array:
        """Ankle positions (F, 3) without contacts."""
        return self.ankle_m + self.displacement_m

    @property
    def wanted_toes_m(self) -> Array:
        """Toe positions (F, 3) without contacts."""
        return self.toes_m + self.displacement_m

    @property
    def wanted_joint_m(self) -> Array:
        """Positions (F, 3) of the keyed joint without contacts."""
        return self.wanted_toes_m if self.by_toes else self.wanted_ankle_m

    @property
    def length_m(self) -> Array:
        """Distances (F,) from ankle to toes."""
        return np.asarray(np.linalg.norm(self.toes_m - self.ankle_m, axis=1))


@dataclass(frozen=True)
class HeldFoot:
    """Targets ankle_m and toes_m (F, 3) of a foot, and a mask (F,) of the frames in which it is planted."""

    ankle_m: Array
    toes_m: Array
    stands: Mask


def held_foot(foot: Foot, share: Array, floor_m: float | None, fps: float) -> HeldFoot:
    """Return a foot that stays in place while it is planted and is lifted while it steps.

    Args:
        share: Fractions (F,) of the database's examples in which the foot is planted.
        floor_m: Height of planted toes on the floor, given to toes planted near it; None leaves heights unchanged.
    """
    added, places = np.zeros((len(share), 6)), np.full_like(foot.toes_m, np.nan)  # added to the desired ankle and toes
    known = np.zeros(len(share), dtype=np.bool_)
    known[foot.keyed] = True
    for first, stop in stances_of(foot, share, fps):
        inside = np.arange(first, stop)
        ankles, places[inside] = _standing(foot, inside, floor_m)
        added[inside] = np.hstack((ankles - foot.wanted_ankle_m[inside], places[inside] - foot.wanted_toes_m[inside]))
        known[inside] = True
    if known.any():
        # between contacts and keys, the corrections are interpolated
        added = curve_positions(np.flatnonzero(known).astype(np.float64), added[known], np.arange(float(len(share))))
    ankle_m, toes_m = foot.wanted_ankle_m + added[:, :3], foot.wanted_toes_m + added[:, 3:]
    up_m = lift_of(toes_m, places, foot.keyed, fps)[:, None] * np.array([0.0, 1.0, 0.0])
    ankle_m, toes_m = ankle_m + up_m, toes_m + up_m
    way = _with_length(toes_m - ankle_m, foot.length_m)
    stands = np.isfinite(places[:, 0])
    return HeldFoot(toes_m - way, toes_m, stands) if foot.by_toes else HeldFoot(ankle_m, ankle_m + way, stands)


def _with_length(ways: Array, lengths_m: Array) -> Array:
    """Return vectors (N, 3) scaled to lengths (N,)."""
    return np.asarray(ways * (lengths_m / np.maximum(np.linalg.norm(ways, axis=1), 1e-9))[:, None])


def _standing(foot: Foot, inside: IntArray, floor_m: float | None) -> tuple[Array, Array]:
    """Return ankle and toes (N, 3) in the frames of one stance."""
    own = foot.keyed[(foot.keyed >= inside[0]) & (foot.keyed <= inside[-1])]
    times, at = own.astype(np.float64), inside.astype(np.float64)
    wanted, offset = foot.wanted_toes_m, foot.ankle_m - foot.toes_m
    if len(own) and not foot.by_toes:
        goals = foot.wanted_ankle_m[own]
        place = toes_place(goals, _toes_on_floor(foot, own, inside, floor_m), foot.length_m[own])
        turn, reach_m = goals - place - offset[own], np.linalg.norm(goals - place, axis=1)
        way = offset[inside] + curve_positions(times, turn, at)
        return place + _with_length(way, np.interp(inside, own, reach_m)), np.repeat(place[None], len(inside), axis=0)
    if len(own):
        places = curve_positions(times, wanted[own], at)
    else:
        place = wanted[inside].mean(axis=0)
        if floor_m is not None and abs(place[1] - floor_m) < SETTINGS.floor_m:
            place[1] = floor_m
        places = np.repeat(place[None], len(inside), axis=0)
    return places + offset[inside], places


def toes_place(ankles_m: Array, toes_m: Array, lengths_m: Array) -> Array:
    """Return the position (3,) of toes that is a foot's length away from all ankles (K, 3).

    Args:
        toes_m: Desired positions (K, 3); their mean attracts the result.
        lengths_m: Lengths (K,) of the foot.
    """
    middle = toes_m.mean(axis=0)

    def linearise(place: Array) -> tuple[Array, Array]:
        way = place - ankles_m
        far_m = np.maximum(np.linalg.norm(way, axis=1), 1e-9)
        off_m = np.append(far_m - lengths_m, SETTINGS.pull * (place - middle))
        return off_m, np.concatenate((way / far_m[:, None], SETTINGS.pull * np.eye(3)))

    return gauss_newton(middle, linearise, steps=4)[0]


def _toes_on_floor(foot: Foot, own: IntArray, inside: IntArray, floor_m: float | None = None) -> Array:
    """Return the desired toes (K, 3) in frames of a stance, turned about the ankles onto the floor if near it.

    Args:
        floor_m: Largest height of planted toes; None for that of the database's motion.
    """
    toes, ankles, lengths_m = foot.wanted_toes_m[own], foot.wanted_ankle_m[own], foot.length_m[own]
    way, low_m = toes - ankles, foot.toes_m[inside, 1].min()
    if floor_m is not None:
        low_m = min(low_m, floor_m)  # the database's foot may be in the air there
    down_m, ahead_m = low_m - ankles[:, 1], np.hypot(way[:, 0], way[:, 2])
    near = (np.abs(toes[:, 1] - low_m) < SETTINGS.floor_m) & (ahead_m > SETTINGS.least_ahead * lengths_m)
    near &= np.abs(down_m) < SETTINGS.steepest * lengths_m
    way *= (np.sqrt(np.maximum(lengths_m**2 - down_m**2, 0.0)) / np.maximum(ahead_m, 1e-9))[:, None]
    way[:, 1] = down_m
    return np.where(near[:, None], ankles + way, toes)


def stances_of(foot: Foot, share: Array, fps: float) -> list[tuple[int, int]]:
    """Return (first, stop) of each period in which a foot is planted in one place.

    Args:
        share: Fractions (F,) of the database's examples in which the foot is planted.
    """
    stands, joint_m = share > SETTINGS.stands, foot.wanted_joint_m
    for first, last in pairwise(foot.keyed.tolist()):
        between = slice(first, last + 1)
        if _rests(foot, first, last, float(share[between].mean()), fps):
            stands[between] = True
            continue
        way_m = float(np.linalg.norm(joint_m[last] - joint_m[first]))
        shortest = max(way_m / SETTINGS.step_m_s, SETTINGS.shortest_step_s) * fps
        shortest = min(shortest, SETTINGS.longest_step * (last - first))
        speeds_m = np.linalg.norm(np.gradient(foot.wanted_toes_m[between], axis=0), axis=1)
        in_steps = stands[between] & (speeds_m * fps < SETTINGS.slow_m_s)
        is_far = way_m > SETTINGS.stride_m and last - first > SETTINGS.stride_s * fps
        if is_far and np.sum(~in_steps) >= shortest:
            stands[between] = in_steps | _at_the_ends(foot, share, first, last, round(SETTINGS.contact_s * fps))
            continue
        least = SETTINGS.may_stand * float(share[between].max())
        begin, stop = _step(share[between], speeds_m, max(2, round(shortest)), least)
        stands[between] = share[between] > least
        stands[first + begin : first + stop] = False
    shortest_stance = round(SETTINGS.shortest_contact_s * fps)
    found = [(first, stop) for first, stop in runs(stands) if stop - first >= shortest_stance]
    found = [_widened(share, first, stop, round(SETTINGS.contact_s * fps)) for first, stop in found]
    return _with_time_to_step(found, foot.wanted_toes_m, share, fps)


def _at_the_ends(foot: Foot, share: Array, first: int, last: int, least: int) -> Mask:
    """Return a mask of the frames between two keys in which the foot stands because the sketch begins or ends there.

    The database's motion may be in the middle of a step at the first and the last key. A foot that is planted in most
    examples then stands for the shortest time.
    """
    ends = np.zeros(last + 1 - first, dtype=np.bool_)
    ends[: least + 1] = first == foot.keyed[0] and share[first] > SETTINGS.stands
    ends[-least - 1 :] |= last == foot.keyed[-1] and share[last] > SETTINGS.stands
    return ends


def _with_time_to_step(found: list[tuple[int, int]], toes_m: Array, share: Array, fps: float) -> list[tuple[int, int]]:
    """Return the stances, shortened where the foot would move too fast from one to the next."""
    result, least = [list(each) for each in found], round(SETTINGS.contact_s * fps)
    places = [toes_m[first:stop].mean(axis=0) for first, stop in found]
    for (before, after), (place, then) in zip(pairwise(result), pairwise(places), strict=True):
        needed = np.linalg.norm(then - place) / SETTINGS.fastest_m_s * fps
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
    """Return a stance of at least this many frames, extended on the side where more examples are planted."""
    while stop - first < least:
        before = share[first - 1] if first > 0 else -1.0
        after = share[stop] if stop < len(share) else -1.0
        if max(before, after) < 0.0:
            break
        first, stop = (first - 1, stop) if before > after else (first, stop + 1)
    return first, stop


def _rests(foot: Foot, first: int, last: int, share: float, fps: float) -> bool:
    """Return whether a foot may stay planted in one place between two keys.

    Args:
        share: Mean fraction of the examples that are planted there.
    """
    ends, joint_m = np.array([first, last]), foot.wanted_joint_m
    way = joint_m[last] - joint_m[first]
    if np.linalg.norm(way) < min(SETTINGS.stayed_m, SETTINGS.stayed_m_s * (last - first) / fps):
        return True
    if foot.by_toes or np.hypot(way[0], way[2]) > SETTINGS.ankles_m or share < SETTINGS.may_stand:
        return False
    toes = _toes_on_floor(foot, ends, np.arange(first, last + 1))
    place = toes_place(joint_m[ends], toes, foot.length_m[ends])
    off_m = np.abs(np.linalg.norm(joint_m[ends] - place, axis=1) - foot.length_m[ends])
    most_m = SETTINGS.toes_m[int(share >= SETTINGS.most_stand)]
    return bool(off_m.max() < SETTINGS.length_m and np.linalg.norm(toes - place, axis=1).max() < most_m)


def _step(share: Array, speeds_m: Array, shortest: int, least: float) -> tuple[int, int]:
    """Return (begin, stop) of a step, placed where the fewest examples are planted.

    Args:
        share: Fractions (N,) of the examples that are planted, from one key to the next.
        speeds_m: Distances (N,) that the toes move per frame.
        shortest: Fewest frames of the step.
        least: Largest fraction at which the step continues.
    """
    if len(share) < 4:
        return 1, max(1, len(share) - 1)
    ones = np.ones(min(shortest, len(share) - 2))
    counts = np.convolve(share - SETTINGS.moving_s * speeds_m, ones, mode="valid")[1:-1]  # no step includes a key
    begin = 1 + int(np.argmin(counts)) if len(counts) else 1
    stop = begin + len(ones)
    while begin > 0 and share[begin - 1] <= least:
        begin -= 1
    while stop < len(share) and share[stop] <= least:
        stop += 1
    return begin, stop


def lift_of(toes_m: Array, places_m: Array, keyed: IntArray, fps: float) -> Array:
    """Return heights (F,) by which to lift toes (F, 3) above the floor while they step.

    Args:
        places_m: Positions (F, 3) of planted toes, which show the floor; NaN elsewhere.
        keyed: Frames (K,) that are not changed.
    """
    fixed = np.isfinite(places_m[:, 0])
    if not fixed.any() or len(toes_m) < 2:  # a pose makes no step
        return np.zeros(len(toes_m))
    ground_m = np.interp(np.arange(len(toes_m)), np.flatnonzero(fixed), places_m[fixed, 1])
    speeds = np.linalg.norm(np.gradient(toes_m[:, [0, 2]], axis=0), axis=1) * fps
    fixed[keyed] = True
    near = np.minimum(frames_to(fixed) / (SETTINGS.lifted_s * fps), 1.0)
    ease = near**2 * (3.0 - 2.0 * near) * np.minimum(speeds / SETTINGS.lifted_m_s, 1.0)
    lift_m = ease * np.maximum(ground_m + SETTINGS.clear_m - toes_m[:, 1], 0.0)
    return np.where(fixed, 0.0, gaussian(lift_m, SETTINGS.lifted_s * fps / 3.0, "symmetric"))
