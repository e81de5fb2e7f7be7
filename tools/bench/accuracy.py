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
from perfanim.core.simulate.markers import simulate_markers
from perfanim.core.system.assets import MOTION
from perfanim.core.system.progress import Progress, no_progress

from .baseline import Baseline
from .data import (
    BANDAI,
    BOXING,
    CMU,
    FPS,
    WALKING,
    TestTake,
    read_take,
    skeleton_path,
    whole_database,
    without_subject,
    without_tests,
)
from .disturbed import disturbed_errors, disturbed_means
from .figure6 import MARKER_SET, describe, solve_truth, true_subject
from .methods import BASELINE, METHODS, WITH_PRIOR, compared_methods
from .plots import check_plots
from .report import write_figures
from .worst_frames import Picture, write_pictures

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
_QUICK = ("nearest", "best")
_FRAMES = 240  # of each take
_MOMENTS = (0.2, 0.4, 0.6, 0.8)  # shares of a take that are pictured
_DRAWN = 2000  # samples of the takes, for an interval
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
    """A take to be solved with a database.

    Args:
        skeleton: file with the body.
    """

    condition: str
    take: TestTake
    truth: Motion
    skeleton: Path
    database: Database


@dataclass(frozen=True)
class _Strip:
    """A case as `best` solved it, and its error in degrees per joint."""

    case: _Case
    solved: Motion
    error: float


def accuracy(
    data: Path, out: Path, workers: int, progress: Progress, checkout: Path | None = None, quick: bool = False
) -> dict[str, Any]:
    """Solve takes by every method in every condition.

    Unseen kinds keep the performer's other clips. `best` stands without the learned prior, and with one of those beside
    the databases (motion_prior*.npz) that has not seen the performer.

    Args:
        checkout: of another version; its `best` solves the same takes with its own databases of the same motion.
        quick: whether only `best` is compared with `nearest`, on exact markers.

    Returns:
        rows (condition, take, method, frames, errors, share of the nearest neighbour's error), joints (errors by
        joint), means (the same over the takes), prior (geometric means of the errors with the prior over those
        without, and the worst take), against (the same over the other version's `best`, of `best` and with the
        prior), disturbed (`best` on noisy, missing, slow and fast markers), disturbed_means, databases, outputs.
    """
    check_plots()
    baseline = Baseline(checkout, data, out / "baseline") if checkout else None
    rows: list[dict[str, Any]] = []
    joints: list[dict[str, Any]] = []
    disturbed: list[dict[str, Any]] = []
    strips: list[_Strip] = []
    databases: dict[str, dict[str, Any]] = {}
    cases = list(_cases(data, out, workers, progress))
    for number, case in enumerate(cases):
        databases[f"{case.condition}: {case.take.title}"] = describe(case.database)
        progress(0.2 + 0.8 * number / len(cases), f"{case.take.title}, {case.condition}")
        methods = compared_methods(out, subject_of(case.take.trial))
        if quick:
            methods = {name: methods[name] for name in (*_QUICK, WITH_PRIOR) if name in methods}
        motions = {method: solve_truth(case.truth, case.database, settings)[0] for method, settings in methods.items()}
        errors = {method: evaluate(motion, case.truth) for method, motion in motions.items()}
        ours = WITH_PRIOR if WITH_PRIOR in motions else "best"
        strips += [_Strip(case, motions[ours], errors[ours]["deg_per_joint"])]
        if baseline:
            errors[BASELINE] = evaluate(_solve_by(baseline, case), case.truth)
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
        if case.condition != EMBEDDED and not quick:
            found = disturbed_errors(case.truth, case.take.trial, case.database, out, no_progress)
            disturbed += [of | row for row in found]
    figures = {"rows": rows, "means": _means(rows), "databases": databases}
    figures |= {"disturbed": disturbed, "disturbed_means": disturbed_means(disturbed, CONDITIONS)}
    against = _ratios(rows, "best", BASELINE) + _ratios(rows, WITH_PRIOR, BASELINE)
    figures |= {"prior": _ratios(rows, WITH_PRIOR, "best"), "against": against}
    tables = {"": rows, "joints": joints} | ({"disturbed": disturbed} if disturbed else {})
    return write_figures(out, "accuracy", figures, tables, write_pictures(out / "accuracy-strips", _pictures(strips)))


def _pictures(strips: Sequence[_Strip]) -> list[Picture]:
    """Return moments of each condition's median and worst take, truth beside solved."""
    pictures = []
    for condition in CONDITIONS:
        ordered = sorted(
            (strip for strip in strips if strip.case.condition == condition), key=lambda strip: strip.error
        )
        for name, strip in (("median", ordered[(len(ordered) - 1) // 2]), ("worst", ordered[-1])) if ordered else ():
            truth = strip.case.truth
            for share in _MOMENTS:
                frame = int(share * truth.frames)
                title = f"{condition}, {name}: {strip.case.take.title}, frame {frame}"
                both = (sliced(motion, frame, frame + 1) for motion in (truth, strip.solved))
                pictures.append(Picture(title, *both))
    return pictures


def _cases(data: Path, out: Path, workers: int, progress: Progress) -> Iterable[_Case]:
    whole, folder = whole_database(data, out, (CMU,), workers, progress), out / "databases"
    embedded = _embedded_database(folder)
    for take in TAKES:
        truth = read_take(data, take)
        truth = sliced(truth, 0, min(_FRAMES, truth.frames))
        skeleton = skeleton_path(data, take)
        for condition, database in _databases(whole, folder, take).items():
            yield _Case(condition, take, truth, skeleton, database)
        yield _Case(EMBEDDED, take, truth, skeleton, embedded)
    for take in STUDIO_TAKES:
        truth = read_take(data, take, BANDAI)
        skeleton = skeleton_path(data, take, BANDAI)
        yield _Case(STUDIO, take, sliced(truth, 0, min(_FRAMES, truth.frames)), skeleton, whole)


def _solve_by(baseline: Baseline, case: _Case) -> Motion:
    """Return the other version's solution of a case."""
    take, _ = simulate_markers(case.truth, true_subject(case.truth))
    if case.condition == EMBEDDED:
        database = baseline.embedded_database()
    else:
        database = baseline.database(case.database.path.stem, {clip.name for clip in case.database.clips})
    return baseline.solve(take, case.skeleton, MARKER_SET, database)


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
        for method in (*METHODS, WITH_PRIOR, BASELINE):
            of = [row for row in rows if row["condition"] == condition and row["method"] == method]
            if of:
                means.append(
                    {"condition": condition, "method": method, "takes": len(of)}
                    | {unit: round(sum(row[unit] for row in of) / len(of), 4) for unit in (*_UNITS, "of_nearest")}
                )
    return means


def _ratios(rows: Sequence[dict[str, Any]], method: str, other: str) -> list[dict[str, Any]]:
    """Return the ratios of a method's errors to another's, by condition.

    Geometric means over the takes; of degrees per joint also their 95 % interval (bootstrap over takes) and the worst.
    """
    found = []
    for condition in CONDITIONS:
        by = {(row["take"], row["method"]): row for row in rows if row["condition"] == condition}
        takes = [take for take, name in by if name == method and (take, other) in by]
        if not takes:
            continue
        logs = {
            unit: np.log([by[take, method][unit] / by[take, other][unit] for take in takes])
            for unit in ("deg_per_joint", "mpjpe_mm", "bone_direction_deg", "root_rotation_deg", "jitter_ratio")
        }
        means = {unit: round(float(np.exp(values.mean())), 3) for unit, values in logs.items()}
        degrees = logs["deg_per_joint"]
        drawn = np.random.default_rng(0).choice(degrees, (_DRAWN, len(takes))).mean(axis=1)
        low, high = np.exp(np.percentile(drawn, (2.5, 97.5)))
        found.append(
            {"condition": condition, "method": method, "takes": len(takes)}
            | means
            | {
                "low": round(float(low), 3),
                "high": round(float(high), 3),
                "worst": round(float(np.exp(max(degrees))), 3),
            }
        )
    return found
