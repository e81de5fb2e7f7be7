"""Measure how far wrong bodies come back by `refine_body`, and how sure it rightly is.

    python tools/refine_bench.py --data DATA --databases DIR [--seconds S] [--noise MM] [TRIAL...]

DATA/cmu holds the motion, DIR the databases cmu-without-subject-SUBJECT.pfdb. Each body has every part 10 % too long or
too short and every marker 1 to 2 cm off, by chance. Degrees are those of the take, solved as live with a body.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from bench.data import FPS, TestTake, read_take
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.database.store import Database, open_database
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.subject import Subject
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.subjects.body_change import PARTS, sized
from perfanim.core.subjects.refine_body import refine_body
from perfanim.core.system.progress import no_progress

TRIALS = ("13_30", "14_20", "91_01")  # none is a test take
PART_SHARE, OFFSETS_M = 0.1, (0.01, 0.02)


def wrong_body(right: Subject, rng: np.random.Generator) -> Subject:
    """Return the body with wrong bones and markers."""
    parts = PART_SHARE * rng.choice((-1.0, 1.0), len(PARTS))
    aside = rng.normal(size=(len(right.marker_set), 3))
    aside *= rng.uniform(*OFFSETS_M, (len(aside), 1)) / np.linalg.norm(aside, axis=1, keepdims=True)
    marker_set = right.marker_set.with_offsets(right.marker_set.offsets_m + aside)
    return replace(right, skeleton=sized(right.skeleton, parts), marker_set=marker_set)


def part_errors(subject: Subject, right: Subject) -> dict[str, float]:
    """Return by how much each part is too long, as a share."""
    found, true = (np.linalg.norm(each.skeleton.offsets_m, axis=1) for each in (subject, right))
    names = right.skeleton.names
    first = {part: next(joint for joint in names if joint.lstrip("lr") in bones or joint in bones)
             for part, bones in PARTS.items()}  # fmt: skip
    return {part: float(found[names.index(j)] / true[names.index(j)] - 1.0) for part, j in first.items()}


def offset_errors_m(subject: Subject, right: Subject) -> np.ndarray:
    """Return (M, 3) by how much each marker is off its place."""
    return subject.marker_set.offsets_m - right.marker_set.offsets_m


def degrees(take: MarkerTake, truth: Motion, subject: Subject, database: Database) -> float:
    """Return the mean error of the joints of the take, solved with a body."""
    solved = solve_take(take, subject, database, SolveSettings(), no_progress, causal=True)
    return float(evaluate(solved.motion, truth)["joint_rotation_deg"]["mean"])


def main() -> int:
    """Print a line for each body and trial."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("trials", nargs="*", default=TRIALS, metavar="TRIAL")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--databases", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--noise", type=float, default=1.0, help="millimetres of each coordinate")
    parser.add_argument("--marker-set", default="locomotion")
    parser.add_argument("--solve", action="store_true", help="solve the take with each body, too")
    options = parser.parse_args()
    for trial in options.trials:
        truth = read_take(options.data, TestTake(trial, trial))
        truth = sliced(truth, 0, round(options.seconds * FPS))
        right = Subject(trial, truth.skeleton, load_marker_set(options.marker_set))
        take = simulate_markers(truth, right, options.noise, seed=1)[0]
        database = open_database(options.databases / f"cmu-without-subject-{trial.partition('_')[0]}.pfdb")
        for kind, start in (("right", right), ("wrong", wrong_body(right, np.random.default_rng(int(trial[-2:]))))):
            begun = time.perf_counter()
            found = refine_body(take, start, database)
            seconds = time.perf_counter() - begun
            line = [f"{trial} {kind}: {seconds:.0f} s for {truth.frames / FPS:.0f} s"]
            before, after = (part_errors(each, right) for each in (start, found.subject))
            moved = [np.linalg.norm(offset_errors_m(each, right), axis=1) for each in (start, found.subject)]
            line.append(
                "bones " + " -> ".join(f"{100 * np.abs(list(e.values())).mean():.1f} %" for e in (before, after))
            )
            line.append("markers " + " -> ".join(f"{1e3 * np.sqrt(np.mean(e**2)):.1f} mm" for e in moved))
            z_parts = np.array([after[p] / found.size_sigmas[p] for p in PARTS])
            sigmas = np.array([found.offset_sigmas_m[n] for n in right.marker_set.names])
            z_marks = offset_errors_m(found.subject, right) / sigmas[:, None]
            line.append(
                f"within two sigmas: parts {np.mean(np.abs(z_parts) < 2):.2f}, markers {np.mean(np.abs(z_marks) < 2):.2f}"
            )
            if options.solve:
                figures = [degrees(take, truth, each, database) for each in (start, found.subject)]
                line.append("degrees " + " -> ".join(f"{each:.2f}" for each in figures))
            for part in PARTS:
                line.append(
                    f"\n   {part} {100 * before[part]:+.0f} % -> {100 * after[part]:+.1f} +- {200 * found.size_sigmas[part]:.1f}"
                )
            sys.stdout.write("; ".join(line) + "\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
