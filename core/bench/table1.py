"""Table 1 of the paper: frames that the search visits, and how far that takes the poses from the exhaustive search."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import rotations as rot
from ..database.store import Clip, Database
from ..marker_set import Subject, load_marker_set
from ..simulate.markers import simulate_markers
from ..solver.observation import Observation
from ..solver.pose_solver import PoseSolver
from ..solver.settings import SolveSettings
from ..solver.subject_model import SubjectModel
from .data import BANDAI, BOXING, CMU, WALKING, Progress, TestTake, read_take, whole_database, without_tests
from .figure6 import MARKER_SET
from .methods import METHODS, PAPER_RANGE
from .report import write_json, write_rows

# frames, mean, minimum, maximum visited, error in degrees per joint
PAPER = {"boxing": (71597, 752.31, 36, 8968, 0.025), "heterogeneous": (433622, 710.1, 31, 9101, 0.014)}
TAKES = (BOXING, WALKING, TestTake("running (09_03)", "09_03"), TestTake("jumping (16_02)", "16_02"))
COMPARED = {"local-pca (paper's range)": PAPER_RANGE, "best": METHODS["best"]}
_COLUMNS = ("frames", "mean", "min", "max", "deg_per_joint")


def table1(data: Path, out: Path, workers: int, progress: Progress) -> dict[str, Any]:
    """Solve takes with the graph search and, from the same state, with the exhaustive search; write the table.

    Args:
        data: folder that holds `cmu` and `bandai`.
        out: folder to write to.
        workers: processes that read motion.

    Returns:
        rows (database, search, method, take, frames, mean, min, max visited, error), paper, outputs.
    """
    whole = whole_database(data, out, (CMU, BANDAI), workers, progress)
    folder = out / "databases"
    databases = {
        "CMU": without_tests(whole, folder / "table1-cmu.perfdb", _is_cmu),
        "CMU and Bandai-Namco": without_tests(whole, folder / "table1-all.perfdb"),
    }
    rows = []
    steps = len(databases) * len(TAKES)
    for number, (name, database) in enumerate(databases.items()):
        for done, take in enumerate(TAKES):
            progress(0.4 + 0.6 * (number * len(TAKES) + done) / steps, f"{name}: {take.title}")
            for row in _compared(data, database, take):
                rows.append({"database": name, "database_frames": database.frames} | row)
    totals = _totals(rows)
    paper = [{"database": name} | dict(zip(_COLUMNS, row, strict=True)) for name, row in PAPER.items()]
    figures = {"rows": totals, "takes": rows, "paper": paper}
    write_json(out / "table1.json", figures)
    write_rows(out / "table1.csv", totals)
    write_rows(out / "table1-takes.csv", rows)
    return figures | {"outputs": [str(out / f) for f in ("table1.json", "table1.csv", "table1-takes.csv")]}


def _is_cmu(clip: Clip) -> bool:
    return not clip.subject.startswith("dataset")


def _compared(data: Path, database: Database, take: TestTake) -> list[dict[str, Any]]:
    truth = read_take(data, take)
    subject = Subject(truth.name, truth.skeleton, load_marker_set(MARKER_SET))
    markers = simulate_markers(truth, subject)[0].positions_m
    model = SubjectModel(subject, database.mean_rotations)
    rows = []
    for method, settings in COMPARED.items():
        for search in ("graph", "cells"):
            rows.append(
                {"search": search, "method": method, "take": take.title}
                | searched(model, database, markers, replace(settings, search=search))
            )
    return rows


def searched(model: SubjectModel, database: Database, markers_m: Any, settings: SolveSettings) -> dict[str, Any]:
    """Return how many frames a search visits and how far its poses are from the exhaustive search's.

    In every frame both start from what the tested search has made of the motion so far, as the error of a single
    search is asked for, not what becomes of it.

    Args:
        markers_m: (F, M, 3) in the order of the marker set.
        settings: `search` is the one tested.
    """
    tested = PoseSolver(model, database, settings)
    exhaustive = PoseSolver(model, database, replace(settings, search="exhaustive"))
    visited, apart = [], []
    for row in markers_m:
        exhaustive.continue_from(tested)
        observation = Observation.of_points(row)
        solutions = [solver.step(observation) for solver in (tested, exhaustive)]
        local = [model.rotations(solution.pose, solution.root)[1:] for solution in solutions if solution]
        visited.append(tested.visited)
        apart.append(float(np.degrees(rot.angle_between(*local)).mean()))
    return {
        "frames": len(visited),
        "mean": round(float(np.mean(visited)), 1),
        "min": min(visited),
        "max": max(visited),
        "deg_per_joint": round(float(np.mean(apart)), 5),
    }


def _totals(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows of all takes together, frame by frame."""
    totals = []
    for key in dict.fromkeys((row["database"], row["database_frames"], row["search"], row["method"]) for row in rows):
        mine = [r for r in rows if (r["database"], r["database_frames"], r["search"], r["method"]) == key]
        frames = [row["frames"] for row in mine]
        totals.append(
            dict(zip(("database", "database_frames", "search", "method"), key, strict=True))
            | {
                "frames": sum(frames),
                "mean": round(float(np.average([row["mean"] for row in mine], weights=frames)), 1),
                "min": min(row["min"] for row in mine),
                "max": max(row["max"] for row in mine),
                "deg_per_joint": round(float(np.average([r["deg_per_joint"] for r in mine], weights=frames)), 5),
            }
        )
    return totals
