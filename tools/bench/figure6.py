"""Figure 6 of the paper: errors of three methods, frame by frame."""

from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.motion import Motion
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.database.store import Database
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.progress import Progress

from .data import BOXING, CMU, WALKING, read_take, whole_database, without_tests
from .methods import METHODS
from .plots import Line, Panel, check_plots, write_plot
from .report import write_figures

# degrees per joint angle
PAPER = {
    BOXING.title: {"nearest": 7.67, "lwr": 6.15, "local-pca (paper's range)": 2.31},
    WALKING.title: {"nearest": 4.46, "lwr": 3.32, "local-pca (paper's range)": 1.30},
}
MARKER_SET = "boxing"
_UNITS = ("deg_per_joint", "deg_per_angle", "mpjpe_mm", "bone_direction_deg", "twist_deg", "jitter_ratio")


def figure6(data: Path, out: Path, workers: int, progress: Progress) -> dict[str, Any]:
    """Solve a boxing and a walking take by every method, and write the figure.

    The takes are not in the database.

    Returns:
        rows (take, method, errors, the paper's value), ratios between methods, database, outputs.
    """
    check_plots()
    whole = whole_database(data, out, (CMU,), workers, progress)
    database = without_tests(whole, out / "databases" / "cmu-without-tests.pfdb")
    rows, curves, panels = [], [], []
    takes = (BOXING, WALKING)
    for number, take in enumerate(takes):
        truth = read_take(data, take)
        lines = []
        for done, (name, settings) in enumerate(METHODS.items()):
            at = 0.25 + 0.75 * (number + done / len(METHODS)) / len(takes)
            progress(at, f"{take.title}: {name}")
            motion, milliseconds = solve_truth(truth, database, settings)
            errors = evaluate(motion, truth)
            row = {"take": take.title, "method": name, "frames": truth.frames}
            row |= {unit: round(errors[unit], 4) for unit in _UNITS}
            paper = PAPER[take.title].get(name, "")
            rows.append(row | {"ms_per_frame_median": round(milliseconds, 2), "paper_deg_per_angle": paper})
            frame_errors = degrees_per_joint(motion, truth)
            lines.append(Line(name, np.arange(truth.frames), frame_errors))
            curves += [
                {"take": take.title, "method": name, "frame": frame, "deg_per_joint": round(float(error), 4)}
                for frame, error in enumerate(frame_errors)
            ]
        panels.append(Panel(f"{take.title}, {truth.fps:g} Hz", lines))
    figures = {"rows": rows, "ratios": ratios(rows), "database": describe(database), "marker_set": MARKER_SET}
    plots = write_plot(out / "figure6", panels, "frame", "error (degrees per joint)")
    return write_figures(out, "figure6", figures, {"": rows, "frames": curves}, plots)


def true_subject(truth: Motion) -> Subject:
    """Return the subject of a motion's own skeleton with the benches' markers."""
    return Subject(truth.name, truth.skeleton, load_marker_set(MARKER_SET))


def solve_truth(
    truth: Motion, database: Database, settings: SolveSettings, causal: bool = True
) -> tuple[Motion, float]:
    """Solve a motion's markers; return the motion and the median time of a frame."""
    subject = true_subject(truth)
    take, _ = simulate_markers(truth, subject)
    result = solve_take(take, subject, database, settings, lambda fraction, text: None, causal=causal)
    return result.motion, 1e3 * float(np.median(result.seconds))


def degrees_per_joint(motion: Motion, truth: Motion) -> Array:
    """Return (F,) the mean angle between local rotations, without the root, degrees."""
    between = rot.angle_between(motion.rotations[:, 1:], truth.rotations[:, 1:])
    return np.asarray(np.degrees(between.mean(axis=1)))


def ratios(rows: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Return, per take, the deg/joint of one method as a share of another's."""
    tuned, paper = "local-pca (tuned)", "local-pca (paper's range)"
    pairs = ((paper, "nearest"), (tuned, "nearest"), ("best", paper), ("best", tuned))
    result: dict[str, dict[str, float]] = {}
    for take in dict.fromkeys(row["take"] for row in rows):
        error = {row["method"]: row["deg_per_joint"] for row in rows if row["take"] == take}
        result[take] = {f"{a} / {b}": round(error[a] / error[b], 3) for a, b in pairs}
    return result


def describe(database: Database) -> dict[str, Any]:
    """Return the size of a database."""
    return {"frames": database.frames, "fps": database.fps, "clips": len(database.clips)}
