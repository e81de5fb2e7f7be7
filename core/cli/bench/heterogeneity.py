"""The paper's claim that one database may hold many behaviours: walking solved with walks alone and with all."""

from pathlib import Path
from typing import Any

from ...body.motion_metrics import evaluate
from ...database.store import Clip
from .data import CMU, WALKING, Progress, TestTake, read_take, whole_database, without_tests
from .figure6 import describe, solved
from .methods import METHODS
from .report import write_json, write_rows

TAKES = (WALKING, TestTake("walking (35_01)", "35_01"))
_UNITS = ("deg_per_joint", "deg_per_angle", "mpjpe_mm")


def heterogeneity(data: Path, out: Path, workers: int, progress: Progress) -> dict[str, Any]:
    """Solve walks by every method with a database of walks and with one of all behaviours, and write the comparison.

    Args:
        data: folder that holds `cmu`.
        out: folder to write to.
        workers: processes that read motion.

    Returns:
        rows (take, method, errors with either database, change of the first error), databases, outputs.
    """
    whole = whole_database(data, out, (CMU,), workers, progress)
    databases = {
        "walking": without_tests(whole, out / "databases" / "cmu-walking.perfdb", is_walk),
        "everything": without_tests(whole, out / "databases" / "cmu-without-tests.perfdb"),
    }
    rows = []
    for number, take in enumerate(TAKES):
        truth = read_take(data, take)
        for done, (method, settings) in enumerate(METHODS.items()):
            progress(0.25 + 0.75 * (number + done / len(METHODS)) / len(TAKES), f"{take.title}: {method}")
            row: dict[str, Any] = {"take": take.title, "method": method, "frames": truth.frames}
            for name, database in databases.items():
                errors = evaluate(solved(truth, database, settings)[0], truth)
                row |= {f"{unit} ({name})": round(errors[unit], 4) for unit in _UNITS}
            ratio = row["deg_per_joint (everything)"] / row["deg_per_joint (walking)"]
            rows.append(row | {"change_percent": round(100.0 * (ratio - 1.0), 2)})
    figures = {"rows": rows, "databases": {name: describe(database) for name, database in databases.items()}}
    write_json(out / "heterogeneity.json", figures)
    write_rows(out / "heterogeneity.csv", rows)
    return figures | {"outputs": [str(out / "heterogeneity.json"), str(out / "heterogeneity.csv")]}


def is_walk(clip: Clip) -> bool:
    """Whether a clip's description names walking."""
    return "walk" in clip.behaviour.lower()
