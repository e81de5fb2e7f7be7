"""Faults of labels put into takes at random places, and how many of them are found."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from perfanim.core.geometry.arrays import Array, Mask
from perfanim.core.markers.label_faults import FaultKind, LabelFault
from perfanim.core.markers.marker_take import MarkerTake

_LEAST_M = 0.02  # a fault moves a marker at least so far; frozen feet that stand are none
_WILD_M = (0.05, 0.17)  # distance of wild points
_WILD_FRAMES = 3  # most in a row
_LASTS_S = (0.1, 1.0)  # exchanges and frozen stretches
_APART_S = 0.5  # between two faults
_TRIES = 100


@dataclass(frozen=True)
class Fault:
    """A fault that was put into a take.

    Args:
        name: What kind of fault, for tables.
        stretch: Where it is.
        wrong: Positions (F, M) that it moved by at least 20 mm.
    """

    name: str
    stretch: LabelFault
    wrong: Mask


def with_faults(take: MarkerTake, names: Sequence[str], seed: int) -> tuple[MarkerTake, list[Fault]]:
    """Return a take with one fault of each name, as far as there is room.

    Args:
        names: "frozen", "wild", "sides" (all markers of both sides), or the ends of two names, such as "FOO" for LFOO
            and RFOO.
    """
    generator = np.random.default_rng(seed)
    positions, free = take.positions_m.copy(), np.ones(take.frames, dtype=bool)
    faults = []
    apart = round(_APART_S * take.fps)
    free[: apart // 2] = free[-(apart // 2) :] = False
    for name in names:
        for _ in range(_TRIES):
            made = _made(take, name, generator)
            if made is None:
                continue
            stretch, changed = made
            if not free[max(0, stretch.first - apart) : stretch.last + apart + 1].all():
                continue
            away = np.linalg.norm(changed - take.positions_m[stretch.first : stretch.last + 1], axis=-1)
            wrong = np.zeros(take.positions_m.shape[:2], dtype=bool)
            wrong[stretch.first : stretch.last + 1] = away > _LEAST_M
            if not wrong.any():
                continue
            positions[stretch.first : stretch.last + 1] = changed
            free[stretch.first : stretch.last + 1] = False
            faults.append(Fault(name, stretch, wrong))
            break
    return replace(take, positions_m=positions), faults


def _made(take: MarkerTake, name: str, generator: np.random.Generator) -> tuple[LabelFault, Array] | None:
    """Return a fault at a random place, and the positions (n, M, 3) of its frames."""
    frames = int(generator.integers(1, _WILD_FRAMES + 1))
    if name != "wild":
        frames = max(round(float(generator.uniform(*_LASTS_S)) * take.fps), 2)
    if frames + 2 > take.frames:
        return None
    first = int(generator.integers(1, take.frames - frames))
    rows = slice(first, first + frames)
    changed = take.positions_m[rows].copy()
    if name in ("frozen", "wild"):
        marker = int(generator.integers(len(take.names)))
        kind = FaultKind.FROZEN if name == "frozen" else FaultKind.WILD
        if name == "frozen":
            changed[:, marker] = take.positions_m[first - 1, marker]
        else:
            away = generator.normal(size=3)
            changed[:, marker] += away / np.linalg.norm(away) * generator.uniform(*_WILD_M)
        labels: tuple[str, ...] = (take.names[marker],)
    else:
        end, kind = "" if name == "sides" else name, FaultKind.EXCHANGED
        left = [each for each in take.names if each[0] == "L" and each.endswith(end) and "R" + each[1:] in take.names]
        for each in left:
            pair = [take.names.index(each), take.names.index("R" + each[1:])]
            changed[:, pair] = changed[:, pair[::-1]]
        labels = tuple(side + each[1:] for each in left for side in "LR")
        if not labels:
            return None
    return LabelFault(first, first + frames - 1, labels, kind), changed


def scored(
    take: MarkerTake, corrected: MarkerTake, found: Sequence[LabelFault], faults: Sequence[Fault]
) -> tuple[list[dict[str, Any]], list[LabelFault]]:
    """Return a row for each fault, and the stretches that name none.

    Args:
        take: Without faults.
        corrected: With faults, corrected.
    """
    told = np.zeros(take.positions_m.shape[:2], dtype=bool)
    for each in found:
        told[each.first : each.last + 1, [take.names.index(label) for label in each.labels]] = True
    away = np.linalg.norm(corrected.positions_m - take.positions_m, axis=-1)
    rows = [
        {
            "fault": fault.name,
            "first": fault.stretch.first,
            "frames": fault.stretch.last - fault.stretch.first + 1,
            "found": bool(told[fault.wrong].mean() >= 0.5),
            "left_wrong": round(float((away[fault.wrong] > _LEAST_M).mean()), 3),
        }
        for fault in faults
    ]
    alarms = [
        each
        for each in found
        if not any(
            each.first <= fault.stretch.last + 1
            and each.last >= fault.stretch.first - 1
            and set(each.labels) & set(fault.stretch.labels)
            for fault in faults
        )
    ]
    return rows, alarms
