"""Detection of wild points: positions far from a motion that continues as if they did not exist.

Markers pass the gate of live captures (`JumpGate`), which doubts sudden jumps, in both directions of time. A doubted
position is wild if the motions before and after it, continued without it, meet far from it. At an impact they do not
meet. The search is repeated, because the motion of a wild point's neighbours is clearer once the point is left out.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..geometry.arrays import Array, IntArray, Mask
from .jump_gate import Carried, JumpSettings
from .marker_smoothing import MarkerSmoother
from .source_noise import SourceNoise


@dataclass(frozen=True)
class WildPointSettings:
    """Settings of `find_wild_points`, chosen on 65 takes of CMU and Bandai (see the tuning log)."""

    least_m: float = 0.05  # smallest distance of a wild point from the curve through its neighbours
    bridge: float = 0.4  # largest distance between the motions before and after it, as a share of its own
    sudden: float = 6.0  # smallest distance, relative to the median distance between such motions nearby
    beside: int = 3  # number of positions on either side that are compared
    # median distance of the bone's other markers from such curves, relative to the point's, above which the body jumps
    together: float = 0.5
    longest_s: float = 0.15  # longest time between the positions before and after a wild point
    rounds: int = 4  # number of searches


_S = WildPointSettings()
# At a low frame rate, fast limbs jump far. Live, such jumps are accepted; here, the motion afterwards decides.
_ANY_JUMP = JumpSettings(jerk_m_s3=0.0)


def find_wild_points(times_s: Array, points_m: Array, source: SourceNoise, nearest: Mask) -> Mask:
    """Return a mask (F, M) of wild points.

    Args:
        times_s: Ascending times (F,).
        points_m: Labelled markers (F, M, 3), NaN where hidden.
        source: Errors to expect from their source.
        nearest: Mask (M, M) of the markers on the same bone as each marker, or else on the nearest bone.
    """
    wild = np.zeros(points_m.shape[:2], dtype=bool)
    for _ in range(_S.rounds):
        left_m = np.where(wild[..., None], np.nan, points_m)
        doubted, found = _doubted(times_s, left_m, source), np.zeros_like(wild)
        for marker in np.flatnonzero(doubted.any(axis=0)):
            rows, path = np.flatnonzero(doubted[:, marker]), left_m[:, marker]
            kept = np.flatnonzero(np.isfinite(path[:, 0]) & ~doubted[:, marker])
            found[rows, marker] = _is_apart(times_s, path, left_m[:, nearest[marker]], rows, kept)
        if not found.any():
            break
        wild |= found
    return wild


def _doubted(times_s: Array, points_m: Array, source: SourceNoise) -> Mask:
    """Return a mask (F, M) of positions that are doubted in one direction of time and not explained in the other."""
    (before, explained), (after, explains) = (_gated(times_s, points_m, source, way) for way in (1, -1))
    doubted = (before & ~explains) | (after & ~explained)
    known = explained | explains | ~np.isfinite(points_m[..., 0])
    for marker in np.flatnonzero(doubted.any(axis=0)):
        rows = np.flatnonzero(doubted[:, marker])
        for first, last in pairwise(rows.tolist()):
            if times_s[last] - times_s[first] < _S.longest_s and not known[first + 1 : last, marker].any():
                doubted[first:last, marker] = True
    return doubted & np.isfinite(points_m[..., 0])


def _gated(times_s: Array, points_m: Array, source: SourceNoise, way: int) -> tuple[Mask, Mask]:
    """Return masks (F, M) of the doubted and of the explained positions in a direction of time, 1 or -1."""
    smoother = MarkerSmoother(points_m.shape[1], source, _ANY_JUMP)
    alone = Carried(np.full(points_m.shape[1:], np.nan), lambda given_m, corrected_m: 0.0)
    doubted, explained = np.zeros((2, *points_m.shape[:2]), dtype=bool)
    for row in range(len(times_s))[::way]:
        gated = smoother.step(way * times_s[row], points_m[row], alone).believed
        doubted[row], explained[row] = gated.doubted, gated.explained
    return doubted, explained


def _is_apart(times_s: Array, path: Array, beside: Array, rows: IntArray, kept: IntArray) -> Mask:
    """Return which positions (K,) of one marker are far from the motion of its other positions.

    Args:
        path: Positions (F, 3) of the marker.
        beside: Positions (F, N, 3) of the markers on the same bone.
        rows: Frames (K,) of the doubted positions.
        kept: Frames of the marker's other positions.
    """
    apart = np.zeros(len(rows), dtype=bool)
    usual_m = _misses(times_s[kept], path[kept])
    for index, (row, later) in enumerate(zip(rows, np.searchsorted(kept, rows).tolist(), strict=True)):
        # near an end of the take, it is unknown how the motion goes on
        if not 2 <= later <= len(kept) - 2 or times_s[kept[later]] - times_s[kept[later - 1]] > _S.longest_s:
            continue
        around = kept[later - 2 : later + 2]
        miss_m = float(_misses(times_s[around], path[around])[0])
        away_m = _away(times_s, path[:, None], row, around)[0]
        before = slice(max(later - 3 - _S.beside, 0), max(later - 3, 0))
        sudden_m = np.concatenate((usual_m[before], usual_m[later : later + _S.beside]))
        least_m = max(_S.least_m, _S.sudden * float(np.median(sudden_m)) if len(sudden_m) else 0.0)
        others_m = _away(times_s, beside, row, around)
        others_m = others_m[np.isfinite(others_m)]
        jumps = len(others_m) > 0 and np.median(others_m) > _S.together * away_m
        apart[index] = away_m > least_m and miss_m < _S.bridge * away_m and not jumps
    return apart


def _away(times_s: Array, points_m: Array, row: int, around: IntArray) -> Array:
    """Return the distances (N,) of markers (F, N, 3) in a frame from cubics through four frames around it."""
    known_s, at_s = times_s[around], times_s[row]
    others = [np.delete(known_s, i) for i in range(len(around))]
    weights = [np.prod((at_s - other_s) / (own_s - other_s)) for own_s, other_s in zip(known_s, others, strict=True)]
    return np.asarray(np.linalg.norm(points_m[row] - np.tensordot(weights, points_m[around], 1), axis=-1))


def _misses(times_s: Array, path: Array) -> Array:
    """Return the distances (N - 3,) at seams between extrapolations from the two positions before and after."""
    velocities = np.diff(path, axis=0) / np.diff(times_s)[:, None]
    half_s = 0.5 * np.diff(times_s)[1:-1, None]
    return np.asarray(np.linalg.norm(path[1:-2] + half_s * (velocities[:-2] + velocities[2:]) - path[2:-1], axis=1))
