"""Sketches made from recorded takes: bodies solved from keys, by several methods.

The true paths of a few joints are keyed every 8, 16 or 32 frames at 30 per second, or where they turn most, and joined
by Blender's default curves. The takes are not in the database, but other takes of their subjects are. Five controls
with keys every 16 frames are also solved with the whole subject removed, and for fresh takes.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from perfanim.core.body.calibration_poses import standing
from perfanim.core.body.motion import Motion, resampled, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.body.skeleton import Skeleton, forward_kinematics
from perfanim.core.body.window_filters import smallest
from perfanim.core.database.store import Database
from perfanim.core.geometry import quaternion_components as c
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array
from perfanim.core.geometry.two_bone_ik import two_bone_directions
from perfanim.core.markers.marker_set import Marker, MarkerSet
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.subject import Subject
from perfanim.core.session.solve_take import solve_take
from perfanim.core.sketch.key_interpolation import curve_positions
from perfanim.core.sketch.motion_library import TOES
from perfanim.core.sketch.sketch_file import Control, Sketch
from perfanim.core.sketch.solve_sketch import SketchSettings, SketchSolver, key_distances
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.progress import no_progress

from .run import Run
from .scenarios import CMU, METHODS, SKETCHED, SKETCHED_FRESH, Take
from .tables import groups, mean

FPS = 30.0
CONTROLS = {"five": ("root", "lfoot", "rfoot", "lhand", "rhand"), "three": ("root", "lhand", "rhand")}
KEYS = ("8", "16", "32", "turns")
UNSEEN, FRESH = "five, unseen subject", "five, fresh takes"
OURS, IK, BEST, NEAREST = "sketch", "two-bone IK", "best on the curves", "nearest on the curves"
_EDITS = 5
_TURNS_EVERY = 16  # frames per key if paths are keyed where they turn most
_MOST_FRAMES = 240  # largest number of frames of a take
_MEASURES = (
    "deg_per_joint", "mpjpe_mm", "mpjpe_absolute_mm", "foot_skate_cm_s", "foot_skate_truth_cm_s", "jitter_ratio",
)  # fmt: skip
_GLIDES = ("glide_cm_s", "glide_truth_cm_s")
_LOW_M = 0.02  # toes on the floor are at most this far above their lowest position within a second
_UP = np.array([0.0, 1.0, 0.0])
_KNEE, _ELBOW = np.array([1.0, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0])  # knees bend forwards, elbows backwards
_SPINE = ("lowerback", "upperback", "thorax")
_MOST_TWIST_RAD = np.radians(60.0)  # largest twist of the chest relative to the hips
_BENT_RAD = 0.2  # bend of limbs without a control
_STRAIGHTEST = 0.995  # longest reach, as a share of the limb's length

Rows = list[dict[str, Any]]


def sketch(run: Run) -> dict[str, Any]:
    """Solve sketches of eight takes with every method, and write the table.

    Returns:
        rows (take, controls, keys, method, errors), means over the takes, ratios, times of edits, database, outputs.
    """
    whole = run.whole(CMU)
    database = run.without_takes(whole, "cmu-without-sketched", SKETCHED)
    rows: Rows = []
    edits: Rows = []
    for number, take in enumerate(SKETCHED):
        run.progress(0.2 + 0.8 * number / len(SKETCHED), take.title)
        truth = true_motion(run, take)
        for controls in CONTROLS:
            for keys in KEYS:
                rows += _rows(take, truth, database, controls, keys)
        edits.append({"take": take.title, "frames": truth.frames} | edit_times(database, truth))
        subject = next(clip.subject for clip in whole.clips if clip.name == take.trial)
        kept = [(clip, 0, clip.stop - clip.start) for clip in whole.clips if clip.subject != subject]
        unseen = run.subset(whole, f"cmu-without-sketched-and-{take.trial}", kept)
        rows += _rows(take, truth, unseen, UNSEEN, "16")
    fresh = run.without_takes(whole, "cmu-without-fresh", SKETCHED_FRESH)
    for take in SKETCHED_FRESH:
        run.progress(0.9, f"{take.title}: fresh")
        rows += _rows(take, true_motion(run, take), fresh, FRESH, "16")
    means = _means(rows)
    figures: dict[str, Any] = {"rows": rows, "means": means, "ratios": _ratios(means), "edits": edits}
    figures["database_frames"] = database.frames
    return run.write("sketch", figures, {"": rows, "means": means, "edits": edits})


def _rows(take: Take, truth: Motion, database: Database, controls: str, keys: str) -> Rows:
    """Solve a sketch with every method; return a row with the errors of each."""
    skeleton = truth.skeleton
    drawn = sketch_of(truth, CONTROLS.get(controls, CONTROLS["five"]), keys)
    motions = {
        OURS: SketchSolver(skeleton, database).solve(drawn).motion,
        IK: inverse_kinematics(drawn, skeleton),
        BEST: solved_as_markers(drawn, skeleton, database, METHODS["best"]),
        NEAREST: solved_as_markers(drawn, skeleton, database, METHODS["nearest"]),
    }
    facts = {"take": take.title, "controls": controls, "keys": keys}
    return [
        facts | {"method": name, "frames": truth.frames} | errors_of(drawn, motion, truth)
        for name, motion in motions.items()
    ]


def edit_times(database: Database, truth: Motion) -> dict[str, float]:
    """Return the time to solve a sketch, and to solve it again after a key moved, ms.

    A hand's key in the middle moves by 3 cm each time, and the middle frame is displayed; both are medians of processor
    time.
    """
    drawn = sketch_of(truth, CONTROLS["five"], "16")
    found = SketchSolver(truth.skeleton, database)
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


def true_motion(run: Run, take: Take) -> Motion:
    """Return a take at the rate of sketches, only its middle if it is long."""
    motion = resampled(run.read(take), FPS)
    first = max(0, (motion.frames - _MOST_FRAMES) // 2)
    return sliced(motion, first, min(motion.frames, first + _MOST_FRAMES))


def sketch_of(truth: Motion, joints: tuple[str, ...], keys: str) -> Sketch:
    """Return a sketch of a motion: joints keyed at a regular interval, or at "turns"."""
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
    """Return frames for keys, each where the curve through the others is furthest off."""
    frames, at = np.array([0, len(path) - 1]), np.arange(len(path), dtype=np.float64)
    while len(frames) < min(count, len(path)):
        away = np.linalg.norm(curve_positions(frames.astype(np.float64), path[frames], at) - path, axis=1)
        frames = np.unique(np.append(frames, np.argmax(away)))
    return frames


def errors_of(drawn: Sketch, motion: Motion, truth: Motion) -> dict[str, float]:
    """Return the errors of a motion, and its largest distance from the keys."""
    errors = evaluate(motion, truth)
    row = {measure: round(float(errors[measure]), 3) for measure in _MEASURES}
    row |= {name: round(_glide_cm_s(each), 3) for name, each in zip(_GLIDES, (motion, truth), strict=True)}
    return row | {"farthest_key_mm": round(1e3 * float(key_distances(drawn, motion)[0].max()), 3)}


def _glide_cm_s(motion: Motion) -> float:
    """Return the mean horizontal speed of a motion's toes while they are on the floor.

    Unlike skate, it ignores when the true foot is planted, so a step at another time is not penalised.
    """
    positions = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0]
    toes = positions[:, [motion.skeleton.index(name) for name in TOES]]
    speeds = np.linalg.norm(np.diff(toes[..., [0, 2]], axis=0), axis=-1) * motion.fps
    heights = 0.5 * (toes[1:, :, 1] + toes[:-1, :, 1])
    lowest = smallest(heights, round(motion.fps))
    return float(100.0 * speeds[heights < lowest + _LOW_M].mean())


def _means(rows: Rows) -> Rows:
    """Return the means over the takes by controls, keys and method."""
    keys, names = ("controls", "keys", "method"), (*_MEASURES, *_GLIDES, "farthest_key_mm")
    return [
        dict(zip(keys, group, strict=True)) | {name: mean(same, name, 3) for name in names}
        for group, same in groups(rows, *keys).items()
    ]


def _ratios(means: Rows) -> Rows:
    """Return our mean joint distance relative to the other methods'."""
    result = []
    for (controls, keys), same in groups(means, "controls", "keys").items():
        error = {row["method"]: row["mpjpe_mm"] for row in same}
        shares = {f"of {name}": round(error[OURS] / error[name], 3) for name in (IK, BEST, NEAREST)}
        result.append({"controls": controls, "keys": keys} | shares)
    return result


# ---- other methods that solve a body from the curves of a sketch


def solved_as_markers(sketch: Sketch, skeleton: Skeleton, database: Database, settings: SolveSettings) -> Motion:
    """Return the motion from a method that treats the curves as markers.

    All of them count as torso markers, because otherwise nothing would determine the root.
    """
    joints = tuple(control.joint for control in sketch.controls)
    markers = MarkerSet("controls", tuple(Marker(name, name, (0.0, 0.0, 0.0), torso=True) for name in joints))
    curves = np.stack([control.curve(sketch.frames) for control in sketch.controls], axis=1)
    take, subject = MarkerTake(sketch.name, sketch.fps, joints, curves), Subject(sketch.name, skeleton, markers)
    return solve_take(take, subject, database, settings, no_progress).motion


def inverse_kinematics(sketch: Sketch, skeleton: Skeleton) -> Motion:
    """Return the motion of a typical rig on the curves: two-bone limbs, a spline spine.

    Hips and chest turn about the vertical according to the positions of feet and hands, and the spine between them
    evenly; limbs without a control hang.
    """
    curves = {control.joint: control.curve(sketch.frames) for control in sketch.controls}
    chest = _yaws([curves["lhand"] - curves["rhand"]])
    hips = _yaws([curves[f"l{end}"] - curves[f"r{end}"] for end in ("foot", "hand") if f"l{end}" in curves])
    twist = np.clip((chest - hips + np.pi) % (2.0 * np.pi) - np.pi, -_MOST_TWIST_RAD, _MOST_TWIST_RAD)
    rotations = np.repeat(_bent(skeleton)[None], len(hips), axis=0)
    rotations[:, 0] = rot.from_rotation_vector(hips[:, None] * _UP)
    for name in _SPINE:
        rotations[:, skeleton.index(name)] = rot.from_rotation_vector(twist[:, None] / len(_SPINE) * _UP)
    for frame in range(len(rotations)):
        goals = {joint: points[frame] for joint, points in curves.items() if joint != "root"}
        _reach(skeleton, rotations[frame], curves["root"][frame], goals)
    return Motion(sketch.name, sketch.fps, skeleton, rotations, curves["root"])


def _bent(skeleton: Skeleton) -> Array:
    """Return rotations (J, 4) of a standing body, with the limbs slightly bent like a rig's."""
    rotations = standing(skeleton)
    _, world = forward_kinematics(skeleton, rotations, np.zeros(3))
    for name, axis in (("tibia", _KNEE), ("radius", _ELBOW)):
        for joint in (skeleton.index(side + name) for side in "lr"):
            local = rot.rotate(rot.conjugate(world[joint]), axis)
            rotations[joint] = rot.multiply(rotations[joint], rot.from_rotation_vector(_BENT_RAD * local))
    return rotations


def _yaws(pairs: list[Array]) -> Array:
    """Return yaws (F,) of a body whose left is along the sum of vectors."""
    planar = sum(pair[:, [0, 2]] / np.linalg.norm(pair[:, [0, 2]], axis=1, keepdims=True) for pair in pairs)
    return np.asarray(np.unwrap(np.arctan2(-planar[:, 1], planar[:, 0])))


def _reach(skeleton: Skeleton, rotations: Array, root_m: Array, goals: dict[str, Array]) -> None:
    """Turn the limbs in one frame's rotations (J, 4) so that they end at goals."""
    for joint, goal in goals.items():
        is_leg, end = joint[1:] == "foot", skeleton.index(joint)
        names = ("femur", "tibia") if is_leg else ("humerus", "radius")
        upper, lower = (skeleton.index(joint[0] + name) for name in names)
        positions, world = forward_kinematics(skeleton, rotations, root_m)
        bones = [positions[lower] - positions[upper], positions[end] - positions[lower]]
        vectors = (goal - positions[upper], np.cross(*bones), positions[end] - positions[upper])
        first_m, second_m = (float(np.linalg.norm(bone)) for bone in bones)
        reach, normal, unreached = map(c.components, vectors)
        ways = two_bone_directions(reach, normal, first_m, second_m, unreached, _STRAIGHTEST)
        turn = rot.between(vectors[2], vectors[0])  # of the whole limb, before its bones bend
        first, second = (
            rot.multiply(rot.between(rot.rotate(turn, bone), c.stacked(way)), rot.multiply(turn, world[joint]))
            for bone, way, joint in zip(bones, ways, (upper, lower), strict=True)
        )
        rotations[upper] = rot.multiply(rot.conjugate(world[skeleton.parents[upper]]), first)
        rotations[lower] = rot.multiply(rot.conjugate(first), second)
        if is_leg:
            rotations[end] = rot.multiply(rot.conjugate(second), world[end])
