"""Accuracy of the default settings compared with other methods, from known people to another studio's takes.

Each take is solved live and offline from exact and from disturbed markers. The learned prior is one from the
databases' folder (motion_prior*.npz) that was not trained on the performer.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.database.file_selection import subject_of
from perfanim.core.database.store import Database, open_database
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.solver.settings import SolveSettings

from .baseline import Baseline
from .disturbed import MEASURES, SEEDS, disturbed_means, solve_disturbed
from .plots import Line, Panel, Picture, check_plots, write_pictures, write_plot
from .run import Rows, Run
from .scenarios import (
    ACCURACY_TAKES,
    BANDAI,
    BASELINES,
    CMU,
    DISTURBANCES,
    LIVE,
    METHODS,
    OFFLINE,
    QUICK_DISTURBANCES,
    STUDIO_TAKES,
    TUNED,
    Take,
)
from .solving import (
    DEEPEST,
    MARKER_SET,
    SKATE,
    Expected,
    confidence_ratio,
    coverage,
    describe,
    feet_errors,
    solve_truth,
)
from .tables import groups, mean, paired_ratios

UNSEEN_CLIP, UNSEEN_SUBJECT, UNSEEN_KIND = "unseen clip", "unseen subject", "unseen kind of motion"
STUDIO, OTHER_STUDIO = "Bandai-Namco by CMU", "CMU by Bandai-Namco"  # names of the studios
EMBEDDED = "embedded motion alone"
CONDITIONS = (UNSEEN_CLIP, UNSEEN_SUBJECT, UNSEEN_KIND, STUDIO, OTHER_STUDIO, EMBEDDED)
# kind of motion of each trial, and the behaviours that belong to this kind
_KINDS = {
    "16_16": ("walk", "walk"),
    "35_01": ("walk", "walk"),
    "16_02": ("jump", "jump|hop"),
    "09_03": ("run", "run|jog|dash"),
    "14_02": ("box", "box|punch|kick"),
    "86_01": ("kick", "jump|kick|box"),
}
_QUICK_METHODS = ("nearest", "best", TUNED)
_FRAMES, _QUICK_FRAMES = 240, 120  # frames per take, full and quick: all takes need an hour, or ten minutes
_MOMENTS = (0.2, 0.4, 0.6, 0.8)  # positions in a take that are pictured, as shares
_PLOTTED = ("nearest", LIVE, OFFLINE, BASELINES[OFFLINE], TUNED)
_MEASURES = (*MEASURES, "foot_skate_truth_cm_s")


@dataclass(frozen=True)
class Case:
    """A take to be solved with a database, prepared so that another process can read it."""

    condition: str
    take: Take
    truth: Motion  # its first frames
    skeleton: Path  # file with the body
    database: Path
    settings: SolveSettings

    @property
    def of(self) -> dict[str, str]:
        """Return the columns that identify the case in tables."""
        return {"condition": self.condition, "take": self.take.title}

    def database_of(self, baseline: Baseline) -> Path:
        """Return another version's database with the same motion; it is built if missing."""
        if self.condition == EMBEDDED:
            return baseline.embedded_database()
        clips = {clip.name for clip in open_database(self.database).clips}
        return baseline.database(self.database.stem, clips, BANDAI if self.condition == OTHER_STUDIO else CMU)


class _Solved(NamedTuple):
    """A case solved by all methods."""

    rows: list[dict[str, Any]]
    disturbed: list[dict[str, Any]]
    live: Motion  # solved live from exact markers
    error: float  # error of `live`, degrees per joint
    expected: dict[tuple[str, str], list[Expected]]  # expected and actual errors, by disturbance and mode


def accuracy(run: Run, baseline: Path | None = None, quick: bool = False) -> dict[str, Any]:
    """Solve takes with every method under every condition.

    For an unseen kind of motion, the performer's clips of other kinds stay in the database. `live` and `offline` are
    the default settings; the methods are all live, without the learned prior.

    Args:
        baseline: Folder of another version, which solves the same takes with its own databases of the same motion and
            the same learned priors.
        quick: Compare fewer methods, solve fewer frames, and disturb markers in fewer ways with one seed.

    Returns:
        rows (condition, take, method, frames, errors, held feet, share of the nearest neighbour's error), means (the
        same over the takes), ratios (paired, of two methods), disturbed, disturbed_means (live and offline with noisy,
        missing, slow and fast markers), disturbed_ratios (the same relative to the other version), intervals (shares of
        errors within twice the expected error), confidence (errors of its lowest and highest tenths), priors,
        databases, outputs.
    """
    check_plots()
    frames = _QUICK_FRAMES if quick else _FRAMES
    cases = list(cases_of(run, frames))
    baselines: list[tuple[Baseline, Path] | None] = [None] * len(cases)
    if baseline:
        product = Baseline(baseline, run)
        by_file = {case.database: case for case in cases}
        jobs = {str(path): (case, product) for path, case in by_file.items()}
        paths = dict(zip(by_file, run.each("baseline-databases", Case.database_of, jobs), strict=True))
        baselines = [(product, paths[case.database]) for case in cases]
    of_case = {
        f"{case.take.title}, {case.condition}": (case, other, quick)
        for case, other in zip(cases, baselines, strict=True)
    }
    solved = run.each("accuracy", _solve, of_case, lambda done: done.rows + done.disturbed)
    rows, disturbed = ([row for each in solved for row in getattr(each, name)] for name in ("rows", "disturbed"))
    intervals, confidence = _expectations(cases, solved)
    figures = {
        "rows": rows,
        "means": _means(rows),
        "ratios": _ratios(rows),
        "disturbed": disturbed,
        "disturbed_means": disturbed_means(disturbed, CONDITIONS),
        "disturbed_ratios": _disturbed_ratios(disturbed) if baseline else [],
        "intervals": intervals,
        "confidence": confidence,
        "priors": {case.take.title: Path(case.settings.best.prior_file).name for case in cases},
        "databases": {case.database.stem: describe(open_database(case.database)) for case in cases},
        "frames": frames,
    }
    x_label = "takes, from the least error to the most"
    plots = write_plot(run.out / "accuracy", list(_panels(rows)), x_label, "degrees per joint", True)
    plots += write_pictures(run.out / "accuracy-strips", list(_pictures(cases, solved)))
    return run.write("accuracy", figures, {"": rows, "disturbed": disturbed}, plots)


def cases_of(run: Run, frames: int) -> Iterator[Case]:
    """Yield the takes of all conditions, limited to their first frames."""
    whole, bandai, embedded = run.whole(CMU), run.whole(BANDAI), run.embedded()
    for take in (*ACCURACY_TAKES, *STUDIO_TAKES):
        truth, file, settings = run.read(take), run.file_of(take), run.settings_for(subject_of(take.trial))
        truth = sliced(truth, 0, min(frames, truth.frames))
        databases = {STUDIO: whole}
        if take.folder == CMU:
            databases = _databases(run, whole, take) | {OTHER_STUDIO: bandai, EMBEDDED: embedded}
        for condition, database in databases.items():
            yield Case(condition, take, truth, file.skeleton or file.path, database.path, settings)


def _databases(run: Run, whole: Database, take: Take) -> dict[str, Database]:
    """Return the CMU database for each condition; unseen clips are left out if the subject has no other clips."""
    kind, words = _KINDS[take.trial]
    unseen, clip_unseen = run.without_subject(whole, subject_of(take.trial)), run.without_tests(whole)
    kind_unseen = run.without_tests(
        whole, f"cmu-without-kind-{kind}", lambda clip: not re.search(words, clip.behaviour.lower())
    )
    databases = {UNSEEN_CLIP: clip_unseen, UNSEEN_SUBJECT: unseen, UNSEEN_KIND: kind_unseen}
    if clip_unseen.frames == unseen.frames:
        del databases[UNSEEN_CLIP]
    return databases


def _solve(case: Case, baseline: tuple[Baseline, Path] | None, quick: bool) -> _Solved:
    """Return a case solved by all methods, in another process."""
    database, truth = open_database(case.database), case.truth
    faults, seeds = (QUICK_DISTURBANCES, SEEDS[:1]) if quick else (DISTURBANCES, SEEDS)
    others = {name: partial(_solve_by, baseline, case, way == LIVE) for way, name in BASELINES.items() if baseline}
    several = solve_disturbed(truth, database, case.settings, faults, seeds, others)
    methods = _QUICK_METHODS if quick else METHODS
    motions = {method: solve_truth(truth, database, METHODS[method]).motion for method in methods}
    motions |= {way: solved.motion for way, solved in several.clean.items()}
    errors = {method: evaluate(motion, truth) for method, motion in motions.items()}
    rows = [
        case.of
        | {"method": method, "frames": truth.frames}
        | {unit: round(error[unit], 4) for unit in _MEASURES}
        | feet_errors(motions[method], truth)
        | {"of_nearest": round(error["deg_per_joint"] / errors["nearest"]["deg_per_joint"], 4)}
        for method, error in errors.items()
    ]
    disturbed = [case.of | row for row in several.rows]
    live = several.clean[LIVE].motion
    return _Solved(rows, disturbed, live, errors[LIVE]["deg_per_joint"], several.expected)


def _solve_by(baseline: tuple[Baseline, Path], case: Case, causal: bool, take: MarkerTake) -> Motion:
    """Return the other version's solution of a take, with the learned prior that ours is solved with."""
    product, database = baseline
    best = case.settings.best
    prior = Path(best.prior_file) if best.prior_share else None
    return product.solve(take, case.skeleton, MARKER_SET, database, prior, causal)


def _means(rows: Rows) -> list[dict[str, Any]]:
    found, means = groups(rows, "condition", "method"), []
    for condition in CONDITIONS:
        for method in (*METHODS, LIVE, OFFLINE):
            if of := found.get((condition, method)):
                means.append(
                    {"condition": condition, "method": method, "takes": len(of)}
                    | {unit: mean(of, unit) for unit in (*_MEASURES, SKATE, DEEPEST, "of_nearest")}
                    | {f"most_{DEEPEST}": max(row[DEEPEST] for row in of if not np.isnan(row[DEEPEST]))}
                )
    return means


def _ratios(rows: Rows) -> list[dict[str, Any]]:
    """Return all paired ratios: live and offline to the others, then offline to live."""
    pairs = [(way, other) for other in ("best", TUNED) for way in (LIVE, OFFLINE)]
    return [row for pair in (*pairs, (OFFLINE, LIVE)) for row in paired_ratios(rows, *pair, CONDITIONS)]


def _disturbed_ratios(rows: Rows) -> list[dict[str, Any]]:
    """Return the ratios to the other version, by disturbance."""
    return [
        {"disturbance": name} | ratio
        for (name,), of in groups([dict(row) | {"method": row["way"]} for row in rows], "disturbance").items()
        for way, other in BASELINES.items()
        for ratio in paired_ratios(of, way, other, CONDITIONS)
    ]


def _expectations(
    cases: Sequence[Case], solved: Sequence[_Solved]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return shares of errors within their 95 % intervals, and live errors at low and high confidence.

    They are listed by condition, then for all conditions; confidence is for all disturbances together.
    """
    found: dict[str, dict[tuple[str, str], list[Expected]]] = {condition: {} for condition in (*CONDITIONS, "all")}
    for condition in CONDITIONS:
        for case, each in zip(cases, solved, strict=True):
            for key, expected in each.expected.items() if case.condition == condition else ():
                found[condition].setdefault(key, []).extend(expected)
        for key, expected in found[condition].items():
            found["all"].setdefault(key, []).extend(expected)
    names = cases[0].truth.skeleton.names[1:]
    intervals = [
        {"condition": condition, "disturbance": disturbance, "way": way} | coverage(expected, names)
        for condition, of in found.items()
        for (disturbance, way), expected in of.items()
    ]
    live = {
        condition: [each for (_, way), expected in of.items() if way == LIVE for each in expected]
        for condition, of in found.items()
    }
    live["all"] = [each for condition in CONDITIONS for each in live[condition]]
    return intervals, [{"condition": name} | confidence_ratio(each) for name, each in live.items() if each]


def _panels(rows: Rows) -> Iterator[Panel]:
    """Yield a panel for each condition: the sorted errors of its takes, by method."""
    found = groups(rows, "condition", "method")
    for condition in CONDITIONS:
        lines = []
        for method in _PLOTTED:
            if of := found.get((condition, method)):
                errors = np.sort([row["deg_per_joint"] for row in of])
                lines.append(Line(method, 1 + np.arange(len(errors)), errors))
        if lines:
            yield Panel(condition, lines)


def _pictures(cases: Sequence[Case], solved: Sequence[_Solved]) -> Iterator[Picture]:
    """Yield frames of each condition's median and worst take, with the truth next to the solved pose."""
    for condition in CONDITIONS:
        pairs = [pair for pair in zip(cases, solved, strict=True) if pair[0].condition == condition]
        ordered = sorted(pairs, key=lambda pair: pair[1].error)
        chosen = {"median": ordered[(len(ordered) - 1) // 2], "worst": ordered[-1]} if ordered else {}
        for name, (case, each) in chosen.items():
            for share in _MOMENTS:
                frame = int(share * case.truth.frames)
                title = f"{condition}, {name}: {case.take.title}, frame {frame}"
                yield Picture.of(title, case.truth, each.live, frame)
