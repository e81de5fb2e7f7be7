"""Means, ratios and grouping of table rows."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from perfanim.core.geometry.arrays import Array

from .run import Rows

OVER = 1.02  # takes with a larger ratio are listed
UNITS = (
    "deg_per_joint", "mpjpe_mm", "bone_direction_deg", "main_bone_direction_deg", "root_rotation_deg", "jitter_ratio"
)  # fmt: skip


def groups(rows: Rows, *keys: str) -> dict[tuple[Any, ...], list[Any]]:
    """Return rows grouped by the values of some columns, in the order of each group's first row."""
    found: dict[tuple[Any, ...], list[Any]] = {}
    for row in rows:
        found.setdefault(tuple(row[key] for key in keys), []).append(row)
    return found


def mean(rows: Rows, column: str, digits: int = 4) -> float:
    """Return the mean of a column ignoring NaN (feet that are never planted have no skate); NaN if nothing is left."""
    known = [row[column] for row in rows if np.isfinite(row[column])]
    return round(float(np.mean(known)), digits) if known else float("nan")


def geometric_mean(values: Iterable[float]) -> float:
    """Return the geometric mean of positive values ignoring NaN; NaN if nothing is left."""
    known = np.array([value for value in values if np.isfinite(value)])
    return float(np.exp(np.mean(np.log(known)))) if len(known) else float("nan")


def interval(logs: Array) -> tuple[float, float]:
    """Return the 95 % interval of the geometric mean of exp(logs), by a bootstrap."""
    drawn = np.random.default_rng(0).choice(logs, (2000, len(logs))).mean(axis=1)
    low, high = np.exp(np.percentile(drawn, (2.5, 97.5)))
    return round(float(low), 3), round(float(high), 3)


def paired_ratios(rows: Rows, method: str, other: str, conditions: Sequence[str]) -> list[dict[str, Any]]:
    """Return the ratios of a method's errors to another's, by condition.

    These are geometric means over the takes; for degrees and millimetres with the 95 % interval of the mean (bootstrap
    over takes), the worst take, and takes above 1.02.
    """
    found = []
    for condition in conditions:
        by = {(row["take"], row["method"]): row for row in rows if row["condition"] == condition}
        takes = [take for take, name in by if name == method and (take, other) in by]
        if not takes:
            continue
        logs = {unit: np.log([by[take, method][unit] / by[take, other][unit] for take in takes]) for unit in UNITS}
        row: dict[str, Any] = {"condition": condition, "method": method, "other": other, "takes": len(takes)}
        row |= {unit: round(float(np.exp(values.mean())), 3) for unit, values in logs.items()}
        for unit in UNITS[:2]:
            row |= dict(zip((f"{unit}_low", f"{unit}_high"), interval(logs[unit]), strict=True))
        degrees = np.exp(logs["deg_per_joint"])
        over = [f"{take} {ratio:.2f}" for take, ratio in zip(takes, degrees, strict=True) if ratio > OVER]
        found.append(row | {"worst": round(float(degrees.max()), 3), "over": over})
    return found
