"""All methods on the same takes, from a known performer to another studio."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.database.build import BuildSettings, build_database
from perfanim.core.database.labels import subject_of
from perfanim.core.database.store import Database, open_database
from perfanim.core.system.assets import MOTION
from perfanim.core.system.progress import Progress

from .data import (
    BANDAI,
    BOXING,
    CMU,
    FPS,
    WALKING,
    TestTake,
    read_take,
    whole_database,
    without_subject,
    without_tests,
)
from .figure6 import describe, solve_truth
from .methods import METHODS, WITH_PRIOR, compared_methods
from .report import write_figures

TAKES = (
    WALKING,
    TestTake("walking (35_01)", "35_01"),
    TestTake("jumping (16_02)", "16_02"),
    TestTake("running (09_03)", "09_03"),
    BOXING,
    TestTake("jumps, kicks, punches (86_01)", "86_01"),
)
STUDIO_TAKES = tuple(
    TestTake(trial, trial, 0.2)
    for trial in (
        "dataset-1_bow_normal_001",
        "dataset-1_dash_normal_001",
        "dataset-1_guide_normal_001",
        "dataset-1_walk-back_normal_001",
        "dataset-2_raise-up-right-hand_active_027",
        "dataset-2_walk_youthful_025",
        "dataset-2_wave-both-hands_feminine_004",
    )
)
UNSEEN_CLIP, UNSEEN_SUBJECT, UNSEEN_KIND = "unseen clip", "unseen subject", "unseen kind of motion"
STUDIO, EMBEDDED = "another studio", "embedded motion alone"
CONDITIONS = (UNSEEN_CLIP, UNSEEN_SUBJECT, UNSEEN_KIND, STUDIO, EMBEDDED)
_KINDS = {
    "walk": "walk",
    "jump": r"jump|hop",
    "run": r"run|jog|dash",
    "box": r"box|punch|kick",
    "kick": r"jump|kick|box",
}
_KIND_OF_TRIAL = {"16_16": "walk", "35_01": "walk", "16_02": "jump", "09_03": "run", "14_02": "box", "86_01": "kick"}
_FRAMES = 240  # of each take
_UNITS = (
    "deg_per_joint",
    "deg_per_angle",
    "mpjpe_mm",
    "bone_direction_deg",
    "twist_deg",
    "root_rotation_deg",
    "jitter_ratio",
    "foot_skate_cm_s",
)


@dataclass(frozen=True)
class _Case:
    """A take to be solved with a database."""

    condition: str
    take: TestTake
    truth: Motion
    database: Database


def accuracy(data: Path, out: Path, workers: int, progress: Progress) -> dict[str, Any]:
    """Solve takes by every method in every condition.

    Unseen kinds of motion keep the performer's other clips. `best` stands without the learned prior, and with one of
    those beside the databases (`out`/databases/motion_prior*.npz) that has not seen the performer.

    Returns:
        rows (condition, take, method, frames, errors, share of the nearest neighbour's error), joints (errors by
        joint), means (the same over the takes), prior (geometric means of the errors with the prior over those
        without, and the worst take), databases, outputs.
    """
    rows: list[dict[str, Any]] = []
    joints: list[dict[str, Any]] = []
    databases: dict[str, dict[str, Any]] = {}
    cases = list(_cases(data, out, workers, progress))
    for number, case in enumerate(cases):
        databases[f"{case.condition}: {case.take.title}"] = describe(case.database)
        progress(0.2 + 0.8 * number / len(cases), f"{case.take.title}, {case.condition}")
        methods = compared_methods(out, subject_of(case.take.trial))
        errors = {
            method: evaluate(solve_truth(case.truth, case.database, settings)[0], case.truth)
            for method, settings in methods.items()
        }
        of = {"condition": case.condition, "take": case.take.title}
        rows += [
            of
            | {"method": method, "frames": case.truth.frames}
            | {unit: round(error[unit], 4) for unit in _UNITS}
            | {"of_nearest": round(error["deg_per_joint"] / errors["nearest"]["deg_per_joint"], 4)}
            for method, error in errors.items()
        ]
        joints += [
            of | {"method": method, "joint": joint} | {unit: round(value, 3) for unit, value in by_unit.items()}
            for method, error in errors.items()
            for joint, by_unit in error["per_joint"].items()
        ]
    figures = {"rows": rows, "means": _means(rows), "prior": _prior_ratios(rows), "databases": databases}
    return write_figures(out, "accuracy", figures, {"": rows, "joints": joints})


def _cases(data: Path, out: Path, workers: int, progress: Progress) -> Iterable[_Case]:
    whole, folder = whole_database(data, out, (CMU,), workers, progress), out / "databases"
    embedded = _embedded_database(folder)
    for take in TAKES:
        truth = read_take(data, take)
        truth = sliced(truth, 0, min(_FRAMES, truth.frames))
        for condition, database in _databases(whole, folder, take).items():
            yield _Case(condition, take, truth, database)
        yield _Case(EMBEDDED, take, truth, embedded)
    for take in STUDIO_TAKES:
        truth = read_take(data, take, BANDAI)
        yield _Case(STUDIO, take, sliced(truth, 0, min(_FRAMES, truth.frames)), whole)


def _embedded_database(folder: Path) -> Database:
    path = folder / "embedded.pfdb"
    if not path.exists():
        build_database([MOTION], path, BuildSettings(fps=FPS, workers=1))
    return open_database(path)


def _databases(whole: Database, folder: Path, take: TestTake) -> dict[str, Database]:
    """Return the database of each condition.

    If the subject has no other clips an unseen clip is an unseen subject.
    """
    unseen = without_subject(whole, folder, subject_of(take.trial))
    clip_unseen = without_tests(whole, folder / "cmu-without-tests.pfdb")
    kind = _KIND_OF_TRIAL[take.trial]
    words = re.compile(_KINDS[kind])
    kind_unseen = without_tests(
        whole, folder / f"cmu-without-kind-{kind}.pfdb", lambda clip: not words.search(clip.behaviour.lower())
    )
    databases = {UNSEEN_CLIP: clip_unseen, UNSEEN_SUBJECT: unseen, UNSEEN_KIND: kind_unseen}
    if clip_unseen.frames == unseen.frames:
        del databases[UNSEEN_CLIP]
    return databases


def _means(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    means = []
    for condition in CONDITIONS:
        for method in (*METHODS, WITH_PRIOR):
            of = [row for row in rows if row["condition"] == condition and row["method"] == method]
            if of:
                means.append(
                    {"condition": condition, "method": method, "takes": len(of)}
                    | {unit: round(sum(row[unit] for row in of) / len(of), 4) for unit in (*_UNITS, "of_nearest")}
                )
    return means


def _prior_ratios(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the ratios of errors with the prior to those without, by condition."""
    found = []
    for condition in CONDITIONS:
        by = {(row["take"], row["method"]): row for row in rows if row["condition"] == condition}
        takes = [take for take, method in by if method == WITH_PRIOR]
        if not takes:
            continue
        ratios = {
            unit: [by[take, WITH_PRIOR][unit] / by[take, "best"][unit] for take in takes]
            for unit in ("deg_per_joint", "mpjpe_mm", "bone_direction_deg", "root_rotation_deg", "jitter_ratio")
        }
        means = {unit: round(float(np.exp(np.mean(np.log(values)))), 3) for unit, values in ratios.items()}
        found.append({"condition": condition, "takes": len(takes)} | means | {"worst": max(ratios["deg_per_joint"])})
    return found
