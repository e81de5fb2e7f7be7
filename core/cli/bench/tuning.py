"""The grid from which the settings of local-pca were chosen, on takes that no figure reports."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...body.motion import Motion
from ...database.store import Database
from ...solver.settings import SolveSettings
from .data import CMU, DEVELOPMENT, Progress, read_take, whole_database, without_development
from .figure6 import degrees_per_joint, solved
from .methods import METHODS, PAPER_RANGE, TUNED
from .report import write_json, write_rows

_SIZES = tuple((k, b) for k in (200, 400, 800) for b in (12, 25, 50))
# one at a time around the chosen settings; metres of marker, radians of velocity, metres that a radian counts
_WEIGHTS: dict[str, tuple[float, ...]] = {
    "marker_sigma_m": (0.002, 0.003, 0.01, 0.02, 0.03),
    "pose_sigma_rad": (0.3, 1.0, 3.0, 10.0),
    "query_pose_m_per_rad": (0.1, 0.3, 0.6, 1.0, 2.0),
}


def tuning(data: Path, out: Path, workers: int, progress: Progress) -> dict[str, Any]:
    """Solve the development takes by local-pca over a grid of K, B and the weights of the terms, and write the table.

    Args:
        data: folder that holds `cmu`.
        out: folder to write to.
        workers: processes that read motion.

    Returns:
        rows (what was varied, K, B, weights, deg/joint on each take, their mean and geometric mean), outputs.
    """
    whole = whole_database(data, out, (CMU,), workers, progress)
    database = without_development(whole, out / "databases" / "cmu-without-development.perfdb")
    truths = {take.title: read_take(data, take) for take in DEVELOPMENT}
    variants = list(_variants())
    rows = []
    for done, (varied, settings) in enumerate(variants):
        progress(0.25 + 0.75 * done / len(variants), f"tuning: {varied}")
        rows.append(_row(varied, settings, database, truths))
    write_json(out / "tuning.json", {"rows": rows})
    write_rows(out / "tuning.csv", rows)
    return {"rows": rows, "outputs": [str(out / "tuning.json"), str(out / "tuning.csv")]}


def _variants() -> Iterator[tuple[str, SolveSettings]]:
    """Yield what is varied and the settings."""
    yield from METHODS.items()
    for k, b in _SIZES:
        yield "tuned: K, B", replace(TUNED, neighbours=(k,), dimensions=(b,))
    for name, base in (("paper's range", PAPER_RANGE), ("tuned", TUNED)):
        for weight, values in _WEIGHTS.items():
            for value in values:
                yield f"{name}: {weight}", replace(base, **{weight: value})  # type: ignore[arg-type]


def _row(varied: str, settings: SolveSettings, database: Database, truths: dict[str, Motion]) -> dict[str, Any]:
    errors = {
        title: float(degrees_per_joint(solved(truth, database, settings)[0], truth).mean())
        for title, truth in truths.items()
    }
    values = np.array(list(errors.values()))
    local_pca = settings.method == "local-pca"  # the other methods have none of these settings
    return {
        "varied": varied,
        "K": " ".join(map(str, settings.neighbours)) if local_pca else "",
        "B": " ".join(map(str, settings.dimensions)) if local_pca else "",
        **{weight: getattr(settings, weight) if local_pca else "" for weight in _WEIGHTS},
        **{title: round(error, 4) for title, error in errors.items()},
        "mean": round(float(values.mean()), 4),
        "geometric_mean": round(float(np.exp(np.log(values).mean())), 4),
    }
