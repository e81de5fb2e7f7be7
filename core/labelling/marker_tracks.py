"""Tracks of labelled markers: where they were last located, and where and how near to it they are expected next."""

from dataclasses import astuple, dataclass
from typing import NamedTuple

import numpy as np

from ..geometry.arrays import Array, IntArray, Mask
from ..kernel.library import Packed, address, checked, contiguous, function, stage


@dataclass(frozen=True)
class TrackSettings:
    """Settings of tracks, tuned on takes with crossing limbs and returning markers (tuning log)."""

    gate_m: float = 0.08  # gate of a marker at rest
    gate_speed_share: float = 0.6  # growth of the gate, as a share of the predicted movement
    gate_unknown_m_s: float = 6.0  # growth of the gate per second for a marker with unknown velocity
    gate_hidden_m_s: float = 2.0  # growth of the gate per second that the marker has been hidden
    limb_gate_m: float = 0.35  # largest gate of a marker on a limb
    torso_gate_m: float = 0.12  # largest gate of a marker on the torso
    memory_s: float = 0.1  # longest time for which a marker's last velocity is used
    steady_m: float = 0.06  # largest distance from the extrapolated position of a marker that is tracked confidently


SETTINGS = TrackSettings()
_PACKED = Packed(*astuple(SETTINGS))


class Tracks(NamedTuple):
    """State of M markers when they were last located."""

    positions_m: Array  # (M, 3)
    velocities_m_s: Array  # (M, 3), NaN where unknown
    hidden_s: Array  # (M,) time for which the marker has been hidden
    is_steady: Mask  # (M,) the marker was close to its extrapolated position
    is_confident: Mask  # (M,) tracked confidently since its labels were last certain

    @classmethod
    def unknown(cls, count: int) -> "Tracks":
        """Return the tracks of markers that have never been located."""
        never = np.zeros(count, dtype=bool)
        return cls(np.full((count, 3), np.nan), np.full((count, 3), np.nan), np.full(count, np.inf), never, never)

    def copy(self) -> "Tracks":
        """Return tracks that can be changed without changing these."""
        numbers = self.positions_m.copy(), self.velocities_m_s.copy(), self.hidden_s.copy()
        return Tracks(*numbers, self.is_steady.copy(), self.is_confident.copy())


_EXPECTED = function("expected_markers", "ndpppppppp")


def _compiled_expectation(tracks: Tracks, torso: Mask, predicted_m: Array, elapsed_s: float) -> tuple[Array, Array]:
    expected_m, gates_m = np.empty(tracks.positions_m.shape), np.empty(len(torso))
    given = (contiguous(each) for each in (*tracks[:3], predicted_m))
    masks = address(tracks.is_steady), contiguous(torso, np.bool_)
    found = address(expected_m), address(gates_m)
    checked(_EXPECTED(len(torso), elapsed_s, _PACKED.address, *given, *masks, *found))
    return expected_m, gates_m


@stage(_compiled_expectation)
def expected_markers(tracks: Tracks, torso: Mask, predicted_m: Array, elapsed_s: float) -> tuple[Array, Array]:
    """Return the expected markers (M, 3) and their gates (M,), metres.

    A marker that is hidden only briefly is extrapolated, because the pose may drift away from it at once.

    Args:
        torso: Mask (M,) of the markers on the torso.
        predicted_m: Markers (M, 3) of the last pose.
        elapsed_s: Time since that pose.
    """
    is_known = np.isfinite(tracks.velocities_m_s[:, 0])
    fresh = is_known & (tracks.hidden_s < SETTINGS.memory_s)
    movement = np.where(fresh[:, None], tracks.velocities_m_s * elapsed_s, 0.0)
    hidden_s = np.where(np.isfinite(tracks.hidden_s), tracks.hidden_s, 1.0)
    gates = SETTINGS.gate_m + SETTINGS.gate_speed_share * np.linalg.norm(movement, axis=1)
    gates += SETTINGS.gate_hidden_m_s * hidden_s + np.where(is_known, 0.0, SETTINGS.gate_unknown_m_s * elapsed_s)
    hidden_briefly = fresh & (tracks.hidden_s > 0.0) & tracks.is_steady
    extrapolated = tracks.positions_m + tracks.velocities_m_s * tracks.hidden_s[:, None]
    predicted_m = np.where(hidden_briefly[:, None], extrapolated, predicted_m)
    return predicted_m + movement, np.minimum(gates, np.where(torso, SETTINGS.torso_gate_m, SETTINGS.limb_gate_m))


_LOCATED = function("located_tracks", "nndpppppppp")


def _compiled_tracks(tracks: Tracks, points_m: Array, labels: IntArray, elapsed_s: float) -> Tracks:
    after = tracks.copy()
    given = _PACKED.address, contiguous(points_m), contiguous(labels, np.int64)
    checked(_LOCATED(len(tracks.hidden_s), len(labels), elapsed_s, *given, *map(address, after)))
    return after


@stage(_compiled_tracks)
def located_tracks(tracks: Tracks, points_m: Array, labels: IntArray, elapsed_s: float) -> Tracks:
    """Return the tracks after points (N, 3) with labels (N,), each of another marker, or -1.

    Confidence is withdrawn from markers that jumped, came close to others or were hidden, and after a cut from all.

    Args:
        elapsed_s: Time since the last points.
    """
    positions_m, velocities_m_s, hidden_s, is_steady, is_confident = tracks.copy()
    points = np.flatnonzero(labels >= 0)
    markers, located_m = labels[points], points_m[points]
    since_s = hidden_s + elapsed_s
    moving_s = np.where(since_s < SETTINGS.memory_s, since_s, 0.0)
    expected_m = positions_m + np.where(np.isfinite(velocities_m_s), velocities_m_s, 0.0) * moving_s[:, None]
    away = np.linalg.norm(points_m[:, None] - expected_m[None], axis=-1)
    away[np.isnan(away)] = np.inf
    own = away[points, markers]
    away[points, markers] = np.inf
    others = np.minimum(away.min(axis=1, initial=np.inf)[points], away.min(axis=0, initial=np.inf)[markers])
    steady = own < SETTINGS.steady_m
    is_steady[markers] = steady
    is_confident[markers] &= steady & (others > own + SETTINGS.steady_m)
    is_confident &= since_s < SETTINGS.memory_s
    if 2 * np.count_nonzero(steady) <= len(steady):  # there is a cut, or the body was hidden
        is_confident[:] = False
    if elapsed_s > 0.0:
        known = hidden_s[markers] < SETTINGS.memory_s
        velocity = (located_m - positions_m[markers]) / (elapsed_s + hidden_s[markers][:, None])
        velocities_m_s[markers] = np.where(known[:, None], velocity, np.nan)
    since_s[markers] = 0.0
    positions_m[markers] = located_m
    return Tracks(positions_m, velocities_m_s, since_s, is_steady, is_confident)
