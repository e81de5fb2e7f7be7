"""Processor time of frames without labels, through cuts."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.motion import Motion
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.database.store import Database, open_database
from perfanim.core.session.session import Session
from perfanim.core.solver.search.exhaustive import ExhaustiveSearch, Query

from .data import CMU, FPS, data_folders
from .figure6 import true_subject
from .random_cuts import Cut, frame_of, random_cuts

_SEARCHES, _WANTED = 9, 300  # timed before each cut, as other work on the machine changes its speed
_SEED = 3


def mirrored_database(data: Path, out: Path, workers: int) -> Database:
    """Return the database of all recordings and their mirror images, built if missing."""
    path = out / "databases" / f"{CMU}-mirrored.pfdb"
    if not path.exists():
        build_database(data_folders(data, (CMU,)), path, BuildSettings(fps=FPS, mirror=True, workers=workers))
    return open_database(path)


def frame_times(takes: Mapping[str, Motion], database: Database, count: int) -> list[dict[str, Any]]:
    """Return a row (cut, frame, ms, share) for each frame of random cuts.

    With default settings; `share` is of one exhaustive search of the same database.
    """
    generator = np.random.default_rng(_SEED)
    rows = []
    for cut in random_cuts(takes, count, generator):
        session = Session(true_subject(_standing(cut)), database)
        search_ms = _search_ms(session)
        for number, true in enumerate(cut.positions_m):
            frame, _ = frame_of(number, true, generator)
            started_s = time.thread_time()
            session.step(frame)
            ms = 1e3 * (time.thread_time() - started_s)
            rows.append(
                {"cut": cut.title, "frame": number - cut.back, "ms": round(ms, 3), "share": round(ms / search_ms, 4)}
            )
    return rows


def doubt_summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows (check, value, goal) on `frame_times`."""
    result = []
    for key, unit, goal in (("ms", "processor ms", "<= 12"), ("share", "share of an exhaustive search", "")):
        values = np.array([row[key] for row in rows]) if rows else np.empty(0)
        for name, share in (("median", 0.5), ("p95", 0.95), ("p99", 0.99), ("longest", 1.0)) if rows else ():
            value = round(float(np.quantile(values, share)), 3)
            check = f"frame in doubt, {unit}, {name}"
            result.append({"check": check, "value": value, "goal": goal if name == "p99" else ""})
    return result


def _standing(cut: Cut) -> Motion:
    return Motion(cut.subject, FPS, cut.skeleton, t_pose(cut.skeleton)[None], np.zeros((1, 3)))


def _search_ms(session: Session) -> float:
    """Return the median processor time of an exhaustive search, ms."""
    locator, taken = session.solver._locator, []
    markers_m = locator._markers.all()
    search = ExhaustiveSearch(markers_m, locator._poses)
    for frame in np.linspace(0, len(markers_m) - 1, _SEARCHES).astype(int):
        query = Query(markers_m[frame].astype(np.float64), locator._poses[frame].astype(np.float64), 0.8, 0.2)
        started_s = time.thread_time()
        search.nearest(query, _WANTED)
        taken.append(1e3 * (time.thread_time() - started_s))
    return float(np.median(taken))
