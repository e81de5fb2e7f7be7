"""Gate for labelled markers that jump: wild points are ignored, and exchanged labels are corrected.

How far a marker can move in a frame is predicted from its own motion. A position that is less likely, given this
motion, than a wild point is doubted: the marker is treated as hidden. If it deviates from its prediction in the same
direction in the next frame, or stays elsewhere for a few frames, it is accepted: its label or its position on the body
has changed, or it has moved faster than predicted. If most markers jump, there is a cut to another motion or another
person, and the positions are accepted immediately. Two markers that jump to where the other is expected have exchanged
labels. These are corrected for as long as each continues the other's motion better than its own, unless the given
labels look more like a body: much more at first, or at all after half a second.
"""

import math
from collections.abc import Callable
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
    # cosine of the angle between the deviations of two successive positions above which they confirm each other
    same_way: float = 0.8
    doubted: int = 3  # number of successive doubted positions after which the next one is accepted
    # distance from the nearest example, relative to that with corrected labels, below which given labels are believed
    begun: float = 0.6
    exchanged: int = 30  # number of frames after which they are believed if this distance is not larger
    cut: float = 0.5  # share of located markers that deviate from their motion above which there is a cut


_S = JumpSettings()
_WILD = math.log(_S.share / (4.0 / 3.0 * math.pi * _S.reach_m**3))  # log density of wild points, per m^3


class Carried(NamedTuple):
    """Prediction of the next frame's markers from the body so far."""

    torso_m: Array  # (M, 3) torso markers, extrapolated with the body; NaN for other markers and if unknown
    # Distance of markers (M, 3) as given from the nearest example of a body, relative to their distance with exchanged
    # labels corrected: where labels seem to be exchanged, they may have been wrong until now. By default it is unknown.
    nearness: Callable[[Array, Array], float] = lambda given_m, corrected_m: math.nan


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
        self._deviations_m = np.zeros((markers, 3))  # of the last frame's positions from their predictions
        # for each marker, the number of successive positions in its current motion, of successive doubted ones, and of
        # frames with exchanged labels
        self._ages, self._doubts, self._exchanges = np.zeros((3, markers), dtype=np.int64)
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
        expected_m = follower.means()[0]
        away_m = np.linalg.norm(points_m - expected_m, axis=1)
        left = follower.followed & (away_m > settings.near_m)
        if left.any():
            left &= follower.log_likelihoods(points_m, noise_m) < _WILD
        jumped = left & (away_m > settings.jerk_m_s3 * elapsed_s**3)
        explained = is_settled & np.isfinite(away_m) & ~jumped
        points_m, exchanged = self._put_back(points_m, noise_m, follower, jumped, carried.nearness)
        jumped, left = jumped & ~exchanged, left & ~exchanged
        variances = (settings.torso_m_s2 * elapsed_s**2) ** 2 + noise_m**2
        squares = np.sum((points_m - carried.torso_m) ** 2, axis=1)
        is_carried_off = squares > np.maximum(settings.near_m**2, settings.outside**2 * variances)
        is_carried_off &= -1.5 * np.log(2.0 * np.pi * variances) - 0.5 * squares / variances < _WILD
        jumped |= is_carried_off
        is_cut = np.count_nonzero(jumped | left) > settings.cut * np.count_nonzero(np.isfinite(points_m[:, 0]))
        is_doubtful = jumped & (is_settled | is_carried_off) & (not is_cut)
        deviations_m = points_m - expected_m
        doubted = is_doubtful & ~self._repeats(deviations_m)
        begins = np.full_like(jumped, is_cut) | (jumped & ~doubted)
        follower.forget(begins)
        self._ages[begins] = 0
        self._ages += np.isfinite(points_m[:, 0]) & ~doubted
        self._doubts = np.where(doubted, self._doubts + 1, 0)
        self._deviations_m = deviations_m
        self._exchanges = np.where(exchanged, self._exchanges + 1, np.where(doubted, self._exchanges, 0))
        return Gated(np.where(doubted[:, None], np.nan, points_m), doubted, exchanged, explained)

    def _repeats(self, deviations_m: Array) -> Mask:
        """Return a mask (M,) of positions that confirm the last, doubted one, or have been doubted for long.

        A marker that has moved elsewhere deviates in the same direction again; wild points do so by chance only.
        """
        products = np.sum(deviations_m * self._deviations_m, axis=1)
        lengths = np.linalg.norm(deviations_m, axis=1) * np.linalg.norm(self._deviations_m, axis=1)
        is_same = products > self._settings.same_way * lengths
        return np.asarray((self._doubts > 0) & (is_same | (self._doubts >= self._settings.doubted)))

    def _put_back(
        self,
        points_m: Array,
        noise_m: Array,
        follower: MultipleModelFilter,
        jumped: Mask,
        nearness: Callable[[Array, Array], float],
    ) -> tuple[Array, Mask]:
        """Return the markers (M, 3) with exchanges undone that begin or go on, and a mask (M,) of exchanged ones."""
        exchanged, last, self._partners = np.zeros_like(jumped), self._partners, np.arange(len(jumped))
        possible = (jumped | (last != self._partners)) & np.isfinite(points_m[:, 0])
        markers = np.flatnonzero(possible).tolist()
        if len(markers) < 2:
            return points_m, exchanged
        put_back = points_m.copy()
        logs = np.full((len(jumped), len(jumped)), -np.inf)  # log density (row) marker at (column) another's point
        for other in markers:
            moved = np.broadcast_to(points_m[other], points_m.shape)
            logs[:, other] = follower.log_likelihoods(moved, noise_m)
        pairs = [(logs[one, other] + logs[other, one], one, other) for one, other in combinations(markers, 2)]
        for both, one, other in sorted(pairs, reverse=True):
            goes_on = last[one] == other and both > logs[one, one] + logs[other, other]
            begins = jumped[one] and jumped[other] and both > 2.0 * _WILD
            if (goes_on or begins) and not (exchanged[one] or exchanged[other]):
                put_back[[one, other]] = points_m[[other, one]]
                exchanged[[one, other]] = True
                self._partners[[one, other]] = other, one
        begins, lasts = exchanged & (self._partners != last), exchanged & (self._exchanges >= self._settings.exchanged)
        if begins.any() or lasts.any():
            away = nearness(points_m, put_back)
            wrong = (begins & (away < self._settings.begun)) | (lasts & (not away > 1.0))
            exchanged &= ~wrong
            self._partners[wrong] = np.flatnonzero(wrong)
            put_back[wrong] = points_m[wrong]
            self._exchanges[lasts & ~wrong] = 0
        return put_back, exchanged
