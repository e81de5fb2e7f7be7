"""Targets of a body's joints in every frame: keys met, standing feet held.

A joint's target is where the database's motion has it, plus a displacement. At a key the displacement leads to the
key; while a foot stands it keeps the toes where they are; between these it runs smoothly. A control goes on with the
displacement of its first key before that, and of its last key after it.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, Mask, runs
from .curves import curve_positions
from .sketch import Control

KEY_SIGMA_M, SWING_SIGMA_M, STAND_SIGMA_M = 0.002, 0.03, 0.004
_STANDS = 0.5  # share of the windows that show it
_MOVED_M = 0.05  # a foot whose keys are further apart does not stand between them
_SETTLE_M_PER_FRAME = 0.03  # a contact that a key contradicts by more begins or ends so many frames off


@dataclass(frozen=True)
class Targets:
    """Targets of joints.

    Args:
        joints: names (M).
        points_m: (F, M, 3), NaN without target.
        sigmas_m: (F, M) standard deviations.
    """

    joints: tuple[str, ...]
    points_m: Array
    sigmas_m: Array


def control_targets(control: Control, frames: Array, base_m: Array, follow: float) -> Array:
    """Return targets (F, 3) of a control.

    Args:
        frames: (F,) of the sketch.
        base_m: (F, 3) where the database's motion has the joint.
        follow: 0 keeps the database's motion between keys, 1 follows the curve.
    """
    keyed, positions_m = control.distinct_keys()
    at = (keyed - frames[0]).astype(np.int64)
    bent = base_m + curve_positions(keyed, positions_m - base_m[at], frames)
    between = (frames >= keyed[0]) & (frames <= keyed[-1])
    return np.where(between[:, None], bent + follow * (control.curve(frames) - bent), bent)


def standing_runs(standing: Array, shortest: int) -> list[tuple[int, int]]:
    """Return [first, stop) of each time in which a foot stands."""
    return [(first, stop) for first, stop in runs(standing > _STANDS) if stop - first >= shortest]


def held_foot(
    toes_m: Array, displacement_m: Array, contacts: list[tuple[int, int]], keyed: Mask, floor_m: float | None
) -> tuple[Array, Mask]:
    """Return displacements (F, 3) that hold a foot while it stands, and when it does.

    Args:
        toes_m: (F, 3) where the database's motion has the toes.
        displacement_m: (F, 3) wanted without contacts.
        contacts: [first, stop) of each.
        keyed: (F,) frames in which the foot has a key, which binds.
        floor_m: height at which toes stand, None to leave it.
    """
    frames = np.arange(len(toes_m), dtype=np.float64)
    known, values = keyed.copy(), displacement_m.copy()
    stands = np.zeros(len(toes_m), dtype=np.bool_)
    for first, stop in contacts:
        inside = np.arange(first, stop)
        own = inside[keyed[first:stop]]
        wanted = toes_m + displacement_m
        if len(own) and np.ptp(wanted[own], axis=0).max() > _MOVED_M:
            continue
        if len(own):
            anchors = np.column_stack([np.interp(inside, own, wanted[own, axis]) for axis in range(3)])
        else:
            anchors = np.repeat(wanted[inside].mean(axis=0)[None], len(inside), axis=0)
            if floor_m is not None:
                anchors[:, 1] = floor_m
        values[inside], known[inside], stands[inside] = anchors - toes_m[inside], True, True
    if not known.any():
        return displacement_m, stands
    # what contacts add to the wanted displacement fades between them
    added = curve_positions(frames[known], (values - displacement_m)[known], frames)
    return displacement_m + added, stands
