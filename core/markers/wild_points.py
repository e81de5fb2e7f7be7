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

    near_m: float = 0.02  # distance from the path between its neighbours within which nothing is wild,
    impact_m_s2: float = 250.0  # and that to which an impact accelerates a marker meanwhile
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
        found = ((before & ~explains) | (after & ~explained)) & _is_off_path(times_s, left_m)
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


def _is_off_path(times_s: Array, points_m: Array) -> Mask:
    """Return a mask (F, M) of positions farther from the straight path between their neighbours than impacts move them.

    The first and last positions of a marker are on no path.
    """
    off = np.zeros(points_m.shape[:2], dtype=bool)
    for marker in range(points_m.shape[1]):
        rows = np.flatnonzero(np.isfinite(points_m[:, marker, 0]))
        path, seconds = points_m[rows, marker], times_s[rows]
        since_s, until_s = np.diff(seconds)[:-1], np.diff(seconds)[1:]
        share = (since_s / (since_s + until_s))[:, None]
        away_m = np.linalg.norm(path[1:-1] - (1.0 - share) * path[:-2] - share * path[2:], axis=1)
        off[rows[1:-1], marker] = away_m > np.maximum(_S.near_m, 0.5 * _S.impact_m_s2 * since_s * until_s)
        off[rows[[0, -1]] if len(rows) else rows, marker] = True
    return off
