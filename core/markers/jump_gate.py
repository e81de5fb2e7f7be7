"""Doubt about markers that jump: a single wild point moves nothing, and a jump that lasts is believed.

What a marker may do in a frame follows from its own motion. A position that this motion makes less likely than a wild
point is treated as hidden for one frame. If the marker is still elsewhere in the next one, it is believed: its label or
its place on the body has changed, or it has moved faster than its motion promised. When most markers jump, this is
another shot or another person, which is believed at once.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, Mask
from ..geometry.multiple_model_filter import MultipleModelFilter


@dataclass(frozen=True)
class JumpSettings:
    """Settings of `JumpGate`, chosen on five takes of CMU with wild points and without."""

    share: float = 0.02  # share of wild points among all
    reach_m: float = 0.3  # distance within which wild points lie
    torso_m: float = 0.015  # standard deviation of a torso marker about where the body carries it, per coordinate
    near_m: float = 0.02  # distance from the expected position within which nothing is wild
    settled: int = 3  # positions after which a marker's own motion counts
    cut: float = 0.5  # share of the located markers that jump in a cut


_S = JumpSettings()
_WILD = math.log(_S.share / (4.0 / 3.0 * math.pi * _S.reach_m**3))  # log density of wild points, per m^3


class JumpGate:
    """Doubts the jumps of one body's markers, frame by frame."""

    def __init__(self, markers: int) -> None:
        self._doubted = np.zeros(markers, dtype=bool)
        self._ages = np.zeros(markers, dtype=np.int64)  # positions of each marker's present motion

    def step(self, points_m: Array, noise_m: Array, follower: MultipleModelFilter, carried_m: Array) -> Mask:
        """Return a mask (M,) of the markers that are doubted in the next frame.

        Args:
            points_m: Markers (M, 3), NaN where hidden.
            noise_m: Standard deviations (M,) of their coordinates.
            follower: Filter that has predicted them for this frame; it forgets markers whose jump is believed.
            carried_m: Torso markers (M, 3) where the body carries them, NaN where unknown.
        """
        away_m = np.linalg.norm(points_m - follower.means()[0], axis=1)
        self._ages[~follower.followed] = 0
        is_settled = self._ages >= _S.settled
        jumped = follower.followed & (away_m > _S.near_m)
        if jumped.any():
            jumped &= follower.log_likelihoods(points_m, noise_m) < _WILD
        off_m = np.linalg.norm(points_m - carried_m, axis=1)
        variances = _S.torso_m**2 + noise_m**2
        is_carried_off = -1.5 * np.log(2.0 * np.pi * variances) - 0.5 * off_m**2 / variances < _WILD
        jumped |= is_carried_off
        is_cut = np.count_nonzero(jumped) > _S.cut * np.count_nonzero(np.isfinite(away_m))
        doubted = jumped & ~self._doubted & (is_settled | is_carried_off) & (not is_cut)
        begins = np.full_like(jumped, is_cut) | (jumped & ~doubted)
        follower.forget(begins)
        self._ages[begins] = 0
        self._ages += np.isfinite(away_m) & ~doubted
        self._doubted = doubted
        return doubted
