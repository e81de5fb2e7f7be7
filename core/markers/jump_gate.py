"""Doubt about labelled markers that jump: a single wild point moves nothing, and exchanged labels are corrected.

How far a marker can move in a frame is predicted from its own motion. A position that this motion makes less likely
than a wild point is treated as hidden for one frame. If the marker is still away from its prediction in the next frame,
it is believed: its label or its place on the body has changed, or it has moved faster than predicted. If most markers
jump, this is another shot or another person, which is believed immediately. Markers that jump to where others are
expected have exchanged labels, which are corrected for half a second at most: a longer exchange is believed.
"""

import math
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ..geometry.arrays import Array, Mask
from ..geometry.multiple_model_filter import MultipleModelFilter


@dataclass(frozen=True)
class JumpSettings:
    """Settings of `JumpGate`, chosen on five takes of CMU with wild points and without."""

    share: float = 0.02  # share of wild points among all
    reach_m: float = 0.3  # radius around a marker in which its wild points lie
    torso_m_s2: float = 54.0  # acceleration by which the torso's markers depart from where the body carries them
    near_m: float = 0.02  # distance from the expected position within which nothing is wild
    jerk_m_s3: float = 4320.0  # the same for long steps between frames: a change of acceleration that people reach
    outside: float = 3.0  # nothing is wild within this many sigmas of the carried position; sigma grows in a pause
    settled: int = 3  # positions after which a marker's own motion counts
    exchanged: int = 30  # frames after which exchanged labels are believed
    cut: float = 0.5  # share of the located markers leaving their motion above which there is a cut


_S = JumpSettings()
_WILD = math.log(_S.share / (4.0 / 3.0 * math.pi * _S.reach_m**3))  # log density of wild points, per m^3


class Carried(NamedTuple):
    """Prediction of the next frame's markers from the body so far."""

    torso_m: Array  # (M, 3) where the body carries its torso markers; NaN for others and if unknown
    fits: bool = True  # whether the body fits its markers: otherwise their labels may have been wrong


class Gated(NamedTuple):
    """Markers of one frame after the gate."""

    points_m: Array  # (M, 3) with exchanged labels corrected, NaN where hidden or doubted
    doubted: Mask  # (M,)
    exchanged: Mask  # (M,) markers whose exchanged labels were corrected
    explained: Mask  # (M,) located markers that their own motion explains


class JumpGate:
    """Doubts the jumps of one body's markers, frame by frame.

    Args:
        markers: Number of markers M.
        settings: Limits; by default those of live captures.
    """

    def __init__(self, markers: int, settings: JumpSettings | None = None) -> None:
        self._settings = settings or _S
        self._doubted = np.zeros(markers, dtype=bool)
        # number of successive positions of each marker's present motion, and of frames with exchanged labels
        self._ages, self._exchanges = np.zeros((2, markers), dtype=np.int64)

    def step(
        self, points_m: Array, noise_m: Array, follower: MultipleModelFilter, carried: Carried, elapsed_s: float
    ) -> Gated:
        """Return the markers of the next frame that are believed.

        Args:
            points_m: Markers (M, 3), NaN where hidden.
            noise_m: Standard deviations (M,) of their coordinates.
            follower: Filter that has predicted them for this frame; it forgets markers whose jump is believed.
            carried: Prediction from the body so far.
            elapsed_s: Time since the last frame.
        """
        settings = self._settings
        self._ages[~follower.followed] = 0
        is_settled = self._ages >= settings.settled
        away_m = np.linalg.norm(points_m - follower.means()[0], axis=1)
        left = follower.followed & (away_m > settings.near_m)
        if left.any():
            left &= follower.log_likelihoods(points_m, noise_m) < _WILD
        jumped = left & (away_m > settings.jerk_m_s3 * elapsed_s**3)
        explained = is_settled & np.isfinite(away_m) & ~jumped
        exchanged = np.zeros_like(jumped)
        if carried.fits and np.count_nonzero(jumped & is_settled) > 1:
            points_m, exchanged = self._put_back(points_m, noise_m, follower, jumped & is_settled)
            jumped, left = jumped & ~exchanged, left & ~exchanged
        variances = (settings.torso_m_s2 * elapsed_s**2) ** 2 + noise_m**2
        squares = np.sum((points_m - carried.torso_m) ** 2, axis=1)
        is_carried_off = squares > np.maximum(settings.near_m**2, settings.outside**2 * variances)
        is_carried_off &= -1.5 * np.log(2.0 * np.pi * variances) - 0.5 * squares / variances < _WILD
        jumped |= is_carried_off
        is_cut = np.count_nonzero(jumped | left) > settings.cut * np.count_nonzero(np.isfinite(points_m[:, 0]))
        doubted = jumped & ~self._doubted & (is_settled | is_carried_off) & (not is_cut)
        begins = np.full_like(jumped, is_cut) | (jumped & ~doubted)
        follower.forget(begins)
        self._ages[begins] = 0
        self._ages += np.isfinite(points_m[:, 0]) & ~doubted
        self._doubted = doubted
        self._exchanges = np.where(exchanged, self._exchanges + 1, np.where(doubted, self._exchanges, 0))
        return Gated(np.where(doubted[:, None], np.nan, points_m), doubted, exchanged, explained)

    def _put_back(
        self, points_m: Array, noise_m: Array, follower: MultipleModelFilter, jumped: Mask
    ) -> tuple[Array, Mask]:
        """Return the points with exchanges among jumped markers (M,) undone, and a mask of the exchanged markers."""
        markers = np.flatnonzero(jumped & (self._exchanges < self._settings.exchanged)).tolist()
        logs = np.full((len(jumped), len(jumped)), -np.inf)  # log densities of the point of a column at a marker
        for other in markers:
            moved = np.broadcast_to(points_m[other], points_m.shape)
            logs[:, other] = follower.log_likelihoods(moved, noise_m)
        pairs = [(logs[one, other] + logs[other, one], one, other) for one, other in combinations(markers, 2)]
        put_back, exchanged = points_m.copy(), np.zeros_like(jumped)
        for _, one, other in sorted(pairs, reverse=True):
            fit = min(logs[one, other], logs[other, one]) > _WILD
            if fit and not (exchanged[one] or exchanged[other]):
                put_back[[one, other]] = points_m[[other, one]]
                exchanged[[one, other]] = True
        return put_back, exchanged
