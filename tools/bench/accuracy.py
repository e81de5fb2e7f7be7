"""The default settings beside other methods, from known people to another studio.

Each take is solved live and offline from exact and from disturbed markers. The learned prior is one of those beside the
databases (motion_prior*.npz) that has not seen the performer.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.database.file_selection import subject_of
from perfanim.core.database.store import open_database
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.system.progress import Progress

from .accuracy_cases import CONDITIONS, Case, cases_of
from .baseline import Baseline
from .calibration import Expected, confidence_ratio, coverage
from .disturbed import CLEAN, DISTURBANCES, MEASURES, QUICK, SEEDS, disturbed_means, solve_disturbed
from .feet import feet_errors
from .figure6 import MARKER_SET, describe, solve_truth, true_subject
from .methods import BASELINE, METHODS, default_settings
from .paired import paired_ratios
from .plots import Line, Panel, check_plots, write_plot
from .processes import Processes
from .report import Rows, write_figures
from .solved_takes import LIVE, OFFLINE
from .worst_frames import Picture, write_pictures

TUNED = "local-pca (tuned)"
_NEAREST, _BEST = "nearest", "best"
_QUICK_METHODS = (_NEAREST, _BEST, TUNED)
_FRAMES, _QUICK_FRAMES = 240, 120  # of each take, so that all takes an hour, or ten minutes
_QUICK_SEEDS = SEEDS[:1]
_MOMENTS = (0.2, 0.4, 0.6, 0.8)  # shares of a take that are pictured
_DRAWN = (_NEAREST, LIVE, OFFLINE, BASELINE, TUNED)  # in the plot
_MEASURES = (*MEASURES, "foot_skate_truth_cm_s")
_FEET = ("skate_beyond_cm_s", "toes_below_mm")


@dataclass(frozen=True)
class _Solved:
    """A case solved by all methods.

    Args:
        joints: errors by joint, of methods and of disturbances by way.
        live: the motion solved live from exact markers.
        error: its, degrees per joint.
        expected: errors beside the expected ones, by disturbance and way.
    """

    rows: list[dict[str, Any]]
    joints: list[dict[str, Any]]
    disturbed: list[dict[str, Any]]
    live: Motion
    error: float
    expected: dict[tuple[str, str], list[Expected]]


def accuracy(
    data: Path, out: Path, workers: int, progress: Progress, checkout: Path | None = None, quick: bool = False
) -> dict[str, Any]:
    """Solve takes by every method in every condition.

    Unseen kinds keep the performer's other clips. `live` and `offline` are the default settings; the methods are all
    live, without the learned prior.

    Args:
        checkout: of another version; it solves the same takes with its own databases of the same motion.
        quick: whether fewer methods are compared, fewer frames are solved, and markers are disturbed in three
            ways with one seed.

    Returns:
        rows (condition, take, method, frames, errors, held feet, share of the nearest neighbour's error), means (the
        same over the takes), ratios (paired, of two methods), disturbed and disturbed_means (live and offline on
        noisy, missing, slow and fast markers), intervals (shares of errors within twice the expected), confidence
        (errors of its lowest and highest tenths), priors, databases, outputs.
    """
    check_plots()
    out.mkdir(parents=True, exist_ok=True)
    frames = _QUICK_FRAMES if quick else _FRAMES
    cases = list(cases_of(data, out, frames, workers, progress))
    with Processes(workers, out) as processes:
        baselines: list[tuple[Baseline, Path] | None] = [None] * len(cases)
        if checkout:
            baseline = Baseline(checkout, data, out / "baseline")
            by_file = {case.database: case for case in cases}
            jobs = {str(path): (case, baseline) for path, case in by_file.items()}
            built = processes.run("baseline-databases", Case.baseline_database, jobs, lambda path: [], progress)
            paths = dict(zip(by_file, built, strict=True))
            baselines = [(baseline, paths[case.database]) for case in cases]
        titles = [f"{case.take.title}, {case.condition}" for case in cases]
        of_case = {
            title: (case, out, baseline, quick) for title, case, baseline in zip(titles, cases, baselines, strict=True)
        }
        solved = processes.run("accuracy", _solve, of_case, lambda done: done.rows + done.disturbed, progress)
    rows, joints, disturbed = ([row for each in solved for row in getattr(each, name)] for name in _TABLES)
    figures = {
        "rows": rows,
        "means": _means(rows),
        "ratios": _ratios(rows),
        "disturbed": disturbed,
        "disturbed_means": disturbed_means(disturbed, CONDITIONS),
        "intervals": _intervals(cases, solved),
        "confidence": _confidence(cases, solved),
        "priors": {
            case.take.title: Path(default_settings(out, subject_of(case.take.trial)).best.prior_file).name
            for case in cases
        },
        "databases": {case.database.stem: describe(open_database(case.database)) for case in cases},
        "frames": frames,
    }
    tables = {"": rows, "joints": joints, "disturbed": disturbed}
    plots = write_plot(
        out / "accuracy", _panels(rows), "takes, from the least error to the most", "degrees per joint", True
    )
    plots += write_pictures(out / "accuracy-strips", _pictures(cases, solved))
    return write_figures(out, "accuracy", figures, tables, plots)


_TABLES = ("rows", "joints", "disturbed")


def _solve(case: Case, out: Path, baseline: tuple[Baseline, Path] | None, quick: bool) -> _Solved:
    """Return a case solved by all methods, in the other process."""
    database, truth = open_database(case.database), case.truth
    settings = default_settings(out, subject_of(case.take.trial))
    several = solve_disturbed(
        truth, database, settings, QUICK if quick else DISTURBANCES, _QUICK_SEEDS if quick else SEEDS
    )
    chosen = {name: METHODS[name] for name in _QUICK_METHODS} if quick else METHODS
    motions = {method: solve_truth(truth, database, each)[0] for method, each in chosen.items()}
    motions |= {way: solved.motion for way, solved in several.clean.items()}
    if baseline:
        take, _ = simulate_markers(truth, true_subject(truth))
        motions[BASELINE] = baseline[0].solve(take, case.skeleton, MARKER_SET, baseline[1])
    errors = {method: evaluate(motion, truth) for method, motion in motions.items()}
    rows = [
        case.of
        | {"method": method, "frames": truth.frames}
        | {unit: round(error[unit], 4) for unit in _MEASURES}
        | feet_errors(motions[method], truth)
        | {"of_nearest": round(error["deg_per_joint"] / errors[_NEAREST]["deg_per_joint"], 4)}
        for method, error in errors.items()
    ]
    joints = [
        case.of
        | {"method": method, "disturbance": CLEAN.name, "joint": joint}
        | {unit: round(value, 3) for unit, value in by_unit.items()}
        for method, error in errors.items()
        if method not in several.clean  # these come with the disturbances
        for joint, by_unit in error["per_joint"].items()
    ]
    joints += [
        case.of | {"method": row["way"]} | {k: v for k, v in row.items() if k != "way"} for row in several.joints
    ]
    disturbed = [case.of | row for row in several.rows]
    live = several.clean[LIVE].motion
    return _Solved(rows, joints, disturbed, live, errors[LIVE]["deg_per_joint"], dict(several.expected))


def _means(rows: Rows) -> list[dict[str, Any]]:
    means = []
    for condition in CONDITIONS:
        for method in (*METHODS, LIVE, OFFLINE, BASELINE):
            of = [row for row in rows if row["condition"] == condition and row["method"] == method]
            if of:
                means.append(
                    {"condition": condition, "method": method, "takes": len(of)}
                    | {unit: _mean([row[unit] for row in of]) for unit in (*_MEASURES, *_FEET, "of_nearest")}
                    | {f"most_{unit}": max(row[unit] for row in of if not np.isnan(row[unit])) for unit in _FEET[1:]}
                )
    return means


def _mean(values: Sequence[float]) -> float:
    """Return the mean without NaN: feet that never stand have no skate."""
    known = [value for value in values if np.isfinite(value)]
    return round(float(np.mean(known)), 4) if known else float("nan")


def _ratios(rows: Rows) -> list[dict[str, Any]]:
    """Return all paired ratios: live and offline to the others, then offline to live."""
    pairs = [(way, other) for other in (BASELINE, _BEST, TUNED) for way in (LIVE, OFFLINE)]
    return [row for pair in (*pairs, (OFFLINE, LIVE)) for row in paired_ratios(rows, *pair, CONDITIONS)]


def _grouped(cases: Sequence[Case], solved: Sequence[_Solved], condition: str) -> dict[tuple[str, str], list[Expected]]:
    """Return the errors of a condition beside the expected, by disturbance and way."""
    found: dict[tuple[str, str], list[Expected]] = {}
    for case, each in zip(cases, solved, strict=True):
        if case.condition == condition:
            for name, expected in each.expected.items():
                found.setdefault(name, []).extend(expected)
    return found


def _intervals(cases: Sequence[Case], solved: Sequence[_Solved]) -> list[dict[str, Any]]:
    """Return shares of errors within their 95 % intervals, at last of all conditions."""
    names = cases[0].truth.skeleton.names[1:]
    found, whole = [], dict[tuple[str, str], list[Expected]]()
    for condition in CONDITIONS:
        for (disturbance, way), expected in _grouped(cases, solved, condition).items():
            of = {"condition": condition, "disturbance": disturbance, "way": way}
            found.append(of | coverage(expected, names))
            whole.setdefault((disturbance, way), []).extend(expected)
    for (disturbance, way), expected in whole.items():
        found.append({"condition": "all", "disturbance": disturbance, "way": way} | coverage(expected, names))
    return found


def _confidence(cases: Sequence[Case], solved: Sequence[_Solved]) -> list[dict[str, Any]]:
    """Return live errors at low and high confidence, all disturbances together."""
    found, whole = [], list[Expected]()
    for condition in CONDITIONS:
        grouped = _grouped(cases, solved, condition)
        live = [each for (_, way), expected in grouped.items() if way == LIVE for each in expected]
        if live:
            found.append({"condition": condition} | confidence_ratio(live))
            whole += live
    return [*found, {"condition": "all"} | confidence_ratio(whole)]


def _panels(rows: Rows) -> list[Panel]:
    """Return a panel of each condition: the errors of its takes in order, by method."""
    panels = []
    for condition in CONDITIONS:
        lines = []
        for method in _DRAWN:
            of = [row for row in rows if (row["condition"], row["method"]) == (condition, method)]
            errors = np.sort([row["deg_per_joint"] for row in of])
            lines += [Line(method, 1 + np.arange(len(errors)), errors)] if of else []
        panels += [Panel(condition, lines)] if lines else []
    return panels


def _pictures(cases: Sequence[Case], solved: Sequence[_Solved]) -> list[Picture]:
    """Return moments of each condition's median and worst take, truth beside solved."""
    pictures = []
    for condition in CONDITIONS:
        pairs = [pair for pair in zip(cases, solved, strict=True) if pair[0].condition == condition]
        ordered = sorted(pairs, key=lambda pair: pair[1].error)
        for name, (case, each) in (
            (("median", ordered[(len(ordered) - 1) // 2]), ("worst", ordered[-1])) if ordered else ()
        ):
            for share in _MOMENTS:
                frame = int(share * case.truth.frames)
                title = f"{condition}, {name}: {case.take.title}, frame {frame}"
                both = (sliced(motion, frame, frame + 1) for motion in (case.truth, each.live))
                pictures.append(Picture(title, *both))
    return pictures
