"""Figure 6 of the paper: errors of the methods, frame by frame."""

from typing import Any

import numpy as np
from perfanim.core.body.motion_metrics import evaluate

from .plots import Line, Panel, check_plots, write_plot
from .run import Run
from .scenarios import BOXING, CMU, METHODS, TUNED, WALKING
from .solving import MARKER_SET, degrees_per_joint, describe, solve_truth

# degrees per joint angle
PAPER = {
    BOXING.title: {"nearest": 7.67, "lwr": 6.15, "local-pca (paper's range)": 2.31},
    WALKING.title: {"nearest": 4.46, "lwr": 3.32, "local-pca (paper's range)": 1.30},
}
_UNITS = ("deg_per_joint", "deg_per_angle", "mpjpe_mm", "bone_direction_deg", "twist_deg", "jitter_ratio")


def figure6(run: Run) -> dict[str, Any]:
    """Solve a boxing and a walking take, which are not in the database, with every method; write the figure.

    Returns:
        rows (take, method, errors, the paper's value), ratios between methods, database, outputs.
    """
    check_plots()
    database = run.without_tests(run.whole(CMU))
    rows, curves, panels = [], [], []
    for number, take in enumerate((BOXING, WALKING)):
        truth, lines = run.read(take), []
        for done, (name, settings) in enumerate(METHODS.items()):
            run.progress(0.25 + 0.375 * (number + done / len(METHODS)), f"{take.title}: {name}")
            solved = solve_truth(truth, database, settings)
            errors = evaluate(solved.motion, truth)
            row = {"take": take.title, "method": name, "frames": truth.frames}
            row |= {unit: round(errors[unit], 4) for unit in _UNITS}
            row["ms_per_frame_median"] = round(1e3 * float(np.median(solved.seconds)), 2)
            rows.append(row | {"paper_deg_per_angle": PAPER[take.title].get(name, "")})
            of_frames = degrees_per_joint(solved.motion, truth)
            lines.append(Line(name, np.arange(truth.frames), of_frames))
            curves += [
                {"take": take.title, "method": name, "frame": frame, "deg_per_joint": round(float(error), 4)}
                for frame, error in enumerate(of_frames)
            ]
        panels.append(Panel(f"{take.title}, {truth.fps:g} Hz", lines))
    figures = {"rows": rows, "ratios": ratios(rows), "database": describe(database), "marker_set": MARKER_SET}
    plots = write_plot(run.out / "figure6", panels, "frame", "error (degrees per joint)")
    return run.write("figure6", figures, {"": rows, "frames": curves}, plots)


def ratios(rows: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Return, per take, one method's degrees per joint relative to another's."""
    paper = "local-pca (paper's range)"
    pairs = ((paper, "nearest"), (TUNED, "nearest"), ("best", paper), ("best", TUNED))
    result: dict[str, dict[str, float]] = {}
    for take in dict.fromkeys(row["take"] for row in rows):
        error = {row["method"]: row["deg_per_joint"] for row in rows if row["take"] == take}
        result[take] = {f"{a} / {b}": round(error[a] / error[b], 3) for a, b in pairs}
    return result
