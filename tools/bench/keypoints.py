"""Keypoints of unmeasured people, in files like those of markerless tools: jitter, tilt and accuracy of the motion."""

from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.api import fit_subject, load_take
from perfanim.core.body.motion import Motion
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.database.file_selection import subject_of
from perfanim.core.database.store import open_database
from perfanim.core.formats.markers.marker_files import write_take
from perfanim.core.geometry.arrays import Array
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.simulated_keypoints import simulate_keypoints
from perfanim.core.solver.settings import SolveSettings

from .plots import Picture, check_plots, write_pictures
from .run import Run
from .scenarios import CMU, KEYPOINT_TAKES, OFFLINE
from .solving import solve_both_ways

_MEASURES = ("mpjpe_mm", "bone_direction_deg", "foot_skate_cm_s", "foot_skate_truth_cm_s")
_MOMENTS = (0.1, 0.35, 0.6, 0.85)  # positions in a take that are pictured, as shares


def keypoints(run: Run) -> tuple[list[dict[str, Any]], list[Path]]:
    """Solve simulated keypoints of people who are not in the database or the prior; the body is fitted to them.

    Returns:
        Rows (take, set, mode, frames, jitter of the solved points as a share of the given ones', tilt_deg of the trunk
        against the truth's, height of the lower foot above the truth's, errors), and pictures.
    """
    check_plots()
    whole, people = run.whole(CMU), {subject_of(take.trial) for take, _ in KEYPOINT_TAKES}
    kept = [(clip, 0, clip.stop - clip.start) for clip in whole.clips if clip.subject not in people]
    path = run.subset(whole, "cmu-without-keypoints", kept).path
    jobs = {
        take.title: (take.title, name, run.read(take), path, run.settings_for(subject_of(take.trial)), run.out)
        for take, name in KEYPOINT_TAKES
    }
    solved = run.each("keypoints", _solve, jobs, lambda done: done[0])
    pictures = [picture for _, each in solved for picture in each]
    return [row for rows, _ in solved for row in rows], write_pictures(run.out / "keypoint-strips", pictures)


def _solve(
    title: str, name: str, truth: Motion, database: Path, settings: SolveSettings, folder: Path
) -> tuple[list[dict[str, Any]], list[Picture]]:
    """Return the rows of a take and its pictures, in another process."""
    opened, file = open_database(database), folder / "keypoints" / f"{truth.name}.trc"
    file.parent.mkdir(parents=True, exist_ok=True)
    write_take(simulate_keypoints(truth, load_marker_set(name)), file)
    take = load_take(file)
    subject = fit_subject(take, opened)
    ways, rows = solve_both_ways(take, subject, opened, settings), []
    for way, (motion, poses) in ways.items():
        measures = evaluate(motion, truth)
        shown_m = subject.marker_set.positions_on(subject.skeleton, motion.rotations, motion.root_positions_m)
        jitter = _jitter_m(shown_m) / _jitter_m(np.array([pose.observed_m for pose in poses]))
        rows.append(
            {"take": title, "set": subject.marker_set.name, "way": way, "frames": truth.frames}
            | {"jitter_of_points": round(jitter, 4)}
            | {name: round(value, 2) for name, value in _stance(motion, truth).items()}
            | {measure: round(measures[measure], 3) for measure in _MEASURES}
        )
    frames = [int(share * truth.frames) for share in _MOMENTS]
    return rows, [Picture.of(f"{title}, {name}, frame {each}", truth, ways[OFFLINE].motion, each) for each in frames]


def _jitter_m(points_m: Array) -> float:
    """Return the mean length of the third differences of points (F, M, 3)."""
    return float(np.nanmean(np.linalg.norm(np.diff(points_m, 3, axis=0), axis=-1)))


def _stance(motion: Motion, truth: Motion) -> dict[str, float]:
    """Return the medians of the trunk's tilt against the truth, and of the lower foot's height above the true one."""
    both_m = [forward_kinematics(each.skeleton, each.rotations, each.root_positions_m)[0] for each in (motion, truth)]
    names = truth.skeleton.names
    trunks = [joints_m[:, names.index("thorax")] - joints_m[:, 0] for joints_m in both_m]
    mine, true = (trunk / np.linalg.norm(trunk, axis=-1, keepdims=True) for trunk in trunks)
    tilt = np.degrees(np.arccos(np.clip(np.sum(mine * true, axis=-1), -1.0, 1.0)))
    feet = [names.index(name) for name in ("lfoot", "rfoot", "ltoes", "rtoes")]
    lowest_m, true_m = (joints_m[:, feet, 1].min(axis=1) for joints_m in both_m)
    return {"tilt_deg": float(np.median(tilt)), "feet_above_mm": 1e3 * float(np.median(lowest_m - true_m))}
