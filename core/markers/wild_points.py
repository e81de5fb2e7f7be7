"""Wild points: positions that fit neither the motion before nor the motion after.

Both directions of time pass the gate of live captures (`JumpGate`). A position is wild if one of them doubts it and the
other does not explain it: an impact contradicts only the motion after it. Without the points found, the motion of their
neighbours is known better, so more are found.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, Mask
from .jump_gate import Carried
from .marker_smoothing import MarkerSmoother
from .source_noise import SourceNoise


@dataclass(frozen=True)
class WildPointSettings:
    """Settings of `find_wild_points`, chosen on seven takes of CMU with wild points and without."""

    near_m: float = 0.02  # distance from the straight path between known positions within which nothing is wild,
    impact_m_s2: float = 250.0  # or to which this acceleration, of an impact, moves a marker,
    far_m: float = 0.055  # or this distance on longer paths, at 50 frames per second and more
    rounds: int = 4  # number of searches


_S = WildPointSettings()


def find_wild_points(times_s: Array, points_m: Array, source: SourceNoise) -> Mask:
    """Return a mask (F, M) of positions that fit neither the motion before nor the motion after.

    Args:
        times_s: Ascending times (F,).
        points_m: Labelled markers (F, M, 3), NaN where hidden.
        source: Errors to expect from their source.
    """
    wild = np.zeros(points_m.shape[:2], dtype=bool)
    for _ in range(_S.rounds):
        left_m = np.where(wild[..., None], np.nan, points_m)
        (before, explained), (after, explains) = (_gated(times_s, left_m, source, way) for way in (1, -1))
        doubted = (before & ~explains) | (after & ~explained)
        found = doubted & _is_off_path(times_s, left_m, doubted, explained | explains)
        if not found.any():
            break
        wild |= found
    return wild


def _gated(times_s: Array, points_m: Array, source: SourceNoise, way: int) -> tuple[Mask, Mask]:
    """Return masks (F, M) of positions that are doubted, and explained, in a direction of time, 1 or -1."""
    smoother = MarkerSmoother(points_m.shape[1], source)
    alone = Carried(np.full(points_m.shape[1:], np.nan), fits=False)
    doubted, explained = np.zeros((2, *points_m.shape[:2]), dtype=bool)
    for row in range(len(times_s))[::way]:
        gated = smoother.step(way * times_s[row], points_m[row], alone).believed
        doubted[row], explained[row] = gated.doubted, gated.explained
    return doubted, explained


def _is_off_path(times_s: Array, points_m: Array, doubted: Mask, known: Mask) -> Mask:
    """Return which doubted positions (F, M) are farther from the path between known ones than impacts move a marker.

    Before the first and after the last two known positions, the path goes straight on.
    """
    off = np.zeros_like(doubted)
    step_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0
    far_m = max(_S.far_m, 0.5 * _S.impact_m_s2 * step_s**2)
    for marker in np.flatnonzero(doubted.any(axis=0)):
        rows, frames = np.flatnonzero(doubted[:, marker]), np.flatnonzero(known[:, marker])
        if len(frames) < 2:
            continue
        later = np.clip(np.searchsorted(frames, rows), 1, len(frames) - 1)
        first, last = frames[later - 1], frames[later]
        since_s, until_s = times_s[rows] - times_s[first], times_s[last] - times_s[rows]
        share = (since_s / (since_s + until_s))[:, None]
        path_m = (1.0 - share) * points_m[first, marker] + share * points_m[last, marker]
        away_m = np.linalg.norm(points_m[rows, marker] - path_m, axis=1)
        least_m = np.clip(0.5 * _S.impact_m_s2 * since_s * until_s, _S.near_m, far_m)
        is_between = np.minimum(since_s, until_s) > 0.0
        off[rows, marker] = away_m > np.where(is_between, least_m, far_m)
    return off
