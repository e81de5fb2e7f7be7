"""Labels and poses after cuts, a T pose, noise, all with the subject unseen."""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.motion import Motion
from perfanim.core.body.scene_pose import DOUBTFUL
from perfanim.core.database.file_selection import subject_of
from perfanim.core.database.store import Database, open_database
from perfanim.core.geometry.arrays import Array, Mask
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.progress import Progress

from .crossings import Crossing, crossings, meetings, play_crossing
from .data import CMU, development_takes, whole_database, without_subject
from .films import film_summary, play_films
from .frames_in_doubt import doubt_summary, frame_times, mirrored_database
from .methods import default_settings
from .more_data import TAKES, more_data_row
from .noisy_takes import JUMP_DEG, Curves, take_figures
from .plots import Line, Panel, check_plots, write_plot
from .processes import Processes
from .random_cuts import LONG, Cut, cut_figures, play_cut, random_cuts, seconds_until_right
from .report import write_figures
from .walk_outs import walk_outs
from .worst_frames import WorstFrames, write_pictures

# the database's file and the settings for the name of a take, neither of which has seen its person
SolvedBy = Callable[[str], tuple[Path, SolveSettings]]


@dataclass(frozen=True)
class Sizes:
    """How much is tried.

    Args:
        takes: development takes, at most.
        cuts: random cuts between them.
        crossings: pairs of performers who pass each other.
        meetings: pairs of performers who touch or embrace.
        absences: cuts hidden for seconds; as many performers walk out of the pictures and back in.
        timed_cuts: cuts to time the frames of.
        films: takes filmed by simulated cameras.
        t_pose_frames: frames of each take after a T pose, at most.
        noisy_frames: frames from the middle of each take with noise, at most.
        passes: times that these are solved, each with other noise.
    """

    takes: int
    cuts: int
    t_pose_frames: int
    noisy_frames: int
    passes: int = 1
    crossings: int = 12
    meetings: int = 12
    absences: int = 12
    timed_cuts: int = 12
    films: int = 8


QUICK = Sizes(takes=32, cuts=60, t_pose_frames=60, noisy_frames=100)  # about 25 minutes on one core
FULL = Sizes(
    1000, cuts=500, t_pose_frames=60, noisy_frames=600, passes=2, crossings=60, meetings=60, absences=60, timed_cuts=60
)  # 182 takes, 104,528 noisy frames
SEED = 3
# Cuts between takes without labels; cuts hidden for seconds, and performers out of the pictures and back; two who pass
# or meet; a T pose before takes, and noise, dropout, ghosts; more subjects; the time of frames in doubt; filmed takes.
PARTS = ("cuts", "absences", "pairs", "takes", "more-data", "in-doubt", "films")
_PICTURED = 3  # takes


def robustness(
    data: Path,
    out: Path,
    workers: int,
    progress: Progress,
    sizes: Sizes | None = None,
    parts: Collection[str] = PARTS,
    seed: int = SEED,
) -> dict[str, Any]:
    """Solve disturbed takes by unseen subjects and list the worst frames.

    On development takes, by the default settings with a prior beside the databases that has not seen the person, if any
    (`make bench-priors`). Sizes are `QUICK` unless given. Parts have the same figures whether others are run or not.

    Args:
        parts: of `PARTS`.
        seed: of all that is drawn by chance.

    Returns:
        rows (check, value, goal), a row for each cut, absence, pair, take or film (cuts, absences, crossings,
        meetings, t_pose, noise, more_data, films), episodes (film_episodes, with most wrong markers), in_doubt (ms and
        share of an exhaustive search), worst (check, take, frame, joint, value), sizes, outputs; of the parts alone.
    """
    check_plots()
    sizes, worst = sizes or QUICK, WorstFrames([], [])
    whole = whole_database(data, out, (CMU,), workers, progress)
    takes = development_takes(data, sizes.takes)
    solved_by = _solved_without(takes, whole, out)
    tables: dict[str, list[dict[str, Any]]] = {}
    curves: dict[str, Curves] = {}
    with Processes(workers, out) as processes:
        for name, drawn in (("cuts", _drawn_cuts), ("absences", _absences)):
            if name in parts:
                chance = np.random.default_rng(seed)
                tables[name] = _cuts(name, drawn(takes, sizes, chance), solved_by, worst, chance, processes, progress)
        if "pairs" in parts:
            tables |= _pairs(takes, sizes, solved_by, np.random.default_rng(seed), processes, progress)
        if "takes" in parts:
            single, curves = _single_takes(takes, sizes, solved_by, worst, processes, progress)
            tables |= single
    if "more-data" in parts:
        progress(0.9, "more subjects in the database")
        few = list(takes)[:: -(-len(takes) // TAKES)]
        folder = out / "databases"
        tables["more-data"] = [more_data_row(name, takes[name], whole, solved_by(name)[1], folder) for name in few]
    if "in-doubt" in parts:
        progress(0.93, "time of frames in doubt")
        tables["in-doubt"] = frame_times(takes, mirrored_database(data, out, workers), sizes.timed_cuts)
    if "films" in parts:
        films = list(play_films(data, whole, out, sizes.films, lambda f, text: progress(0.95, text)))
        tables |= {"films": [row for row, _ in films], "film-episodes": [row for _, listed in films for row in listed]}
    rows = [row for key, summary in _SUMMARIES.items() if key in tables for row in summary(tables[key])]
    plots = _take_picture(out, curves) if curves else []
    plots += _cut_picture(out, tables["cuts"]) if "cuts" in parts else []
    plots += write_pictures(out / "robustness-worst-frames", worst.drawn())
    tables["worst"] = worst.listed()
    name = "robustness" if set(parts) == set(PARTS) else "-".join(["robustness", *parts])
    figures = {"rows": rows} | {key.replace("-", "_"): table for key, table in tables.items() if key != "in-doubt"}
    filled = {"": rows} | {key: table for key, table in tables.items() if table}
    return write_figures(out, name, figures | {"sizes": vars(sizes), "seed": seed}, filled, plots)


def _solved_without(takes: Collection[str], whole: Database, out: Path) -> SolvedBy:
    """Return the database and the settings by take, without its person.

    Databases are built here, as several processes read them.
    """
    found = {
        subject: (without_subject(whole, out / "databases", subject).path, default_settings(out, subject))
        for subject in sorted(set(map(subject_of, takes)))
    }
    return lambda take: found[subject_of(take)]


def _drawn_cuts(takes: Mapping[str, Motion], sizes: Sizes, generator: np.random.Generator) -> Iterable[Cut]:
    return random_cuts(takes, sizes.cuts, generator)


def _absences(takes: Mapping[str, Motion], sizes: Sizes, generator: np.random.Generator) -> Iterable[Cut]:
    """Yield cuts hidden for seconds, then performers out of the pictures and in."""
    yield from random_cuts(takes, sizes.absences, generator, LONG)
    yield from walk_outs(takes, sizes.absences, generator)


def _cuts(
    name: str,
    cuts: Iterable[Cut],
    solved_by: SolvedBy,
    worst: WorstFrames,
    generator: np.random.Generator,
    processes: Processes,
    progress: Progress,
) -> list[dict[str, Any]]:
    """Return a row for each cut; add its most confident wrong frame to the worst.

    Each has a generator of its own: its noise is the same whatever was played before.
    """
    jobs = {
        f"{number}, {cut.title}": (number, cut, *solved_by(cut.subject), generator.spawn(1)[0])
        for number, cut in enumerate(cuts)
    }
    played = processes.run(f"robustness-{name}", _played_cut, jobs, lambda found: [found[0]], _within(progress, 0.1))
    for (_, cut, *_), (row, right, confidence) in zip(jobs.values(), played, strict=True):
        title = f"{cut.title} (cut {row['number']}, hidden {row['hidden_s']} s)"
        worst.add("s until labels are right", title, cut.back, "", seconds_until_right([row])[0])
        if not right.all():
            sure = np.where(right, -1.0, confidence)
            frame = int(np.argmax(sure))
            worst.add("confidence with wrong labels", title, cut.back + frame, "", sure[frame])
    return [row for row, _, _ in played]


def _played_cut(
    number: int, cut: Cut, database: Path, settings: SolveSettings, generator: np.random.Generator
) -> tuple[dict[str, Any], Mask, Array]:
    row, right, confidence = play_cut(cut, open_database(database), settings, generator)
    return {"number": number} | row, right, confidence


def _pairs(
    takes: Mapping[str, Motion],
    sizes: Sizes,
    solved_by: SolvedBy,
    generator: np.random.Generator,
    processes: Processes,
    progress: Progress,
) -> dict[str, list[dict[str, Any]]]:
    """Return the rows of crossings and of meetings, a row a pair."""
    tables: dict[str, list[dict[str, Any]]] = {}
    for name, pairs in (
        ("crossings", crossings(takes, sizes.crossings, generator)),
        ("meetings", meetings(takes, sizes.meetings, generator)),
    ):
        jobs = {
            f"{number}, {pair.title}": (pair, *solved_by(pair.motion.name), generator.spawn(1)[0])
            for number, pair in enumerate(pairs)
        }
        played = processes.run(f"robustness-{name}", _played_pair, jobs, lambda row: [row], _within(progress, 0.4))
        tables[name] = played
    return tables


def _played_pair(
    pair: Crossing, database: Path, settings: SolveSettings, generator: np.random.Generator
) -> dict[str, Any]:
    return play_crossing(pair, open_database(database), settings, generator)


def _within(progress: Progress, start: float) -> Progress:
    """Return the progress of a part that begins at `start` of the whole."""
    return lambda share, text: progress(start + 0.3 * share, text)


def _single_takes(
    takes: Mapping[str, Motion],
    sizes: Sizes,
    solved_by: SolvedBy,
    worst: WorstFrames,
    processes: Processes,
    progress: Progress,
) -> tuple[dict[str, list[dict[str, Any]]], dict[str, Curves]]:
    """Return tables of takes after a T pose and with noise, and the latter's errors."""
    frames = (sizes.t_pose_frames, sizes.noisy_frames)
    jobs = {name: (name, take, *solved_by(name), frames, sizes.passes) for name, take in takes.items()}
    solved = processes.run(
        "robustness-takes", take_figures, jobs, lambda found: [found.t_pose, *found.noise], _within(progress, 0.6)
    )
    for figures in solved:
        worst.frames.extend(figures.worst.frames)
        worst.pictures.extend(figures.worst.pictures)
    tables = {"t-pose": [each.t_pose for each in solved], "noise": [row for each in solved for row in each.noise]}
    return tables, {title: curve for each in solved for title, curve in each.curves.items()}


def _cut_summary(cuts: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return a row (check, value, goal) for each thing that is asked of cuts."""
    found = cut_figures(cuts)
    return _rows(
        ("cuts: labels right again, s, median", found["right_again_s_median"], "<= 0.25"),
        ("cuts: labels right again, s, 95 %", found["right_again_s_p95"], "<= 0.5"),
        ("cuts: labels right again, s, longest", found["right_again_s_max"], "<= 1"),
        ("cuts: never right", found["never_right"], "0"),
        ("cuts: share of frames with wrong labels", found["wrong_share"], ""),
        (f"cuts: share of these with confidence < {DOUBTFUL}", found["doubted_share_of_wrong"], ">= 0.95"),
        ("cuts: share of shown markers with right labels", found["live_right_share"], ""),
        ("recorded: share of shown markers with right labels", found["recorded_right_share"], ">= 0.98"),
        ("recorded: markers wrong in one cut, most", found["recorded_wrong_max"], ""),
    )


def _t_pose_summary(after_t_pose: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows as of `_cut_summary` on takes after a T pose."""
    return _rows(
        ("T pose: error after it of that without, worst take", max(row["ratio"] for row in after_t_pose), "<= 1.3"),
        ("T pose: takes over 1.3", sum(row["ratio"] > 1.3 for row in after_t_pose), "0"),
        ("T pose: frames over 30 mm RMS", sum(row["frames_over_30_mm"] for row in after_t_pose), "0"),
    )


def _noise_summary(noisy: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows as of `_cut_summary` on takes with noise."""
    frames = sum(row["frames"] for row in noisy)
    keys = ("deg_per_joint", "nearest_deg_per_joint", "part_errors_within_twice_expected")
    error, nearest, within = (sum(row[key] * row["frames"] for row in noisy) / frames for key in keys)
    return _rows(
        ("noise: frames", frames, ""),
        ("noise: degrees per joint", round(error, 4), ""),
        ("noise: degrees per joint of nearest", round(nearest, 4), ""),
        ("noise: frames further off than nearest", sum(row["worse_explained_frames"] for row in noisy), "0"),
        (f"noise: frames with a jump over {JUMP_DEG:g} deg", sum(row["jump_frames"] for row in noisy), "0"),
        ("noise: these that are the first pose, after the T pose", sum(row["first_jumps"] for row in noisy), ""),
        ("noise: share of parts' errors within twice the expected", round(within, 4), "0.93 to 0.97"),
        ("noise: frames too long over 1.2 of nearest", sum(row["long_worse_frames"] for row in noisy), "0"),
        (
            "noise and ghosts, no labels: share of markers right",
            _share(noisy, "ghost_right_markers", "ghost_shown_markers"),
            "",
        ),
        ("noise and ghosts: share of frames with wrong labels", _share(noisy, "ghost_wrong_frames", "frames"), ""),
        (
            "noise and ghosts: share of these doubted",
            _share(noisy, "ghost_doubted_wrong_frames", "ghost_wrong_frames"),
            "",
        ),
    )


def _rows(*rows: tuple[str, Any, str]) -> list[dict[str, Any]]:
    return [{"check": check, "value": value, "goal": goal} for check, value, goal in rows]


def _share(rows: list[dict[str, Any]], part: str, whole: str) -> float:
    """Return the sum of one column as a share of another's, 1 of nothing."""
    parts, wholes = (sum(row[key] for row in rows) for key in (part, whole))
    return round(parts / wholes, 4) if wholes else 1.0


def _absence_summary(absences: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows as of `_cut_summary` on performers back after seconds."""
    if not absences:
        return []
    found = cut_figures(absences)
    keys = {"right_again_s_median": "<= 0.25", "right_again_s_p95": "<= 0.5", "never_right": "0", "wrong_share": ""}
    return [
        {"check": f"{len(absences)} absences of seconds: {key}", "value": found[key], "goal": goal}
        for key, goal in keys.items()
    ]


def _pair_summary(name: str, pairs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows as of `_cut_summary` on two performers near each other."""
    wrong, exchanged = (
        max((row[key] for row in pairs), default=0.0) for key in ("longest_wrong_s", "longest_exchanged_s")
    )
    return _rows(
        (f"{len(pairs)} {name}: longest wrong labels, s", wrong, "<= 0.5"),
        (f"{len(pairs)} {name}: labels exchanged between the two, s", exchanged, "<= 0.5"),
    )


def _more_data_summary(grown: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows as of `_cut_summary` on databases with more and fewer subjects."""
    ratios = [row["ratio"] for row in grown]
    return _rows(
        ("more data: error with all subjects of that with half, worst take", max(ratios), "<= 1.02"),
        ("more data: the same, median", round(float(np.median(ratios)), 4), ""),
    )


_SUMMARIES: dict[str, Callable[[list[dict[str, Any]]], list[dict[str, Any]]]] = {
    "cuts": _cut_summary,
    "t-pose": _t_pose_summary,
    "noise": _noise_summary,
    "absences": _absence_summary,
    "crossings": partial(_pair_summary, "crossings"),
    "meetings": partial(_pair_summary, "meetings"),
    "more-data": _more_data_summary,
    "in-doubt": doubt_summary,
    "films": film_summary,
}


def _cut_picture(out: Path, cuts: list[dict[str, Any]]) -> list[Path]:
    """Write how fast labels come back after cuts."""
    times = seconds_until_right(cuts)
    share = np.arange(1, len(times) + 1) / len(times)
    panel = Panel(f"{len(times)} cuts", [Line("labels right again", times, share)], limit=0.95, top=1.0)
    return write_plot(out / "robustness-cuts", [panel], "seconds after the cut", "share of cuts", markers=True)


def _take_picture(out: Path, curves: Mapping[str, Curves]) -> list[Path]:
    """Write the errors of the worst takes by frame."""
    worst = sorted(curves.items(), key=lambda item: -float(item[1].best.mean() / item[1].nearest.mean()))[:_PICTURED]
    panels = []
    for name, curve in worst:
        frames = curve.first + np.arange(len(curve.best))
        panels.append(Panel(name, [Line("best", frames, curve.best), Line("nearest", frames, curve.nearest)]))
    return write_plot(out / "robustness-worst", panels, "frame", "error (degrees per joint)")
