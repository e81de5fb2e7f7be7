"""All methods on the same takes, with the clip or its whole subject unseen."""

from pathlib import Path
from typing import Any

from perfanim.core.body.motion import sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.database.labels import subject_of
from perfanim.core.database.store import Database
from perfanim.core.system.progress import Progress

from .data import BOXING, CMU, WALKING, TestTake, read_take, whole_database, without_subject, without_tests
from .figure6 import describe, solve_truth
from .methods import METHODS
from .report import write_figures

TAKES = (
    WALKING,
    TestTake("walking (35_01)", "35_01"),
    TestTake("jumping (16_02)", "16_02"),
    TestTake("running (09_03)", "09_03"),
    BOXING,
    TestTake("jumps, kicks, punches (86_01)", "86_01"),
)
UNSEEN_CLIP, UNSEEN_SUBJECT = "unseen clip", "unseen subject"
_FRAMES = 240  # of each take
_UNITS = (
    "deg_per_joint",
    "deg_per_angle",
    "mpjpe_mm",
    "bone_direction_deg",
    "twist_deg",
    "jitter_ratio",
    "foot_skate_cm_s",
)


def accuracy(data: Path, out: Path, workers: int, progress: Progress) -> dict[str, Any]:
    """Solve takes by every method without the clip, then without its whole subject.

    Returns:
        rows (condition, take, method, frames, errors, share of the nearest neighbour's error), means (the same over
        the takes), databases, outputs.
    """
    whole = whole_database(data, out, (CMU,), workers, progress)
    rows: list[dict[str, Any]] = []
    databases: dict[str, dict[str, Any]] = {}
    for number, take in enumerate(TAKES):
        truth = read_take(data, take)
        truth = sliced(truth, 0, min(_FRAMES, truth.frames))
        for half, (condition, database) in enumerate(_conditions(whole, out / "databases", take).items()):
            databases[f"{condition}: {take.title}"] = describe(database)
            progress(0.2 + 0.8 * (number + 0.5 * half) / len(TAKES), f"{take.title}, {condition}")
            errors = {method: evaluate(solve_truth(truth, database, s)[0], truth) for method, s in METHODS.items()}
            rows += [
                {"condition": condition, "take": take.title, "method": method, "frames": truth.frames}
                | {unit: round(error[unit], 4) for unit in _UNITS}
                | {"of_nearest": round(error["deg_per_joint"] / errors["nearest"]["deg_per_joint"], 4)}
                for method, error in errors.items()
            ]
    figures = {"rows": rows, "means": _means(rows), "databases": databases}
    return write_figures(out, "accuracy", figures, {"": rows})


def _conditions(whole: Database, folder: Path, take: TestTake) -> dict[str, Database]:
    """Return the database of each condition.

    If the subject has no other clips both are the same: the second.
    """
    unseen = without_subject(whole, folder, subject_of(take.trial))
    clip_unseen = without_tests(whole, folder / "cmu-without-tests.pfdb")
    if clip_unseen.frames == unseen.frames:
        return {UNSEEN_SUBJECT: unseen}
    return {UNSEEN_CLIP: clip_unseen, UNSEEN_SUBJECT: unseen}


def _means(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    means = []
    for condition in (UNSEEN_CLIP, UNSEEN_SUBJECT):
        for method in METHODS:
            of = [row for row in rows if row["condition"] == condition and row["method"] == method]
            if of:
                means.append(
                    {"condition": condition, "method": method, "takes": len(of)}
                    | {unit: round(sum(row[unit] for row in of) / len(of), 4) for unit in (*_UNITS, "of_nearest")}
                )
    return means
