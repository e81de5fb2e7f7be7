"""Solve a capture without an end, and measure growth of memory and time.

    python tools/session_soak.py --minutes 15 --method best
    python tools/session_soak.py --frames 5184000 --method nearest

A session of one performer gets the unlabelled points of a walk and of boxing, forwards and backwards for ever, with
cuts between them, 1 mm of noise and markers hidden 5 % of the time; once a minute nobody is there for a second. It runs
faster than real time, for so many minutes or until `--frames` are solved, whichever is first. A row for
each tenth: frames, memory (RSS), median and 99 % of a frame's time, and the latter as time of the processor, which
other programs on the computer change less.

Wrong where memory grows by more than 10 MB from the end of the first tenth, or where the 99 % of the last tenth, in
time of the processor, is more than 5 % above that of the first. Linux only: it looks at /proc.
"""

import argparse
import json
import secrets
import sys
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
from perfanim.core.solver.settings import METHODS, SolveSettings
from perfanim.core.system.assets import MOTION

FPS = 60.0
HEIGHT_M = 1.75
NOISE_MM, HIDDEN = 1.0, 0.05
ABSENT_EVERY, ABSENT = 3600, 60  # frames
SIGMA_M = 0.001
TENTHS = 10
DAY = round(24 * 3600 * FPS)  # frames
MOST_GROWN_MB, MOST_SLOWER = 10.0, 1.05
FIGURES = ("frames", "hours", "memory_mb", "median_ms", "p99_ms", "p99_processor_ms")


def main() -> int:
    """Run; the exit status is 1 when memory or times grew."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=inf, help="that it runs at most (default: to the last frame)")
    parser.add_argument("--frames", type=int, default=DAY, help=f"that are solved at most (default {DAY}: 24 hours)")
    parser.add_argument("--method", choices=METHODS, default="best", help="of the solver (default best)")
    parser.add_argument("--seed", type=int, default=None, help="of noise and gaps (default: others at every run)")
    parser.add_argument("--out", type=Path, help="report to write (JSON)")
    options = parser.parse_args()
    if options.frames < TENTHS or options.minutes <= 0.0:
        parser.error(f"give at least {TENTHS} frames and some time")
    seed = secrets.randbits(32) if options.seed is None else options.seed
    sys.stdout.write("".join(f"{name:>18}" for name in FIGURES) + "\n")
    rows: list[dict[str, float]] = []
    for row in soak(options.minutes * 60.0, options.frames, options.method, seed):
        rows.append(row)
        sys.stdout.write("".join(f"{row[name]:18.6g}" for name in FIGURES) + "\n")
        sys.stdout.flush()
    wrong = wrong_of(rows)
    if options.out:
        options.out.write_text(json.dumps({"seed": seed, "method": options.method, "rows": rows, "wrong": wrong}))
    sys.stdout.write(f"{options.method}: {'; '.join(wrong) or 'nothing grew'}; seed {seed}\n")
    return 1 if wrong else 0


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
        "memory_mb": int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6,
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


if __name__ == "__main__":
    sys.exit(main())
