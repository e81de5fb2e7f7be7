"""The default method on markers that are noisy, missing, slow or fast."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.motion import Motion, resampled
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.database.labels import subject_of
from perfanim.core.database.store import Database
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.markers import simulate_markers
from perfanim.core.system.progress import Progress

from .figure6 import true_subject
from .methods import default_settings
from .report import Rows

SEEDS = (0, 1, 2)
_HIDDEN, _HIDDEN_S = "LHAN", (1.0, 1.5)  # the marker that is gone, and when
_UNITS = ("deg_per_joint", "mpjpe_mm", "bone_direction_deg", "jitter_ratio", "foot_skate_cm_s")


@dataclass(frozen=True)
class Disturbance:
    """Faults of the markers of a take.

    Args:
        noise_mm: standard deviation of each coordinate.
        dropout: share of marker positions that are missing.
        hides: whether one hand's marker is gone for half a second, too.
        fps: rate; 0 as the take.
    """

    name: str
    noise_mm: float = 0.0
    dropout: float = 0.0
    hides: bool = False
    fps: float = 0.0

    def take_of(self, truth: Motion, seed: int) -> tuple[MarkerTake, Motion]:
        """Return the disturbed markers of a motion, and the motion at their rate."""
        if self.fps:
            truth = resampled(truth, self.fps)
        take, _ = simulate_markers(truth, true_subject(truth), self.noise_mm, self.dropout, seed)
        if not self.hides:
            return take, truth
        positions = take.positions_m.copy()
        first, last = (round(second * truth.fps) for second in _HIDDEN_S)
        positions[first:last, take.names.index(_HIDDEN)] = np.nan
        return replace(take, positions_m=positions), truth


CLEAN = Disturbance("clean")
DISTURBANCES = (
    CLEAN,
    Disturbance("1 mm", noise_mm=1.0),
    Disturbance("3 mm", noise_mm=3.0),
    Disturbance("10 % lost", dropout=0.1),
    Disturbance("30 % lost, a hand for 0.5 s", dropout=0.3, hides=True),
    Disturbance("30 Hz", fps=30.0),
    Disturbance("120 Hz", fps=120.0),
)


def disturbed_errors(truth: Motion, trial: str, database: Database, out: Path, progress: Progress) -> Rows:
    """Return the errors of a take by disturbance, and their ratios to the clean one.

    Figures are means over the seeds; what has no chance in it is solved once.
    """
    subject, settings = true_subject(truth), default_settings(out, subject_of(trial))
    rows: list[dict[str, Any]] = []
    for disturbance in DISTURBANCES:
        errors = []
        for seed in SEEDS if disturbance.noise_mm or disturbance.dropout else SEEDS[:1]:
            take, moved = disturbance.take_of(truth, seed)
            solved = solve_take(take, subject, database, settings, progress)
            errors.append(evaluate(solved.motion, moved))
        means = {unit: float(np.mean([error[unit] for error in errors])) for unit in _UNITS}
        clean = rows[0]["deg_per_joint"] if rows else means["deg_per_joint"]
        rounded = {unit: round(value, 4) for unit, value in means.items()}
        ratio = round(rounded["deg_per_joint"] / clean, 4)
        rows.append({"disturbance": disturbance.name} | rounded | {"of_clean": ratio})
    return rows


def disturbed_means(rows: Rows, conditions: Sequence[str]) -> list[dict[str, Any]]:
    """Return geometric means by condition and disturbance, and the worst ratio."""
    means = []
    for condition in conditions:
        for disturbance in DISTURBANCES:
            of = [row for row in rows if (row["condition"], row["disturbance"]) == (condition, disturbance.name)]
            if of:
                means.append(
                    {"condition": condition, "disturbance": disturbance.name, "takes": len(of)}
                    | {unit: round(_geometric_mean([row[unit] for row in of]), 4) for unit in (*_UNITS[:4], "of_clean")}
                    | {"worst_of_clean": max(row["of_clean"] for row in of)}
                )
    return means


def _geometric_mean(values: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(values))))
