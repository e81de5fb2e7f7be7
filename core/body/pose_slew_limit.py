"""Slew limit for poses: a joint may turn suddenly only if markers below it show such a movement.

When a marker reappears, or the same markers are explained differently, a joint can move faster than a body can. Such a
joint is turned to its new rotation at a limited rate. It may turn faster in a movement that has gained speed over
several frames and carries markers along, so a punch is shown as solved. If the markers themselves jump, nothing is
limited: they show another person, or the same one after a gap.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray, Mask
from ..kernel.library import address, checked, contiguous, function, stage
from .clock import PAUSE_S
from .skeleton import Skeleton

_FRAME_S = 1.0 / 60.0  # frame interval to which the limits below refer
_USUAL_RAD = np.radians(9.8)  # largest rotation per frame that no marker needs to show
_AT_CHANGE_RAD = np.radians(2.9)  # the same in the two frames after a marker of the limb appears or disappears
_GATHERED_RAD = np.radians(3.34)  # largest increase of the rotation per frame in an accelerating movement
_GATHERED_FRAMES = 5  # number of earlier frames with which the rotation is compared
_GAINS_RAD = _GATHERED_RAD * np.arange(_GATHERED_FRAMES, -1, -1)[:, None]
_LEVER_M = 0.32  # lever by which a marker's movement is divided to limit the rotation of joints above it
_FASTEST_M = 0.15  # movement of a marker per frame above which it is not used
# number of first poses of a body just found that are shown as solved: the very first may be wrong, and must not hold
# back the next
_NEW_FRAMES = 8
_FADING = 0.8  # factor per frame by which the last movement of a hidden marker decays
_CUT_M = 0.15  # distance per frame from all recent positions that makes a marker part of a cut
_CUT_MARKERS, _CUT_SHARE = 2, 0.2  # smallest number and share of such markers that make a cut
_CUT_SHARE_FOUND = 0.6  # this share if the session found the labels, because some points may be ghosts
_EXCHANGED_M = 0.05  # distance per frame from another marker's recent position up to which labels were exchanged


class PosesBefore(NamedTuple):
    """Earlier poses of J joints."""

    solved: Array  # (J, 4) the last solved rotations
    shown: Array  # (J, 4) the last limited rotations
    turns: Array  # (T, J, 3) turns per frame of earlier solved poses; not used until there are enough


class TurnLimits(NamedTuple):
    """How much J joints may turn, from what M markers show."""

    usual_rad: Array  # (J,) rotations per frame that no marker needs to show
    shares: Array  # (M, J) shares of a marker's movement by which joints may turn
    ways_m: Array  # (M,) movements of the markers per frame


class PoseSlewLimit:
    """Limits the rotation rates of joints in successive poses, except the root's.

    Args:
        carriers: Joint (M,) of each marker.
        offsets_m: Offsets (M, 3) of the markers in their joints' frames.
    """

    def __init__(self, skeleton: Skeleton, carriers: IntArray, offsets_m: Array) -> None:
        below = skeleton.is_ancestor[carriers]  # the joints that can move each marker: its carrier and the ancestors
        self._limbs: Mask = below | skeleton.is_ancestor.T[carriers]
        rest_m = skeleton.rest_positions_m
        levers_m = np.linalg.norm((rest_m[carriers] + offsets_m)[:, None] - rest_m, axis=-1)
        # a marker close to a joint is moved mostly by the joints above
        self._shares = below * np.minimum(levers_m / _LEVER_M, 1.0) ** 2
        self._before: PosesBefore  # the last poses, once there is one
        self.reset()

    def reset(self) -> None:
        """Show the next pose unchanged."""
        self._time_s = float("nan")

    def step(
        self,
        time_s: float,
        rotations: Array,
        root_position_m: Array,
        points_m: Array,
        held: bool = False,
        labels_known: bool = True,
    ) -> Array:
        """Return the next pose's limited rotations (J, 4).

        Args:
            points_m: Located markers (M, 3), NaN where hidden.
            held: Keep the joints at their current rotations.
            labels_known: The source labelled the markers.
        """
        frames = (time_s - self._time_s) / _FRAME_S
        in_root_m = (points_m - root_position_m) @ rot.to_matrix(rotations[0])
        seen = np.isfinite(points_m[:, 0])
        share = _CUT_SHARE if labels_known else _CUT_SHARE_FOUND
        if not 0.0 < frames < PAUSE_S / _FRAME_S or self._is_cut(time_s, points_m, share):
            self._ways_m = np.zeros(len(points_m))
            self._seen_s = np.full(len(points_m), time_s)
            self._seen, self._changed = seen, np.zeros(len(points_m), dtype=np.bool_)
            self._trail, self._new = deque[tuple[float, Array]](), _NEW_FRAMES
            shown, turns = rotations, np.empty((0, len(rotations), 3))
        else:
            self._changed, changed = seen != self._seen, self._changed
            self._seen = seen
            usual_rad, self._ways_m = self._usual_rad(self._changed | changed), self._moved_m(frames, in_root_m)
            limits = TurnLimits(usual_rad, self._shares, self._ways_m)
            limited, turned = limited_turns(frames, rotations, self._before, limits, held)
            shown, turns = limited, np.concatenate((self._before.turns[1 - _GATHERED_FRAMES :], turned[None]))
            if self._new > 0:
                shown, self._new = rotations, self._new - 1
        self._time_s, self._before, self._in_root_m = time_s, PosesBefore(rotations, shown, turns), in_root_m
        self._seen_s[seen] = time_s
        self._trail.append((time_s, points_m))
        while time_s - self._trail[0][0] > PAUSE_S:
            self._trail.popleft()
        return shown

    def _is_cut(self, time_s: float, points_m: Array, share: float) -> bool:
        """Return whether many markers are far from all their recent positions."""
        frames = np.maximum(1.0, (time_s - self._seen_s) / _FRAME_S)
        recent_m = np.array([earlier_m for _, earlier_m in self._trail])
        away_m = points_m - recent_m
        far = np.fmin.reduce(np.add.reduce(away_m * away_m, axis=-1)) > (_CUT_M * frames) ** 2
        if not far.any():
            return False
        # a marker whose label was exchanged is where another marker was
        others_m = np.linalg.norm(points_m[far, None] - recent_m[:, far].reshape(-1, 3), axis=-1)
        moved = np.sum(np.fmin.reduce(others_m, axis=1, initial=np.inf) > _EXCHANGED_M * frames[far])
        return bool(moved >= max(_CUT_MARKERS, share * np.isfinite(points_m[:, 0]).sum()))

    def _usual_rad(self, changed: Mask) -> Array:
        """Return the rotations per frame (J,) that no marker needs to show.

        Args:
            changed: Markers (M,) that appeared or disappeared in this frame or the last.
        """
        usual_rad = np.full(self._shares.shape[1], _USUAL_RAD)
        if changed.any():
            usual_rad[self._limbs[changed].any(axis=0)] = _AT_CHANGE_RAD
        return usual_rad

    def _moved_m(self, frames: float, in_root_m: Array) -> Array:
        """Return the movements (M,) of the markers per frame, those of hidden ones fading, 0 for what is too fast."""
        ways_m = rot.lengths(in_root_m - self._in_root_m) / frames
        ways_m = np.where(np.isfinite(ways_m), ways_m, _FADING * self._ways_m)
        ways_m[ways_m > _FASTEST_M] = 0.0
        return ways_m


_LIMITED = function("limited_turns", "nnndddnppppppppp")


def _compiled(
    frames: float, rotations: Array, before: PosesBefore, limits: TurnLimits, held: bool
) -> tuple[Array, Array]:
    joints, limited, turned = len(rotations), np.empty(rotations.shape), np.empty((len(rotations), 3))
    count = _GATHERED_FRAMES if len(before.turns) == _GATHERED_FRAMES else 0
    numbers = joints, len(limits.ways_m), count, frames, _GATHERED_RAD, _LEVER_M, held
    given = map(contiguous, (rotations, *before, *limits))
    checked(_LIMITED(*numbers, *given, address(limited), address(turned)))
    return limited, turned


@stage(_compiled)
def limited_turns(
    frames: float, rotations: Array, before: PosesBefore, limits: TurnLimits, held: bool
) -> tuple[Array, Array]:
    """Return limited rotations (J, 4), and the turns (J, 3) per frame from the last solved ones.

    Args:
        frames: Time since the last pose in 60ths of a second.
        rotations: Solved rotations (J, 4); the root's is returned as it is.
        held: Keep the joints at their current rotations.
    """
    solved, turn = _turn(np.array(before[:2]), rotations)
    turned = solved / frames
    angle = np.maximum(rot.lengths(turn), 1e-12)
    limit = limits.usual_rad
    if len(before.turns) == _GATHERED_FRAMES:
        along = np.add.reduce(np.concatenate((before.turns, turned[None])) * turn, axis=-1) / angle
        explained = np.maximum.reduce(limits.shares * limits.ways_m[:, None]) / _LEVER_M
        limit = np.maximum(limit, np.minimum(np.minimum.reduce(along + frames * _GAINS_RAD), explained))
    share = np.zeros(len(turn)) if held else limit * frames / angle
    share[0] = 1.0
    late = share < 1.0
    limited = rotations.copy()
    limited[late] = rot.multiply(before.shown[late], rot.from_rotation_vector(share[late, None] * turn[late]))
    return limited, turned


def _turn(start: Array, end: Array) -> Array:
    """Return the rotation vectors (..., J, 3) from rotations to others, in the joints' frames."""
    return np.asarray(rot.to_rotation_vector(rot.multiply(rot.conjugate(start), end)))
