"""Gate for labelled markers that jump: single wild points are ignored, and exchanged labels are corrected.

How far a marker can move in a frame is predicted from its own motion. A position that is less likely, given this
motion, than a wild point is doubted: the marker is treated as hidden for one frame. If it is still far from its
prediction in the next frame, the new position is accepted: its label or its position on the body has changed, or it has
moved faster than predicted. If most markers jump, there is a cut to another motion or another person, and the positions
are accepted immediately. Two markers that jump to where each other is expected have exchanged labels. These are corrected for as long
as each continues the other's motion better than its own, but for half a second at most: a longer exchange is accepted.
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
    reach_m: float = 0.3  # radius around a marker within which its wild points lie
    torso_m_s2: float = 54.0  # standard deviation of the acceleration of torso markers, relative to the body's
    near_m: float = 0.02  # distance from the expected position within which nothing is wild
    jerk_m_s3: float = 4320.0  # jerk that people reach: a jump is larger than this explains
    outside: float = 3.0  # nothing is wild within this many standard deviations of the carried position
    settled: int = 3  # number of successive positions after which a marker's own motion is relied on
    exchanged: int = 30  # number of frames after which exchanged labels are accepted
    cut: float = 0.5  # share of located markers that deviate from their motion above which there is a cut


_S = JumpSettings()
_WILD = math.log(_S.share / (4.0 / 3.0 * math.pi * _S.reach_m**3))  # log density of wild points, per m^3


class Carried(NamedTuple):
    """Prediction of the next frame's markers from the body so far."""

    torso_m: Array  # (M, 3) torso markers, extrapolated with the body; NaN for other markers and if unknown
    fits: bool = True  # whether the last pose fitted its markers: if not, their labels may have been wrong


class Gated(NamedTuple):
    """Markers of one frame after the gate."""

    points_m: Array  # (M, 3) with exchanged labels corrected, NaN where hidden or doubted
    doubted: Mask  # (M,)
    exchanged: Mask  # (M,) markers whose exchanged labels were corrected
    explained: Mask  # (M,) located markers that continue their own motion


class JumpGate:
    """Doubts the jumps of one body's markers, frame by frame.

    Args:
        markers: Number of markers M.
        settings: Limits; by default those of live captures.
    """

    def __init__(self, markers: int, settings: JumpSettings | None = None) -> None:
        self._settings = settings or _S
        self._doubted = np.zeros(markers, dtype=bool)
        # for each marker, the number of successive positions in its current motion, and of frames with exchanged labels
        self._ages, self._exchanges = np.zeros((2, markers), dtype=np.int64)
        self._partners = np.arange(markers)  # marker whose label each had in the last frame

    def step(
        self, points_m: Array, noise_m: Array, follower: MultipleModelFilter, carried: Carried, elapsed_s: float
    ) -> Gated:
        """Return the next frame's markers after the gate.

        Args:
            points_m: Markers (M, 3), NaN where hidden.
            noise_m: Standard deviations (M,) of their coordinates.
            follower: Filter that has predicted the markers for this frame; it forgets those whose jump is accepted.
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
        begins = jumped & is_settled & carried.fits
        points_m, exchanged = self._put_back(points_m, noise_m, follower, begins)
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
        """Return the markers (M, 3) with exchanges among jumped ones undone, and a mask (M,) of the exchanged ones."""
        put_back, exchanged, last = points_m.copy(), np.zeros_like(jumped), self._partners
        self._partners = np.arange(len(jumped))
        may = self._exchanges < self._settings.exchanged
        markers = np.flatnonzero(may & (jumped | (last != self._partners)) & np.isfinite(points_m[:, 0])).tolist()
        if len(markers) < 2:
            return put_back, exchanged
        logs = np.full((len(jumped), len(jumped)), -np.inf)  # log density (row) marker at (column) another's point
        for other in markers:
            moved = np.broadcast_to(points_m[other], points_m.shape)
            logs[:, other] = follower.log_likelihoods(moved, noise_m)
        pairs = [(logs[one, other] + logs[other, one], one, other) for one, other in combinations(markers, 2)]
        for both, one, other in sorted(pairs, reverse=True):
            goes_on = last[one] == other and both > logs[one, one] + logs[other, other]
            begins = jumped[one] and jumped[other] and min(logs[one, other], logs[other, one]) > _WILD
            if (goes_on or begins) and not (exchanged[one] or exchanged[other]):
                put_back[[one, other]] = points_m[[other, one]]
                exchanged[[one, other]] = True
                self._partners[[one, other]] = other, one
        return put_back, exchanged
