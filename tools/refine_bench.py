"""Measure how far `refine_body` brings wrong bodies back, and how sure it is.

    python tools/refine_bench.py --data DATA --databases DIR [--seconds S] [--noise MM] [TRIAL...]

DATA/cmu holds the motion, DIR the databases cmu-without-subject-SUBJECT.pfdb. Wrong bodies have markers 1 to 2 cm off
by chance, and either all bones 10 % too long or too short, or each part the one or the other. Degrees are those of the
take, solved as live with the body before and after.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from bench.data import FPS, TestTake, read_take
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.database.store import Database, open_database
from perfanim.core.geometry.arrays import Array
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.subject import Subject
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.subjects.body_change import PARTS, part_lengths_m, sized
from perfanim.core.subjects.refine_body import Refinement, refine_body
from perfanim.core.subjects.refinement_text import describe_changes
from perfanim.core.system.progress import no_progress

TRIALS = ("13_30", "14_20", "91_01")  # none is a test take
SHARE, OFFSETS_M = 0.1, (0.01, 0.02)


def bodies(right: Subject, rng: np.random.Generator) -> Iterator[tuple[str, Subject]]:
    """Yield the right body and wrong ones, with their kinds."""
    yield "right", right
    for kind, count in (("all bones", 1), ("each part", len(PARTS))):
        parts = np.resize(SHARE * rng.choice((-1.0, 1.0), count), len(PARTS))
        aside = rng.normal(size=(len(right.marker_set), 3))
        aside *= rng.uniform(*OFFSETS_M, (len(aside), 1)) / np.linalg.norm(aside, axis=1, keepdims=True)
        marker_set = right.marker_set.with_offsets(right.marker_set.offsets_m + aside)
        yield kind, replace(right, skeleton=sized(right.skeleton, parts), marker_set=marker_set)


def part_errors(subject: Subject, right: Subject) -> Array:
    """Return by how much each part and, last, all bones are too long, as shares."""
    found, true = (part_lengths_m(each.skeleton) for each in (subject, right))
    return np.append(found, found.sum()) / np.append(true, true.sum()) - 1.0


def errors(take: MarkerTake, truth: Motion, subject: Subject, database: Database) -> dict[str, float]:
    """Return the errors of the take, solved with a body."""
    solved = solve_take(take, subject, database, SolveSettings(), no_progress, causal=True)
    return evaluate(solved.motion, truth)


def report(start: Subject, found: Refinement, right: Subject) -> Iterator[str]:
    """Yield how far a body was off, how far it is, and how sure it is said to be."""
    before, after = (100.0 * part_errors(each, right) for each in (start, found.subject))
    yield f"whole {before[-1]:+.1f} -> {after[-1]:+.1f} % (± {200.0 * found.whole_sigma:.1f})"
    yield f"parts {np.abs(before[:-1]).mean():.1f} -> {np.abs(after[:-1]).mean():.1f} %"
    off = [each.marker_set.offsets_m - right.marker_set.offsets_m for each in (start, found.subject)]
    yield "markers " + " -> ".join(f"{1e3 * np.linalg.norm(each, axis=1).mean():.1f}" for each in off) + " mm"
    sure = np.abs(after[:-1]) < 200.0 * np.array([found.size_sigmas[part] for part in PARTS])
    yield f"{sure.sum()} of {len(sure)} parts"
    sigmas = np.array([found.offset_sigmas_m[name] for name in right.marker_set.names])
    yield f"{np.mean(np.abs(off[1]) < 2.0 * sigmas[:, None]):.0%} of markers' axes within ±"
    yield f"evidence {found.evidence:.0f}, {'offered' if describe_changes(start, found) else 'not offered'}"


def main() -> int:
    """Print a line for each body and trial."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("trials", nargs="*", default=TRIALS, metavar="TRIAL")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--databases", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=20.0, help="of motion (default 20)")
    parser.add_argument("--noise", type=float, default=1.0, help="millimetres of each coordinate (default 1)")
    parser.add_argument("--marker-set", default="locomotion", help="default locomotion")
    options = parser.parse_args()
    for trial in options.trials:
        truth = read_take(options.data, TestTake(trial, trial))
        truth = sliced(truth, 0, min(truth.frames, round(options.seconds * FPS)))
        right = Subject(trial, truth.skeleton, load_marker_set(options.marker_set))
        take = simulate_markers(truth, right, options.noise, seed=1)[0]
        subject, _, number = trial.partition("_")
        database = open_database(options.databases / f"cmu-without-subject-{subject}.pfdb")
        for kind, start in bodies(right, np.random.default_rng(int(number))):
            begun = time.perf_counter()
            found = refine_body(take, start, database)
            seconds = time.perf_counter() - begun
            solved = [errors(take, truth, each, database) for each in (start, found.subject)]
            line = [f"{trial} {kind}: refined in {seconds:.1f} s", *report(start, found, right)]
            line += [
                " -> ".join(f"{each[name]:.2f}" for each in solved) + f" {unit}"
                for name, unit in (("deg_per_joint", "degrees"), ("mpjpe_mm", "mm mpjpe"))
            ]
            sys.stdout.write("; ".join(line) + "\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
