"""Suits with labels drawn at random, compared with the same suits under their own names."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.api.solving import SolveRequest, solve_unmeasured
from perfanim.core.api.take_reading import fit_take, labelled_by, read_labelled
from perfanim.core.body.motion import Motion
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.store import open_database
from perfanim.core.errors import PerfanimError
from perfanim.core.geometry.arrays import Array
from perfanim.core.markers.exchanged_throughout import places_standing
from perfanim.core.markers.label_matching import AUTO, LabelMatch, match_best_set
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.session.solved_take import SolvedTake
from perfanim.core.simulate.simulated_markers import simulate_markers

from .marker_takes import middle
from .run import Run
from .scenarios import UNKNOWN_SUITS, Take

_FRAMES = 480  # largest number of frames that are solved
_WORN_M = 0.015  # standard deviation of markers from their usual places in simulated suits
_NOISE_MM, _DROPOUT = 1.0, 0.02
_ARM = ("humerus", "radius", "wrist", "hand", "fingers", "thumb")
_COLUMNS = ("found", "right", "wrong", "unnamed", "more", "bones_mm", "wrists_mm", "ratio")
_SAME_M = 0.05  # largest distance between the usual places of the same marker in two sets


def unknown_labels(
    run: Run,
    suits: Path | None = None,
    seed: int = 0,
    frames: int = _FRAMES,
    only_takes: list[str] | None = None,
) -> dict[str, Any]:
    """Rename all labels of suits, exchange all among themselves, or rename those of the arms; solve, and compare.

    The solution by true names is the comparison.

    Args:
        suits: Folder that contains c3d/ and trc/; by default `data`.
        seed: Seed of the labels.
        frames: Largest number of frames to solve, from the middle of a take.
        only_takes: Strings, one of which a take's name must contain; by default all takes are solved.

    Returns:
        rows (take, use: "development" if settings were chosen on it; labels: "unknown", "exchanged" or "arms"; set;
        found set; of the markers that the set knows: right, wrong, unnamed; more: markers that it does not know and
        that got a name; bones_mm: largest difference of a bone's length; wrists_mm: median distance of the wrist that
        is farther off from its place by true names; ratio of the markers' distances; outcome: good, told or
        refused; sentence: warning about the labels, and verdict or refusal; by_names: verdict by true names), outputs.
    """
    jobs: dict[str, tuple[Any, ...]] = {}
    database = run.embedded().path.resolve()
    for title, (use, source) in UNKNOWN_SUITS.items():
        if not any(text in title for text in only_takes or [""]):
            continue
        given = (suits or run.data).resolve() / source if isinstance(source, str) else run.read(Take(title, source[0]))
        jobs[title] = (title, use, given, "" if isinstance(source, str) else source[1], database, seed, frames)
    rows = [row for each in run.each("unknown-labels", _rows, jobs, lambda rows: rows) for row in each]
    return run.write("unknown-labels", {"rows": rows}, {"": rows})


def _rows(
    title: str, use: str, source: Path | Motion, worn: str, database: Path, seed: int, frames: int
) -> list[dict[str, Any]]:
    """Return a row for each way of changing the labels of a take, in another process."""
    take = middle(read_labelled(source, None) if isinstance(source, Path) else _simulated(source, worn, seed), frames)
    match = match_best_set(take.names, title)
    true = match.rename(take)
    by_names = _solved(true, database)
    generator = np.random.default_rng(seed)
    rows = []
    arms = {marker.name for marker in match.marker_set.markers if marker.joint[1:] in _ARM} & set(true.names)
    for labels in ("unknown", "exchanged", "arms") if arms else ("unknown", "exchanged"):
        order = generator.permutation(len(true.names))
        names = true.names if labels == "exchanged" else tuple(f"Q{i:03d}" for i in range(len(order)))
        if labels == "arms":
            names = tuple(names[i] if true.names[at] in arms else true.names[at] for i, at in enumerate(order))
        drawn = replace(true, names=names, positions_m=true.positions_m[:, order])
        row = {"take": title, "use": use, "labels": labels, "set": match.marker_set.name}
        rows.append(row | _compared(by_names, _solved(drawn, database), match, [true.names[i] for i in order]))
    return rows


def _simulated(motion: Motion, worn: str, seed: int) -> MarkerTake:
    """Return a performer in a shipped marker set, each marker somewhat away from its usual place."""
    markers = load_marker_set(worn)
    away_m = np.random.default_rng(seed).normal(0.0, _WORN_M, (len(markers), 3))
    return simulate_markers(motion, markers.with_offsets(markers.offsets_m + away_m), _NOISE_MM, _DROPOUT, seed)[0]


def _solved(take: MarkerTake, database: Path) -> tuple[MarkerTake, SolvedTake] | str:
    """Return the named take and its solution, as the command without options makes it, or the refusal."""
    opened = open_database(database)
    try:
        named, worn = labelled_by(AUTO, take, opened)
        solved = solve_unmeasured(fit_take(named, worn, "auto"), AUTO, opened, SolveRequest(place_markers=True))
    except PerfanimError as error:
        return str(error)
    return named, solved


def _compared(
    by_names: tuple[MarkerTake, SolvedTake] | str,
    drawn: tuple[MarkerTake, SolvedTake] | str,
    match: LabelMatch,
    true: list[str],
) -> dict[str, Any]:
    """Return what was found under drawn labels.

    Args:
        true: The true name of each label of the drawn take.
    """
    row: dict[str, Any] = dict.fromkeys(_COLUMNS, "")
    row |= {"outcome": "refused", "sentence": drawn}
    row["by_names"] = by_names if isinstance(by_names, str) else by_names[1].verdict.text
    if isinstance(drawn, str):
        return row
    named, solved = drawn
    row |= {"found": solved.report["marker_set"], **_counts(match, solved.report["marker_set"], named.names, true)}
    row["outcome"] = "good" if solved.verdict.is_good else "told"
    row["sentence"] = "; ".join((*named.notes, solved.verdict.text))
    if isinstance(by_names, str):
        return row
    expected = by_names[1]
    bones_m = [np.linalg.norm(each.motion.skeleton.tips_m, axis=1) for each in (expected, solved)]
    wrists_m = [_wrists_m(each.motion) for each in (expected, solved)]
    row["wrists_mm"] = round(
        1e3 * float(np.median(np.linalg.norm(wrists_m[0] - wrists_m[1], axis=-1), axis=0).max()), 1
    )
    distances = [each.summary()["marker_rms_mm"] for each in (expected, solved)]
    row["bones_mm"] = round(1e3 * float(np.abs(bones_m[0] - bones_m[1]).max()), 1)
    return row | {"ratio": round(distances[1] / distances[0], 2)}


def _wrists_m(motion: Motion) -> Array:
    """Return the wrists (F, 2, 3): the joints of the hands, because the joints called wrist only twist the forearms."""
    wrists = [motion.skeleton.index(side + "hand") for side in "lr"]
    return forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0][:, wrists]


def _counts(match: LabelMatch, found: str, names: tuple[str, ...], true: list[str]) -> dict[str, int]:
    """Return how many markers of the true set are right, wrong and unnamed, and how many others got a name.

    A marker of another set counts as right if its usual position is that of the true one.
    """
    sets = [load_marker_set(match.marker_set.name), load_marker_set(found)]
    places = [dict(zip(s.names, places_standing(s.markers, default_skeleton()), strict=True)) for s in sets]
    counts = dict.fromkeys(("right", "wrong", "unnamed", "more"), 0)
    for name, own in zip(names, true, strict=True):
        if own not in places[0]:
            counts["more"] += name in places[1]
        elif name not in places[1]:
            counts["unnamed"] += 1
        elif sets[0].name == sets[1].name:
            counts["right" if name == own else "wrong"] += 1
        else:
            is_there = np.linalg.norm(places[0][own] - places[1][name]) < _SAME_M
            counts["right" if is_there else "wrong"] += 1
    return counts
