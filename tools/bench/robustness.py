"""Labels and poses after cuts, after a T pose, and with noise, all for unseen subjects."""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.database.file_selection import subject_of
from perfanim.core.database.store import open_database
from perfanim.core.geometry.arrays import Array, Mask
from perfanim.core.solver.settings import SolveSettings

from . import scenes
from .films import play_films
from .noisy_takes import Curves, Worst, take_figures
from .plots import Line, Panel, check_plots, write_pictures, write_plot
from .run import Run
from .scenarios import CMU, PARTS
from .scenes import Cut, Pair

Row = dict[str, Any]
# the database's file and the settings for a take's name; neither has seen its performer
SolvedBy = Callable[[str], tuple[Path, SolveSettings]]


@dataclass(frozen=True)
class Sizes:
    """Number of trials."""

    takes: int  # largest number of development takes
    cuts: int  # random cuts between them
    t_pose_frames: int  # largest number of frames of each take after a T pose
    noisy_frames: int  # largest number of frames from the middle of each take with noise
    passes: int = 1  # number of times that these are solved, each with different noise
    crossings: int = 12  # pairs of performers who pass each other
    meetings: int = 12  # pairs of performers who touch or embrace
    absences: int = 12  # cuts hidden for seconds; as many performers walk out of the images and back in
    films: int = 8  # takes filmed by simulated cameras


QUICK = Sizes(takes=32, cuts=60, t_pose_frames=60, noisy_frames=100)  # about 25 minutes on one core
FULL = Sizes(
    1000, cuts=500, t_pose_frames=60, noisy_frames=600, passes=2, crossings=60, meetings=60, absences=60
)  # 182 takes, 104,528 noisy frames
_PICTURED = 3  # takes with the largest errors that are pictured


def robustness(
    run: Run, full: bool = False, only: Collection[str] = PARTS, seed: int = 3, sizes: Sizes | None = None
) -> dict[str, Any]:
    """Solve disturbed takes of unseen subjects and list the worst frames.

    Uses development takes and the default settings, with a prior next to the databases that has not seen the performer,
    if there is one (`make bench-priors`). A part's figures do not depend on which other parts are run.

    Args:
        full: Try 500 cuts and 100,000 frames, which takes hours.
        only: Some of `PARTS`.
        seed: Seed for everything random.
        sizes: Number of trials, instead of `full`.

    Returns:
        rows (check, value, goal), a row for each cut, absence, pair, take or film (cuts, absences, crossings,
        meetings, t_pose, noise, films), worst (check, take, frame,
        joint, value), sizes, outputs; only for the parts that were run.
    """
    check_plots()
    sizes, worst, parts = sizes or (FULL if full else QUICK), Worst(), tuple(dict.fromkeys(only))
    whole, takes = run.whole(CMU), run.development_takes(sizes.takes)
    found = {  # built here, because several processes read them
        subject: (run.without_subject(whole, subject).path, run.settings_for(subject))
        for subject in sorted(set(map(subject_of, takes)))
    }

    def solved_by(take: str) -> tuple[Path, SolveSettings]:
        return found[subject_of(take)]

    tables: dict[str, list[Row]] = {}
    plots: list[Path] = []
    if "cuts" in parts:
        chance = np.random.default_rng(seed)
        tables["cuts"] = _cuts(run, "cuts", scenes.random_cuts(takes, sizes.cuts, chance), solved_by, worst, chance)
        plots += _cut_plot(run.out, tables["cuts"])
    if "absences" in parts:
        chance = np.random.default_rng(seed)
        drawn = [
            *scenes.random_cuts(takes, sizes.absences, chance, scenes.LONG),
            *scenes.walk_outs(takes, sizes.absences, chance),
        ]
        tables["absences"] = _cuts(run, "absences", drawn, solved_by, worst, chance)
    if "pairs" in parts:
        chance = np.random.default_rng(seed)
        for name, pairs in (
            ("crossings", scenes.crossings(takes, sizes.crossings, chance)),
            ("meetings", scenes.meetings(takes, sizes.meetings, chance)),
        ):
            jobs = {
                f"{number}, {pair.title}": (pair, *solved_by(pair.motion.name), chance.spawn(1)[0])
                for number, pair in enumerate(pairs)
            }
            tables[name] = run.each(f"robustness-{name}", _played_pair, jobs, lambda row: [row])
    if "takes" in parts:
        frames = (sizes.t_pose_frames, sizes.noisy_frames)
        of_takes = {name: (name, take, *solved_by(name), frames, sizes.passes) for name, take in takes.items()}
        solved = run.each("robustness-takes", take_figures, of_takes, lambda found: [found[0], *found[1]])
        for _, _, _, frames_of in solved:
            worst.extend(frames_of)
        tables |= {"t-pose": [each[0] for each in solved], "noise": [row for each in solved for row in each[1]]}
        plots += _take_plot(run.out, {title: curve for each in solved for title, curve in each[2].items()})
    if "films" in parts:
        tables["films"] = list(play_films(run, whole, sizes.films))
    rows = summary(tables)
    plots += write_pictures(run.out / "robustness-worst-frames", worst.drawn())
    tables["worst"] = worst.listed()
    bench = "robustness" if set(parts) == set(PARTS) else "-".join(["robustness", *parts])
    figures = {"rows": rows} | {key.replace("-", "_"): table for key, table in tables.items()}
    return run.write(bench, figures | {"sizes": vars(sizes), "seed": seed}, {"": rows, **tables}, plots)


# ---- cuts and pairs


def _cuts(
    run: Run, name: str, cuts: Iterable[Cut], solved_by: SolvedBy, worst: Worst, chance: np.random.Generator
) -> list[Row]:
    """Return a row for each cut; add its most confident wrong frame to the worst.

    Each cut has its own random generator, so its noise does not depend on what was played before.
    """
    jobs = {
        f"{number}, {cut.title}": (number, cut, *solved_by(cut.subject), chance.spawn(1)[0])
        for number, cut in enumerate(cuts)
    }
    played = run.each(f"robustness-{name}", _played_cut, jobs, lambda found: [found[0]])
    for (_, cut, *_), (row, right, confidence) in zip(jobs.values(), played, strict=True):
        title = f"{cut.title} (cut {row['number']}, hidden {row['hidden_s']} s)"
        worst.add("s until labels are right", title, cut.back, row["right_again_s"])
        if not right.all():
            wrong = np.where(right, -1.0, confidence)
            frame = int(np.argmax(wrong))
            worst.add("confidence with wrong labels", title, cut.back + frame, wrong[frame])
    return [row for row, _, _ in played]


def _played_cut(
    number: int, cut: Cut, database: Path, settings: SolveSettings, generator: np.random.Generator
) -> tuple[Row, Mask, Array]:
    row, right, confidence = scenes.play_cut(cut, open_database(database), settings, generator)
    return {"number": number} | row, right, confidence


def _played_pair(pair: Pair, database: Path, settings: SolveSettings, generator: np.random.Generator) -> Row:
    return scenes.play_pair(pair, open_database(database), settings, generator)


# ---- summaries

# table, column (or ratio of two columns' sums), how its values are reduced, goal
CHECKS = (
    ("cuts", "right_again_s", "median", "<= 0.25"),
    ("cuts", "right_again_s", "p95", "<= 0.5"),
    ("cuts", "right_again_s", "max", "<= 1"),
    ("cuts", "never_right", "sum", "0"),
    ("cuts", "wrong_frames / frames", "", ""),
    ("cuts", "doubted_wrong_frames / wrong_frames", "", ">= 0.95"),
    ("cuts", "right_markers / shown_markers", "", ""),
    ("cuts", "recorded_right_markers / shown_markers", "", ">= 0.98"),
    ("cuts", "recorded_wrong_markers", "max", ""),
    ("absences", "right_again_s", "median", "<= 0.25"),
    ("absences", "right_again_s", "p95", "<= 0.5"),
    ("absences", "never_right", "sum", "0"),
    ("absences", "wrong_frames / frames", "", ""),
    ("crossings", "longest_wrong_s", "max", "<= 0.5"),
    ("crossings", "longest_exchanged_s", "max", "<= 0.5"),
    ("meetings", "longest_wrong_s", "max", "<= 0.5"),
    ("meetings", "longest_exchanged_s", "max", "<= 0.5"),
    ("t-pose", "ratio", "max", "<= 1.3"),
    ("t-pose", "frames_over_30_mm", "sum", "0"),
    ("noise", "frames", "sum", ""),
    ("noise", "deg_per_joint", "mean", ""),
    ("noise", "nearest_deg_per_joint", "mean", ""),
    ("noise", "worse_explained_frames", "sum", "0"),
    ("noise", "jump_frames", "sum", "0"),
    ("noise", "first_jumps", "sum", ""),
    ("noise", "part_errors_within_twice_expected", "mean", "0.93 to 0.97"),
    ("noise", "long_worse_frames", "sum", "0"),
    ("noise", "ghost_right_markers / ghost_shown_markers", "", ""),
    ("noise", "ghost_wrong_frames / frames", "", ""),
    ("noise", "ghost_doubted_wrong_frames / ghost_wrong_frames", "", ""),
    ("films", "right_share", "min", ">= 0.995"),
    ("films", "recorded_right_share", "min", ">= 0.995"),
    ("films", "wrong_marker_frames", "sum", "0"),
    ("films", "offline_other_frames", "sum", "0"),
    ("films", "known_cost_deg", "max", "<= 0.2"),
    ("films", "unseen_cost_share", "max", "<= 0.05"),
)
_REDUCED: dict[str, Callable[[Array, Array], Any]] = {
    "median": lambda values, frames: np.median(values),
    "p95": lambda values, frames: np.quantile(values, 0.95),
    "min": lambda values, frames: values.min(),
    "max": lambda values, frames: values.max(),
    "sum": lambda values, frames: values.sum(),
    "mean": lambda values, frames: np.average(values, weights=frames),
}


def summary(tables: Mapping[str, list[Row]]) -> list[Row]:
    """Return a row (check, value, goal) for each requirement on the tables; means are weighted by frames."""
    result = []
    for table, columns, reduced, goal in CHECKS:
        part, _, whole = columns.partition(" / ")
        rows = [row for row in tables.get(table, ()) if row.get(part) is not None]
        if rows and whole:
            of = sum(row[whole] for row in rows)
            value = sum(row[part] for row in rows) / of if of else 1.0
        elif rows:
            values, frames = (np.array([row.get(key, 1) for row in rows]) for key in (part, "frames"))
            value = _REDUCED[reduced](values, frames)
        else:
            continue
        check = f"{len(rows)} {table}: {columns}" + (f", {reduced}" if reduced else "")
        result.append({"check": check, "value": round(float(value), 4), "goal": goal})
    return result


def _cut_plot(out: Path, cuts: list[Row]) -> list[Path]:
    """Plot how fast labels come back after cuts."""
    times = np.sort([row["right_again_s"] for row in cuts])
    share = np.arange(1, len(times) + 1) / len(times)
    panel = Panel(f"{len(times)} cuts", [Line("labels right again", times, share)], limit=0.95, top=1.0)
    return write_plot(out / "robustness-cuts", [panel], "seconds after the cut", "share of cuts", markers=True)


def _take_plot(out: Path, curves: Mapping[str, Curves]) -> list[Path]:
    """Plot the errors of the worst takes by frame."""
    worst = sorted(curves.items(), key=lambda item: -float(item[1].best.mean() / item[1].nearest.mean()))[:_PICTURED]
    panels = []
    for name, curve in worst:
        frames = curve.first + np.arange(len(curve.best))
        panels.append(Panel(name, [Line("best", frames, curve.best), Line("nearest", frames, curve.nearest)]))
    return write_plot(out / "robustness-worst", panels, "frame", "error (degrees per joint)")
