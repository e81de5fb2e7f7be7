"""Solve a capture without an end, and measure growth of memory and time.

A session of one performer gets the unlabelled points of a walk and of boxing, forwards and backwards for ever, with
cuts between them, 1 mm of noise and markers hidden 5 % of the time; once a minute nobody is there for a second. It runs
faster than real time. A row for
each tenth: frames, memory (RSS), median and 99 % of a frame's time, and the latter as time of the processor, which
other programs on the computer change less.

Wrong where memory grows by more than 10 MB from the end of the first tenth, or where the 99 % of the last tenth, in
time of the processor, is more than 5 % above that of the first. Linux only: it looks at /proc.
"""

import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
from perfanim.core.body.motion import resampled
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.database.store import open_database
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry.arrays import Array
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.session.session import Session
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.assets import MOTION

from .processes import Row, memory_mb

FPS = 60.0
HEIGHT_M = 1.75
NOISE_MM, HIDDEN = 1.0, 0.05
ABSENT_EVERY, ABSENT = 3600, 60  # frames
SIGMA_M = 0.001
TENTHS = 10
MOST_GROWN_MB, MOST_SLOWER = 10.0, 1.05


def rows(count: int, seed: int, method: str = "best", seconds: float = inf) -> Iterator[Row]:
    """Yield the figures of each tenth of `count` frames, or of the time; the last says what grew."""
    tenths: list[Row] = []
    for row in soak(seconds, count, method, seed):
        tenths.append(row)
        yield row | {"wrong": wrong_of(tenths) if len(tenths) == TENTHS else []}


def soak(seconds: float, most: int, method: str, seed: int) -> Iterator[dict[str, float]]:
    """Yield the figures of each tenth of the frames, or of the time."""
    with tempfile.TemporaryDirectory(prefix="session-soak-") as name:
        path = Path(name) / "starter.pfdb"
        build_database([str(MOTION)], path, BuildSettings(fps=FPS))
        subject = Subject("Sim", default_skeleton(HEIGHT_M), load_marker_set("boxing"))
        session = Session(subject, open_database(path), settings=SolveSettings(method=method))
        frames = _frames(seed)
        for _ in range(TENTHS):
            yield _tenth(session, frames, seconds / TENTHS, most // TENTHS)


def _tenth(session: Session, frames: Iterator[MarkerFrame], seconds: float, most: int) -> dict[str, float]:
    # arrays of fixed size, so that the measurement itself does not grow
    taken_s, processor_s = np.zeros(most, np.float32), np.zeros(most, np.float32)
    end_s, count, time_s = time.perf_counter() + seconds, 0, 0.0
    while count < most and time.perf_counter() < end_s:
        frame = next(frames)
        begun_s, begun_processor_s = time.perf_counter(), time.thread_time()
        session.step(frame)
        taken_s[count], processor_s[count] = time.perf_counter() - begun_s, time.thread_time() - begun_processor_s
        count, time_s = count + 1, frame.time_s
    taken_s, processor_s = 1e3 * taken_s[:count], 1e3 * processor_s[:count]
    return {
        "frames": count,
        "hours": time_s / 3600.0,
        "memory_mb": memory_mb("self"),
        "median_ms": float(np.median(taken_s)),
        "p99_ms": float(np.percentile(taken_s, 99)),
        "p99_processor_ms": float(np.percentile(processor_s, 99)),
    }


def wrong_of(rows: list[dict[str, float]]) -> list[str]:
    """Return the figures that grew."""
    grown_mb = max(row["memory_mb"] for row in rows) - rows[0]["memory_mb"]
    slower = rows[-1]["p99_processor_ms"] / rows[0]["p99_processor_ms"]
    wrong = [f"memory grew by {grown_mb:.1f} MB"] if grown_mb > MOST_GROWN_MB else []
    return wrong + ([f"the last tenth took {slower:.2f} times as long"] if slower > MOST_SLOWER else [])


def _frames(seed: int) -> Iterator[MarkerFrame]:
    """Yield marker frames for ever."""
    generator = np.random.default_rng(seed)
    rows = np.concatenate([_positions(behaviour, seed) for behaviour in ("walking", "boxing")])
    number = 0
    while True:
        for row in rows:
            seen = np.isfinite(row[:, 0]) & (number % ABSENT_EVERY >= ABSENT)
            points = generator.permutation(row[seen]) + generator.normal(0.0, 1e-3 * NOISE_MM, (int(seen.sum()), 3))
            covariances = np.broadcast_to(SIGMA_M**2 * np.eye(3), (len(points), 3, 3))
            yield MarkerFrame(number, number / FPS, points, covariances)
            number += 1


def _positions(behaviour: str, seed: int) -> Array:
    """Return a clip's markers (F, M, 3), forwards and then backwards."""
    motion = resampled(read_motion(min(MOTION.glob(f"{behaviour}*.bvh"))), FPS)
    motion = replace(motion, skeleton=default_skeleton(HEIGHT_M))
    take, _ = simulate_markers(motion, load_marker_set("boxing"), dropout=HIDDEN, seed=seed)
    return np.concatenate((take.positions_m, take.positions_m[::-1]))
