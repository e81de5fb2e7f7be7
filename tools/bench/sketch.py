"""Sketches made of recorded takes: bodies from keys, by several methods.

The true paths of a few joints are keyed every 8, 16 or 32 frames of 30 a second, or where they turn most, and joined by
Blender's default curves. The takes are out of the database; other takes of their subjects are in it. The constants of
the solver were chosen on the takes of `DEVELOPMENT`, while those of `TAKES` were seen; those of `FRESH` were solved
after the last choice. Five controls with keys every 16 frames are also solved with the whole subject out of the
database, for fresh takes, and with a solver that knows when the true feet stand: then feet skate only by
the fit, the rest comes from not knowing when they step between keys.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.motion import Motion, resampled, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.database.store import Database, open_database
from perfanim.core.geometry.arrays import Array, Mask
from perfanim.core.sketch.base_motion import BaseMotion
from perfanim.core.sketch.key_curves import curve_positions
from perfanim.core.sketch.motion_library import TOES
from perfanim.core.sketch.sketch_file import Control, Sketch
from perfanim.core.sketch.solve_sketch import SketchSettings, SketchSolver, key_distances
from perfanim.core.system.progress import Progress
from scipy.ndimage import minimum_filter1d

from .data import CMU, SPLIT, SPLIT_AT, TestTake, read_take, whole_database
from .methods import METHODS
from .plots import check_plots
from .report import write_figures
from .sketch_references import inverse_kinematics, solved_as_markers
from .subset import write_subset
from .worst_frames import Picture, write_pictures

FPS = 30.0
TAKES = (
    TestTake("walk (16_16)", "16_16"),
    TestTake("walk with a turn (16_17)", "16_17"),
    TestTake("run (09_03)", "09_03"),
    TestTake("jump (16_02)", "16_02"),
    TestTake("boxing (14_02, last third)", SPLIT, SPLIT_AT),
    TestTake("karate in place of kendo (135_06)", "135_06"),
    TestTake("squat in place of a sit-down (13_30)", "13_30", 0.55, 0.8),
    TestTake("dance (05_10)", "05_10"),
)
DEVELOPMENT = (
    TestTake("walk (16_31)", "16_31"),
    TestTake("walk with a turn (16_20)", "16_20"),
    TestTake("run (09_06)", "09_06"),
    TestTake("jump (16_06)", "16_06"),
    TestTake("boxing (14_02, second third)", SPLIT, 1 / 3, SPLIT_AT),
    TestTake("karate (135_05)", "135_05"),
    TestTake("squat (14_14)", "14_14", 0.22, 0.4),
    TestTake("dance (49_13)", "49_13"),
)
FRESH = (
    TestTake("walk (07_01)", "07_01"),
    TestTake("walk with a turn (16_29)", "16_29"),
    TestTake("run (09_01)", "09_01"),
    TestTake("jump (16_05)", "16_05"),
    TestTake("punches and kicks (86_01)", "86_01"),
    TestTake("karate (135_11)", "135_11"),
    TestTake("squat (13_29)", "13_29", 0.55, 0.8),
    TestTake("dance (05_17)", "05_17"),
)
CONTROLS = {"five": ("root", "lfoot", "rfoot", "lhand", "rhand"), "three": ("root", "lhand", "rhand")}
KEYS = ("8", "16", "32", "turns")
UNSEEN, UNTOUCHED = "five, unseen subject", "five, fresh takes"
INFORMED = "sketch that knows when feet stand"
_EDITS = 5
_TURNS_EVERY = 16  # frames that there is a key for where paths turn most
_MOST_FRAMES = 240  # of a take
_MEASURES = (
    "deg_per_joint", "mpjpe_mm", "mpjpe_absolute_mm", "foot_skate_cm_s", "foot_skate_truth_cm_s", "jitter_ratio",
)  # fmt: skip
OURS, IK, BEST, NEAREST = "sketch", "two-bone IK", "best on the curves", "nearest on the curves"
_DRAWN = 4  # frames of each take
_LOW_M = 0.02  # toes above their lowest place within a second, that are on the floor
_STANDING_M, _STANDING_M_S = 0.05, 0.4  # wider than skate asks in speed: a foot that rolls stands
_GLIDES = ("glide_cm_s", "glide_truth_cm_s")


def sketch(data: Path, out: Path, workers: int, progress: Progress) -> dict[str, Any]:
    """Solve sketches of eight takes by every method, and write the table.

    Returns:
        rows (take, controls, keys, method, errors), means over the takes, ratios, times of edits, database, outputs.
    """
    check_plots()
    whole = whole_database(data, out, (CMU,), workers, progress)
    database = without_takes(whole, out / "databases" / "cmu-without-sketched.pfdb", TAKES)
    rows: list[dict[str, Any]] = []
    pictures: list[Picture] = []
    edits: list[dict[str, Any]] = []
    for number, take in enumerate(TAKES):
        truth = true_motion(data, take)
        compared = Compared(take, truth, database)
        for controls, joints in CONTROLS.items():
            for keys in KEYS:
                progress(0.2 + 0.8 * number / len(TAKES), f"{take.title}: {controls} controls, keys {keys}")
                rows += compared.rows(sketch_of(truth, joints, keys), {"controls": controls, "keys": keys})
                if (controls, keys) == ("five", "16"):
                    pictures += _strip(take.title, truth, compared.motions[OURS])
                    rows.append(
                        compared.informed_row(sketch_of(truth, joints, keys), {"controls": controls, "keys": keys})
                    )
        edits.append({"take": take.title, "frames": truth.frames} | edit_times(compared.solver, truth))
        path = out / "databases" / f"cmu-without-sketched-and-{take.trial}.pfdb"
        unseen = Compared(take, truth, without_subject_of(whole, path, take))
        rows += unseen.rows(sketch_of(truth, CONTROLS["five"], "16"), {"controls": UNSEEN, "keys": "16"})
    rows += _fresh_rows(data, without_takes(whole, out / "databases" / "cmu-without-fresh.pfdb", FRESH), progress)
    means = means_of(rows)
    figures: dict[str, Any] = {"rows": rows, "means": means, "ratios": ratios_of(means), "edits": edits}
    figures["database_frames"] = database.frames
    plots = write_pictures(out / "sketch-beside-truth", pictures)
    return write_figures(out, "sketch", figures, {"": rows, "means": means, "edits": edits}, plots)


def _fresh_rows(data: Path, database: Database, progress: Progress) -> list[dict[str, Any]]:
    """Return the rows of takes that no constant was chosen by."""
    rows: list[dict[str, Any]] = []
    facts = {"controls": UNTOUCHED, "keys": "16"}
    for number, take in enumerate(FRESH):
        progress(number / len(FRESH), f"{take.title}: fresh")
        truth = true_motion(data, take)
        compared, drawn = Compared(take, truth, database), sketch_of(truth, CONTROLS["five"], "16")
        rows += [*compared.rows(drawn, facts), compared.informed_row(drawn, facts)]
    return rows


class Compared:
    """Methods compared on sketches of one take.

    Attributes:
        motions: of the last sketch by method.
    """

    def __init__(self, take: TestTake, truth: Motion, database: Database) -> None:
        self._take, self._truth, self._database = take, truth, database
        self.solver = SketchSolver(truth.skeleton, database)
        self.motions: dict[str, Motion] = {}

    def rows(self, drawn: Sketch, facts: dict[str, Any]) -> list[dict[str, Any]]:
        """Solve a sketch by every method; return a row with the errors of each."""
        skeleton, database = self._truth.skeleton, self._database
        self.motions = {
            OURS: self.solver.solve(drawn).motion,
            IK: inverse_kinematics(drawn, skeleton),
            BEST: solved_as_markers(drawn, skeleton, database, METHODS["best"]),
            NEAREST: solved_as_markers(drawn, skeleton, database, METHODS["nearest"]),
        }
        return [self._row(drawn, motion, facts | {"method": name}) for name, motion in self.motions.items()]

    def informed_row(self, drawn: Sketch, facts: dict[str, Any]) -> dict[str, Any]:
        """Return the row of our solver that knows when the true feet stand."""
        motion = _InformedSolver(self._truth, self._database).solve(drawn).motion
        return self._row(drawn, motion, facts | {"method": INFORMED})

    def _row(self, drawn: Sketch, motion: Motion, facts: dict[str, Any]) -> dict[str, Any]:
        errors = errors_of(drawn, motion, self._truth)
        return {"take": self._take.title} | facts | {"frames": self._truth.frames} | errors


class _InformedSolver(SketchSolver):
    """A solver that knows when the true feet stand, instead of by examples."""

    def __init__(self, truth: Motion, database: Database) -> None:
        super().__init__(truth.skeleton, database)
        self._stands = standing_feet(truth)

    def _drawn(self, *arguments: Any, **options: Any) -> tuple[BaseMotion, float]:
        base, off_m2 = super()._drawn(*arguments, **options)
        return replace(base, standing=self._stands.astype(np.float64)), off_m2


def edit_times(solver: SketchSolver, truth: Motion) -> dict[str, float]:
    """Return times to solve a sketch, and to solve it again after a key moved, ms.

    A hand's key in the middle moves by 3 cm a time, and the frame in the middle is shown; medians, of the processor's
    time.
    """
    drawn = sketch_of(truth, CONTROLS["five"], "16")
    found = SketchSolver(truth.skeleton, solver.database)
    times: dict[str, list[float]] = {"from_start_ms": [], "first_picture_ms": [], "whole_ms": []}

    def measure(name: str, solve: Callable[[Sketch], object]) -> None:
        began_s = time.process_time()
        solve(drawn)
        times[name].append(1e3 * (time.process_time() - began_s))

    measure("from_start_ms", found.solve)
    for _ in range(_EDITS):
        hand = drawn.controls[-1]
        positions_m = hand.positions_m.copy()
        positions_m[len(positions_m) // 2] += [0.02, 0.02, 0.01]
        drawn = replace(drawn, controls=(*drawn.controls[:-1], replace(hand, positions_m=positions_m)))
        measure("first_picture_ms", lambda sketch: found.preview(sketch, SketchSettings(), sketch.frames.mean()))
        measure("whole_ms", found.solve)
    return {name: round(float(np.median(values)), 1) for name, values in times.items()}


def without_subject_of(whole: Database, path: Path, take: TestTake) -> Database:
    """Return the database without a take's subject, built if missing."""
    if path.exists():
        return open_database(path)
    subject = next(clip.subject for clip in whole.clips if clip.name == take.trial)
    kept = [(clip, 0, clip.stop - clip.start) for clip in whole.clips if clip.subject != subject]
    return write_subset(whole, path, kept)


def without_takes(whole: Database, path: Path, takes: tuple[TestTake, ...]) -> Database:
    """Return the database without the takes (or their end), built if missing."""
    if path.exists():
        return open_database(path)
    first = {take.trial: min(other.first for other in takes if other.trial == take.trial) for take in takes}
    first = {trial: share if trial == SPLIT else 0.0 for trial, share in first.items()}
    kept = [(clip, 0, int((clip.stop - clip.start) * first.get(clip.name, 1.0))) for clip in whole.clips]
    return write_subset(whole, path, [part for part in kept if part[2] > 0])


def true_motion(data: Path, take: TestTake) -> Motion:
    """Return a take at the rate of sketches, its middle if it is long."""
    motion = resampled(read_take(data, take), FPS)
    first = max(0, (motion.frames - _MOST_FRAMES) // 2)
    return sliced(motion, first, min(motion.frames, first + _MOST_FRAMES))


def sketch_of(truth: Motion, joints: tuple[str, ...], keys: str) -> Sketch:
    """Return a sketch of a motion: joints keyed every so many frames, or at "turns"."""
    positions = forward_kinematics(truth.skeleton, truth.rotations, truth.root_positions_m)[0]
    controls = []
    for joint in joints:
        path = positions[:, truth.skeleton.index(joint)]
        if keys == "turns":
            frames = _turning_frames(path, truth.frames // _TURNS_EVERY + 2)
        else:
            frames = np.unique(np.append(np.arange(0, truth.frames, int(keys)), truth.frames - 1))
        controls.append(Control(joint, frames.astype(np.float64), path[frames]))
    return Sketch(truth.name, truth.fps, tuple(controls))


def _turning_frames(path: Array, count: int) -> Array:
    """Return frames of keys, each where the curve of the others is furthest off."""
    frames, at = np.array([0, len(path) - 1]), np.arange(len(path), dtype=np.float64)
    while len(frames) < min(count, len(path)):
        away = np.linalg.norm(curve_positions(frames.astype(np.float64), path[frames], at) - path, axis=1)
        frames = np.unique(np.append(frames, np.argmax(away)))
    return frames


def errors_of(drawn: Sketch, motion: Motion, truth: Motion) -> dict[str, float]:
    """Return the errors of a motion, and how far it is from the keys at most."""
    errors = evaluate(motion, truth)
    row = {measure: round(float(errors[measure]), 3) for measure in _MEASURES}
    row |= {name: round(glide_cm_s(each), 3) for name, each in zip(_GLIDES, (motion, truth), strict=True)}
    return row | {"farthest_key_mm": round(1e3 * float(key_distances(drawn, motion)[0].max()), 3)}


def standing_feet(motion: Motion) -> Mask:
    """Return (F, 2) whether left and right toes stand: low and slow, as for skate."""
    positions = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0]
    toes = positions[:, [motion.skeleton.index(name) for name in TOES]]
    speeds_m_s = np.linalg.norm(np.gradient(toes, axis=0), axis=-1) * motion.fps
    lowest_m = minimum_filter1d(toes[..., 1], 2 * round(motion.fps) + 1, axis=0, mode="nearest")
    return (toes[..., 1] < lowest_m + _STANDING_M) & (speeds_m_s < _STANDING_M_S)


def glide_cm_s(motion: Motion) -> float:
    """Return the mean horizontal speed of a motion's toes while they are on the floor.

    Unlike skate it does not ask when the true foot stands: a step at another moment is none the worse.
    """
    positions = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0]
    toes = positions[:, [motion.skeleton.index(name) for name in TOES]]
    speeds = np.linalg.norm(np.diff(toes[..., [0, 2]], axis=0), axis=-1) * motion.fps
    heights = 0.5 * (toes[1:, :, 1] + toes[:-1, :, 1])
    lowest = minimum_filter1d(heights, 2 * round(motion.fps) + 1, axis=0, mode="nearest")
    return float(100.0 * speeds[heights < lowest + _LOW_M].mean())


def means_of(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the means over the takes by controls, keys and method."""
    result = []
    for group in dict.fromkeys((row["controls"], row["keys"], row["method"]) for row in rows):
        same = [row for row in rows if (row["controls"], row["keys"], row["method"]) == group]
        names = (*_MEASURES, *_GLIDES, "farthest_key_mm")
        means = {name: round(float(np.nanmean([row[name] for row in same])), 3) for name in names}
        result.append(dict(zip(("controls", "keys", "method"), group, strict=True)) | means)
    return result


def ratios_of(means: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return our mean joint distance as a share of the other methods'."""
    result = []
    for controls, keys in dict.fromkeys((row["controls"], row["keys"]) for row in means):
        error = {row["method"]: row["mpjpe_mm"] for row in means if (row["controls"], row["keys"]) == (controls, keys)}
        shares = {f"of {name}": round(error[OURS] / error[name], 3) for name in (IK, BEST, NEAREST)}
        result.append({"controls": controls, "keys": keys} | shares)
    return result


def _strip(title: str, truth: Motion, solved: Motion) -> list[Picture]:
    """Return pictures of frames between keys, evenly over a take."""
    errors = evaluate(solved, truth)["mpjpe_mm"]
    frames = np.linspace(8, truth.frames - 9, _DRAWN).astype(int)
    return [
        Picture(f"{title}, frame {f}: {errors:.0f} mm", *(sliced(m, f, f + 1) for m in (truth, solved))) for f in frames
    ]
