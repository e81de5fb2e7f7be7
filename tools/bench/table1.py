"""Table 1 of the paper: number of visited frames, and deviation from the exhaustive search."""

import time
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
from perfanim.core.body.motion import Motion
from perfanim.core.database.header_facts import Clip
from perfanim.core.database.store import Database, pose_from_rotations
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import FloatArray
from perfanim.core.solver import method_factory
from perfanim.core.solver.database_markers import database_markers
from perfanim.core.solver.observation import Observation
from perfanim.core.solver.paper.neighbour_graph import build_graph
from perfanim.core.solver.pose_solver import PoseSolver
from perfanim.core.solver.search.exhaustive import Query
from perfanim.core.solver.settings import LwrSettings, NearestSettings
from perfanim.core.solver.subject_model import SubjectModel

from .run import Run
from .scenarios import BANDAI, CMU, METHODS, PAPER_RANGE, TABLE1_BANDAI, TABLE1_TAKES, WALKING
from .solving import markers_of, true_subject
from .tables import groups

# frames, mean, minimum, maximum visited, error in degrees per joint
PAPER = {"boxing": (71597, 752.31, 36, 8968, 0.025), "heterogeneous": (433622, 710.1, 31, 9101, 0.014)}
_PAPER_SEARCH: dict[str, Any] = {  # all methods use the same search
    "examples": PAPER_RANGE.local_pca.neighbours[-1],
    "query_pose_m_per_rad": PAPER_RANGE.local_pca.query_pose_m_per_rad,
}
# The closest example shows the search's own error. The local model, which is chosen again in each frame with as few
# dimensions as the paper's, amplifies small differences between the examples found.
COMPARED = {
    "nearest": replace(PAPER_RANGE, method="nearest", nearest=NearestSettings(**_PAPER_SEARCH)),
    "lwr": replace(PAPER_RANGE, method="lwr", lwr=LwrSettings(**_PAPER_SEARCH)),
    "local-pca (paper's range)": PAPER_RANGE,
    "best": METHODS["best"],
}
SEARCHES = ("graph", "cells")
_EVERY = 4  # step between the frames that are compared with the exhaustive search
_SAME_DEG = 0.014  # per joint: poses closer than this count as the same


def table1(run: Run) -> dict[str, Any]:
    """Solve takes with each search and with the exhaustive search from the same states; write the table.

    Returns:
        rows (database, search, method, frames, mean, min, max visited, error, share of frames with the same pose),
        takes (the same for each), times (search, milliseconds, share of the exhaustive search's), paper, outputs.
    """
    whole = run.whole(CMU, BANDAI)
    databases = {
        "CMU": run.without_tests(whole, "table1-cmu", lambda clip: not clip.subject.startswith("dataset")),
        "CMU and Bandai-Namco": run.without_tests(whole, "table1-all", lambda clip: clip.name not in TABLE1_BANDAI),
    }
    takes = {take.title: run.read(take) for take in TABLE1_TAKES}
    takes |= {clip.name: _motion(whole, clip) for clip in whole.clips if clip.name in TABLE1_BANDAI}
    rows, times = [], []
    for number, (name, database) in enumerate(databases.items()):
        of = {"database": name, "database_frames": database.frames}
        graph = build_graph(np.asarray(database.poses).reshape(database.frames, -1), database.clip_of_frame)
        solved = [title for title in takes if title not in TABLE1_BANDAI or name != "CMU"]
        with patch.object(method_factory, "build_graph", lambda *given, graph=graph: graph):  # once for all solvers
            for done, title in enumerate(solved):
                run.progress(0.4 + 0.3 * (number + done / len(solved)), f"{name}: {title}")
                rows += [of | row for row in _compared(takes[title], database)]
            times += [of | row for row in _search_times(takes[WALKING.title], database)]
    totals = _totals(rows)
    columns = ("frames", "mean", "min", "max", "deg_per_joint")
    paper = [{"database": name} | dict(zip(columns, row, strict=True)) for name, row in PAPER.items()]
    figures = {"rows": totals, "takes": rows, "times": times, "paper": paper, "compared_every": _EVERY}
    return run.write("table1", figures, {"": totals, "takes": rows, "times": times})


def _motion(database: Database, clip: Clip) -> Motion:
    """Return a clip as it is stored."""
    frames = slice(clip.start, clip.stop)
    positions = np.asarray(database.root_positions_m[frames], dtype=np.float64)
    skeleton = database.skeletons[clip.skeleton]
    return Motion(clip.name, database.fps, skeleton, database.local_rotations(frames), positions)


def _compared(truth: Motion, database: Database) -> list[dict[str, Any]]:
    subject = true_subject(truth)
    markers = markers_of(truth)
    model = _Model(subject, database.reference_pose_of(subject.skeleton, subject.name))
    rows = []
    for method, settings in COMPARED.items():
        exhaustive = PoseSolver(model, database, replace(settings, search="exhaustive"))
        for search in SEARCHES:
            tested = PoseSolver(model, database, replace(settings, search=search))
            row = {"search": search, "method": method, "take": truth.name}
            rows.append(row | searched(tested, exhaustive, markers))
    return rows


class _Model(SubjectModel):
    """Subject model that caches the markers of a database for all solvers."""

    _stored: FloatArray | None = None

    def database_markers(self, database: Database, frames: Any = slice(None)) -> FloatArray:
        """Return the markers in all frames."""
        if self._stored is None:
            self._stored = super().database_markers(database)
        return self._stored[frames]


def searched(tested: PoseSolver, exhaustive: PoseSolver, markers_m: Any, every: int = _EVERY) -> dict[str, Any]:
    """Return visited frames and deviation from the exhaustive search's poses.

    Both start from the tested search's motion so far, so the error is that of a single search. All visits for a frame
    count; in the first frame these are several searches.

    Args:
        tested, exhaustive: Solvers of the same method, subject and database.
        markers_m: True positions (F, M, 3) in the order of the marker set.
        every: Number of frames between two compared poses.
    """
    state = tested.initial_state
    visited, apart = [], []
    for number, row in enumerate(markers_m):
        observation = Observation.of_points(row)
        before, before_frame = tested.visited, state
        solution, state = tested.step(before_frame, observation)
        visited.append(tested.visited - before)
        if solution is None or number % every:
            continue
        theirs, _ = exhaustive.step(before_frame, observation)
        if theirs is not None:
            local = [tested.subject.rotations(s.pose, s.root)[1:] for s in (solution, theirs)]
            apart.append(float(np.degrees(rot.angle_between(*local)).mean()))
    return {
        "frames": len(visited),
        "mean": round(float(np.mean(visited)), 1),
        "min": min(visited),
        "max": max(visited),
        "deg_per_joint": round(float(np.mean(apart)), 5),
        "same": round(float(np.mean(np.array(apart) < _SAME_DEG)), 4),
    }


def _search_times(truth: Motion, database: Database) -> list[dict[str, Any]]:
    """Return each search's time for true queries, and its ratio to the exhaustive search's."""
    subject = true_subject(truth)
    model = SubjectModel(subject, database.reference_pose_of(subject.skeleton, subject.name))
    true_poses = pose_from_rotations(truth.rotations, model.mean_rotations)
    stored = database_markers(model, database)
    pose_weight = (1.0 - PAPER_RANGE.query_alpha) * PAPER_RANGE.local_pca.query_pose_m_per_rad**2
    queries = [
        Query(seen, pose.ravel() if frame else None, PAPER_RANGE.query_alpha, pose_weight)
        for frame, (seen, pose) in enumerate(zip(model.markers(true_poses), true_poses, strict=True))
    ]
    milliseconds = {}
    for name in ("exhaustive", *SEARCHES):
        search, taken = method_factory.choose_search(name, database, stored), []
        for query in queries:
            started = time.perf_counter()
            search.nearest(query, PAPER_RANGE.local_pca.neighbours[-1])
            taken.append(1e3 * (time.perf_counter() - started))
        milliseconds[name] = taken
    exhaustive = float(np.median(milliseconds["exhaustive"]))
    return [
        {
            "search": name,
            "start_ms": round(taken[0], 3),
            "median_ms": round(float(np.median(taken)), 3),
            "p99_ms": round(float(np.percentile(taken, 99)), 3),
            "median_of_exhaustive": round(float(np.median(taken)) / exhaustive, 4),
        }
        for name, taken in milliseconds.items()
    ]


def _totals(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows of all takes combined, frame by frame."""
    keys, totals = ("database", "database_frames", "search", "method"), []
    for key, mine in groups(rows, *keys).items():
        frames = [row["frames"] for row in mine]
        averages = {
            name: round(float(np.average([row[name] for row in mine], weights=frames)), digits)
            for name, digits in (("mean", 1), ("deg_per_joint", 5), ("same", 4))
        }
        row = dict(zip(keys, key, strict=True)) | {"frames": sum(frames), "mean": averages["mean"]}
        row |= {"min": min(row["min"] for row in mine), "max": max(row["max"] for row in mine)}
        totals.append(row | averages)
    return totals
