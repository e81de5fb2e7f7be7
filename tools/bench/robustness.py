"""Labels and poses after cuts, a T pose, noise, all with the subject unseen."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.scene_pose import DOUBTFUL
from perfanim.core.database.labels import subject_of
from perfanim.core.database.store import Database
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array, runs
from perfanim.core.system.progress import Progress

from .crossings import crossings, meetings, play_crossing
from .data import CMU, FPS, development_takes, whole_database, without_subject
from .figure6 import degrees_per_joint
from .films import film_summary, play_films
from .frames_in_doubt import doubt_summary, frame_times, mirrored_database
from .methods import WITHOUT_PRIOR
from .more_data import TAKES, more_data_row
from .plots import Line, Panel, check_plots, write_plot
from .random_cuts import (
    BEFORE,
    LONG,
    Cut,
    Disturbance,
    cut_figures,
    facing,
    markers_of,
    play_cut,
    random_cuts,
    seconds_until_right,
)
from .report import write_figures
from .solved_takes import part_errors, solve, solve_twice
from .walk_outs import walk_outs
from .worst_frames import WorstFrames, write_pictures


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
_SEED = 3
_T_POSE_S = 0.5  # before a take
_FIRST = 15  # frames after the T pose that are compared
_FAR_M = 0.03
_NOISE_MM, _DROPOUT = 3.0, 0.1
_JUMP_DEG = 10.0  # change of a joint between two frames beyond the truth's own
_WORSE, _WORSE_S = 1.2, 0.2  # share of nearest's error, and how long it may last
_GHOSTS = Disturbance(0.001 * _NOISE_MM, _DROPOUT, 1.0, 2)
_PICTURED = 3  # takes


class Curves(NamedTuple):
    """Errors (F,) of a part of a take, degrees per joint.

    Args:
        first: number of its first frame in the take.
    """

    first: int
    best: Array
    nearest: Array


def robustness(data: Path, out: Path, workers: int, progress: Progress, sizes: Sizes | None = None) -> dict[str, Any]:
    """Solve disturbed takes by unseen subjects and list the worst frames.

    On development takes: random cuts between takes without labels; cuts hidden for seconds, and performers out of the
    pictures and back; two who pass or meet; a T pose before takes; noise, dropout and ghosts; more subjects in the
    database; the time of frames in doubt; takes filmed by simulated cameras. Without sizes these are `QUICK`.

    Returns:
        rows (check, value, goal), cuts, absences, crossings, meetings, t_pose, noise, more_data, films (a row for each
        cut, pair, take or film), episodes (of the films, with most wrong markers), in_doubt (ms and share of an
        exhaustive search), worst (check, take, frame, joint, value), sizes, outputs.
    """
    check_plots()
    sizes = sizes or QUICK
    whole = whole_database(data, out, (CMU,), workers, progress)
    takes = development_takes(data, sizes.takes)
    subjects = sorted({subject_of(name) for name in takes})
    databases = {subject: without_subject(whole, out / "databases", subject) for subject in subjects}
    worst = WorstFrames([], [])
    generator = np.random.default_rng(_SEED)
    cuts = _cuts(random_cuts(takes, sizes.cuts, generator), databases, worst, generator, progress)
    generator = np.random.default_rng(_SEED)
    long_cuts = random_cuts(takes, sizes.absences, generator, LONG)
    absences = _cuts(long_cuts, databases, worst, generator, progress)
    walks = walk_outs(takes, sizes.absences, generator)
    absences += _cuts(walks, databases, worst, generator, progress)
    crossed, met = (
        [play_crossing(pair, databases[subject_of(pair.motion.name)], generator) for pair in pairs]
        for pairs in (crossings(takes, sizes.crossings, generator), meetings(takes, sizes.meetings, generator))
    )
    after_t_pose, noisy = [], []
    curves: dict[str, Curves] = {}
    for number, (name, take) in enumerate(takes.items()):
        progress(0.5 + 0.4 * number / len(takes), f"{name}: T pose before it, noise")
        database = databases[subject_of(name)]
        after_t_pose.append(_t_pose_row(name, sliced(take, 0, min(sizes.t_pose_frames, take.frames)), database, worst))
        start = max((take.frames - sizes.noisy_frames) // 2, 0)
        middle = sliced(take, start, min(start + sizes.noisy_frames, take.frames))
        for seed in range(sizes.passes):
            row, curves[f"{name}, noise {seed}"] = _noisy_row(name, middle, start, database, seed, worst)
            noisy.append(row)
    progress(0.9, "more subjects in the database")
    grown = [
        more_data_row(name, takes[name], whole, out / "databases") for name in list(takes)[:: -(-len(takes) // TAKES)]
    ]
    progress(0.93, "time of frames in doubt")
    timed = frame_times(takes, mirrored_database(data, out, workers), sizes.timed_cuts) if sizes.timed_cuts else []
    films = list(play_films(data, whole, out / "databases", sizes.films, lambda f, text: progress(0.95, text)))
    filmed, episodes = [row for row, _ in films], [episode for _, listed in films for episode in listed]
    listed = worst.listed()
    rows = _summary(cuts, after_t_pose, noisy) + _absence_summary(absences) + _crossing_summary("crossings", crossed)
    rows += _crossing_summary("meetings", met) + _more_data_summary(grown) + doubt_summary(timed) + film_summary(filmed)
    parts = {"cuts": cuts, "noise": noisy, "worst": listed, "t-pose": after_t_pose, "more-data": grown}
    parts |= {"absences": absences, "crossings": crossed, "meetings": met}
    parts |= {"films": filmed, "film-episodes": episodes, "in-doubt": timed}
    figures = {"rows": rows} | {name.replace("-", "_"): part for name, part in parts.items() if name != "in-doubt"}
    tables = {"": rows} | {name: part for name, part in parts.items() if part}
    plots = _pictures(out, cuts, curves) + write_pictures(out / "robustness-worst-frames", worst.drawn())
    return write_figures(out, "robustness", figures | {"sizes": vars(sizes)}, tables, plots)


def _cuts(
    cuts: Iterable[Cut],
    databases: Mapping[str, Database],
    worst: WorstFrames,
    generator: np.random.Generator,
    progress: Progress,
) -> list[dict[str, Any]]:
    """Return a row for each cut; add its most confident wrong frame to the worst."""
    rows = []
    for number, cut in enumerate(cuts):
        progress(0.2, f"cut {number + 1}: {cut.title}")
        row, right, confidence = play_cut(cut, databases[subject_of(cut.subject)], generator)
        rows.append({"number": number} | row)
        title = f"{cut.title} (cut {number}, hidden {row['hidden_s']} s)"
        worst.add("s until labels are right", title, cut.back, "", seconds_until_right([row])[0])
        if not right.all():
            sure = np.where(right, -1.0, confidence)
            frame = int(np.argmax(sure))
            worst.add("confidence with wrong labels", title, cut.back + frame, "", sure[frame])
    return rows


def _t_pose_row(name: str, truth: Motion, database: Database, worst: WorstFrames) -> dict[str, Any]:
    """Return how much a T pose before a take costs the frames after it."""
    cold = degrees_per_joint(solve(truth, database, WITHOUT_PRIOR)[0], truth)[:_FIRST].mean()
    both = with_t_pose(truth)
    lead = both.frames - truth.frames
    solved = solve_twice(both, database)
    first = degrees_per_joint(solved.motion, both)[lead : lead + _FIRST]
    far = np.where(solved.rms_m > solved.nearest_rms_m, solved.rms_m, 0.0)[lead:]
    frame = int(np.argmax(first))
    worst.add("degrees per joint after a T pose", name, frame, "", first[frame])
    worst.add_picture(f"{name} after a T pose, frame {frame}", first[frame], both, solved.motion, lead + frame)
    worst.add("mm RMS after a T pose, nearest nearer", name, int(np.argmax(far)), "", 1e3 * far.max())
    return {
        "take": name,
        "frames": truth.frames,
        "deg_per_joint_without": round(float(cold), 4),
        "deg_per_joint_after": round(float(first.mean()), 4),
        "ratio": round(float(first.mean() / cold), 4),
        "frames_over_30_mm": int((far > _FAR_M).sum()),
    }


def _noisy_row(
    name: str, truth: Motion, start: int, database: Database, seed: int, worst: WorstFrames
) -> tuple[dict[str, Any], Curves]:
    """Return figures of a part of a take with noise, and both errors by frame.

    Args:
        start: number of its first frame in the take.
    """
    solved = solve_twice(truth, database, _NOISE_MM, _DROPOUT, seed)
    error, nearest = (degrees_per_joint(motion, truth) for motion in (solved.motion, solved.nearest))
    further = np.nan_to_num(solved.rms_m - solved.nearest_rms_m)
    known = np.isfinite(solved.expected_deg)
    within = (part_errors(solved, truth) <= 2.0 * solved.expected_deg)[known]
    jumps = _changes_deg(solved.motion) - _changes_deg(truth)
    over = error / np.maximum(nearest, 1e-6)
    late = round(_WORSE_S * FPS)
    too_long = sum(max(stop - begin - late, 0) for begin, stop in runs(over > _WORSE))
    frame, joint = np.unravel_index(int(np.argmax(jumps)), jumps.shape)
    for check, at, where, value in (
        ("joint change beyond the truth's, deg", frame + 1, truth.skeleton.names[joint + 1], jumps[frame, joint]),
        ("markers further off than nearest's, mm", np.argmax(further), "", 1e3 * further.max()),
        ("error as a share of nearest's", np.argmax(over), "", over.max()),
        ("degrees per joint with noise", np.argmax(error), "", error.max()),
    ):
        worst.add(check, f"{name} (noise {seed})", start + int(at), where, value)
    most = int(np.argmax(error))
    worst.add_picture(f"{name} with noise, frame {start + most}", error[most], truth, solved.motion, most)
    whole = Cut(name, name, name, -BEFORE, truth.skeleton, markers_of(truth))  # one take, from its first frame on
    ghostly, _, _ = play_cut(whole, database, np.random.default_rng(seed), _GHOSTS)
    row = {
        "take": name,
        "seed": seed,
        "first_frame": start,
        "frames": truth.frames,
        "deg_per_joint": round(float(error.mean()), 4),
        "nearest_deg_per_joint": round(float(nearest.mean()), 4),
        "worse_explained_frames": int((further > 0.0).sum()),
        "jump_frames": int((jumps > _JUMP_DEG).any(axis=1).sum()),
        "long_worse_frames": too_long,
        "ghost_shown_markers": ghostly["shown_markers"],
        "ghost_right_markers": ghostly["right_markers"],
        "ghost_wrong_frames": ghostly["wrong_frames"],
        "ghost_doubted_wrong_frames": ghostly["doubted_wrong_frames"],
        "part_errors_within_twice_expected": round(float(within.mean()), 4),
    }
    return row, Curves(start, error, nearest)


def with_t_pose(motion: Motion) -> Motion:
    """Return the motion with a T pose held before it.

    The pose stands where the motion begins and faces the same way; a cut is between them.
    """
    pose = t_pose(motion.skeleton)[None]
    still = replace(motion, rotations=pose, root_positions_m=motion.root_positions_m[:1])
    forward = rot.rotate(motion.rotations[0, 0], np.array([0.0, 0.0, 1.0]))
    below = motion.root_positions_m[0] * np.array([1.0, 0.0, 1.0])
    still = facing(still, float(np.arctan2(forward[0], forward[2])), below)
    frames = round(_T_POSE_S * motion.fps)
    return replace(
        motion,
        rotations=np.concatenate((np.repeat(still.rotations, frames, axis=0), motion.rotations)),
        root_positions_m=np.concatenate((np.repeat(still.root_positions_m, frames, axis=0), motion.root_positions_m)),
    )


def _changes_deg(motion: Motion) -> Array:
    """Return (F - 1, J - 1) turns of the joints but the root between two frames."""
    return np.asarray(np.degrees(rot.angle_between(motion.rotations[:-1, 1:], motion.rotations[1:, 1:])))


def _summary(
    cuts: list[dict[str, Any]], after_t_pose: list[dict[str, Any]], noisy: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Return a row (check, value, goal) for each thing that is asked."""
    found = cut_figures(cuts)
    frames = sum(row["frames"] for row in noisy)
    keys = ("deg_per_joint", "nearest_deg_per_joint", "part_errors_within_twice_expected")
    error, nearest, within = (sum(row[key] * row["frames"] for row in noisy) / frames for key in keys)
    rows = (
        ("cuts: labels right again, s, median", found["right_again_s_median"], "<= 0.25"),
        ("cuts: labels right again, s, 95 %", found["right_again_s_p95"], "<= 0.5"),
        ("cuts: labels right again, s, longest", found["right_again_s_max"], "<= 1"),
        ("cuts: never right", found["never_right"], "0"),
        ("cuts: share of frames with wrong labels", found["wrong_share"], ""),
        (f"cuts: share of these with confidence < {DOUBTFUL}", found["doubted_share_of_wrong"], ">= 0.95"),
        ("cuts: share of shown markers with right labels", found["live_right_share"], ""),
        ("recorded: share of shown markers with right labels", found["recorded_right_share"], ">= 0.98"),
        ("recorded: markers wrong in one cut, most", found["recorded_wrong_max"], ""),
        ("T pose: error after it of that without, worst take", max(row["ratio"] for row in after_t_pose), "<= 1.3"),
        ("T pose: takes over 1.3", sum(row["ratio"] > 1.3 for row in after_t_pose), "0"),
        ("T pose: frames over 30 mm RMS", sum(row["frames_over_30_mm"] for row in after_t_pose), "0"),
        ("noise: frames", frames, ""),
        ("noise: degrees per joint", round(error, 4), ""),
        ("noise: degrees per joint of nearest", round(nearest, 4), ""),
        ("noise: frames further off than nearest", sum(row["worse_explained_frames"] for row in noisy), "0"),
        (f"noise: frames with a jump over {_JUMP_DEG:g} deg", sum(row["jump_frames"] for row in noisy), "0"),
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
    return [{"check": check, "value": value, "goal": goal} for check, value, goal in rows]


def _share(rows: list[dict[str, Any]], part: str, whole: str) -> float:
    """Return the sum of one column as a share of another's, 1 of nothing."""
    parts, wholes = (sum(row[key] for row in rows) for key in (part, whole))
    return round(parts / wholes, 4) if wholes else 1.0


def _absence_summary(absences: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows as of `_summary` on performers back after seconds."""
    if not absences:
        return []
    found = cut_figures(absences)
    keys = {"right_again_s_median": "<= 0.25", "right_again_s_p95": "<= 0.5", "never_right": "0", "wrong_share": ""}
    return [
        {"check": f"{len(absences)} absences of seconds: {key}", "value": found[key], "goal": goal}
        for key, goal in keys.items()
    ]


def _crossing_summary(name: str, pairs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows as of `_summary` on two performers near each other."""
    wrong, exchanged = (
        max((row[key] for row in pairs), default=0.0) for key in ("longest_wrong_s", "longest_exchanged_s")
    )
    return [
        {"check": f"{len(pairs)} {name}: longest wrong labels, s", "value": wrong, "goal": "<= 0.5"},
        {"check": f"{len(pairs)} {name}: labels exchanged between the two, s", "value": exchanged, "goal": "<= 0.5"},
    ]


def _more_data_summary(grown: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows as of `_summary` on databases with more and fewer subjects."""
    ratios = [row["ratio"] for row in grown]
    rows = (
        ("more data: error with all subjects of that with half, worst take", max(ratios), "<= 1.02"),
        ("more data: the same, median", round(float(np.median(ratios)), 4), ""),
    )
    return [{"check": check, "value": value, "goal": goal} for check, value, goal in rows]


def _pictures(out: Path, cuts: list[dict[str, Any]], curves: Mapping[str, Curves]) -> list[Path]:
    """Write how fast labels come back, and the errors of the worst takes by frame."""
    times = seconds_until_right(cuts)
    share = np.arange(1, len(times) + 1) / len(times)
    panel = Panel(f"{len(times)} cuts", [Line("labels right again", times, share)], limit=0.95, top=1.0)
    worst = sorted(curves.items(), key=lambda item: -float(item[1].best.mean() / item[1].nearest.mean()))[:_PICTURED]
    panels = []
    for name, curve in worst:
        frames = curve.first + np.arange(len(curve.best))
        panels.append(Panel(name, [Line("best", frames, curve.best), Line("nearest", frames, curve.nearest)]))
    return [
        *write_plot(out / "robustness-cuts", [panel], "seconds after the cut", "share of cuts", markers=True),
        *write_plot(out / "robustness-worst", panels, "frame", "error (degrees per joint)"),
    ]
