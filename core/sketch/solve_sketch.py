"""Solver of sketches: a whole body from a few keyframed controls.

Keys are binding. Between them the database's motion is kept as far as they allow: `retrieval` finds it, `base_motion`
blends it, `joint_targets` bends it to the keys and keeps planted feet in place, and each frame's pose is fitted to its
targets with the database's motion as prior. Joints without a control are free.
"""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from ..body.motion import Motion, sliced
from ..body.skeleton import Skeleton, forward_kinematics
from ..database.store import Database, rotations_from_pose
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray, Mask
from ..solver.subject_model import RootPose
from ..system.progress import Progress, no_progress
from ..system.schema import About, check_ranges
from .above_floor import above_floor
from .base_motion import BaseMotion, blended, corrected
from .joint_targets import carried_root, is_level, target_joints, targets_of
from .motion_library import MotionLibrary
from .pose_fit import PoseFit
from .reach import Reach
from .retrieval import Samples, Stretch, Windows, choose_windows, nearest_windows, samples_of, stretches_of
from .sketch_file import Control, Sketch, tilted, upright_from


@dataclass(frozen=True)
class SolverLimits:
    """Limits of the solver."""

    met_m: float = 0.005  # largest distance from a key that is met
    far_m: float = 0.2  # distance of the controls from the database's motion above which a lying body is tried upright
    together: int = 32  # frames fitted between two points at which an edit can interrupt the work
    unchanged: float = 1e-4  # m, rad; frames whose inputs change less are not solved again


LIMITS = SolverLimits()


@dataclass(frozen=True)
class SketchSettings:
    """Settings of `SketchSolver`."""

    follow: Annotated[
        float, About("0 keeps the database's motion between keys, 1 follows the curves", "", 0.0, 1.0)
    ] = 0.3
    behaviours: Annotated[
        tuple[str, ...], About("patterns of behaviours or names of the clips to draw from; empty for all")
    ] = ()
    variation: Annotated[int, About("0 is the best explanation, 1 the next best, and so on", "", 0)] = 0
    hold_feet: Annotated[bool, About("whether planted feet are kept in place")] = True

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class UnmetKey:
    """A key that the body does not reach.

    Args:
        frame: Frame of the sketch.
        distance_m: Distance from the key to the joint.
        reason: Reason in plain words.
    """

    joint: str
    frame: int
    distance_m: float
    reason: str


@dataclass(frozen=True)
class SketchSolution:
    """A solved sketch.

    Args:
        motion: Motion at the sketch's rate; its frame 0 is `sketch.frames[0]`.
        unmet: Keys that are not met, by frame.
        drawn_from: Names of the clips used, in order of time.
        key_distances_m: Distances (K,) of all keys, control by control.
    """

    motion: Motion
    unmet: tuple[UnmetKey, ...]
    drawn_from: tuple[str, ...]
    key_distances_m: Array


@dataclass(frozen=True)
class _Searched:
    """Windows found for the samples of a stretch, and their motion by window and frame rate."""

    samples: Samples
    windows: Windows
    motions: dict[tuple[int, float], BaseMotion] = field(default_factory=dict)


@dataclass(frozen=True)
class _FitInputs:
    """Inputs of the fit for F frames and M joints.

    Args:
        joints: Names (M).
        arrays: Targets (F, M, 3), their sigmas (F, M), start poses (F, 28, 3), root rotations (F, 4) and positions
            (F, 3).
    """

    joints: tuple[str, ...]
    arrays: tuple[Array, ...]

    def unchanged(self, other: "_FitInputs") -> Mask:
        """Return a mask (F,) of the frames with unchanged inputs."""
        frames = len(self.arrays[0])
        if other.joints != self.joints or len(other.arrays[0]) != frames:
            return np.zeros(frames, dtype=np.bool_)
        pairs = zip(self.arrays, other.arrays, strict=True)
        changes = [np.abs(now - then).reshape(frames, -1).max(axis=1) for now, then in pairs]
        return np.asarray(np.max(changes, axis=0) < LIMITS.unchanged)


@dataclass(frozen=True)
class _Solved:
    """The database's motion, with inputs and results (poses, root rotations and positions) of the fit."""

    base: BaseMotion
    inputs: _FitInputs
    results: tuple[Array, ...]


class SketchSolver:
    """Solves sketches of one character repeatedly while keys move.

    The solver keeps the database's motion on the character, and the parts of the last solution that a moved key does
    not affect.
    """

    def __init__(self, skeleton: Skeleton, database: Database) -> None:
        self._skeleton, self.database = skeleton, database
        self._library: MotionLibrary | None = None
        self._behaviours: tuple[str, ...] = ()
        self._fits: dict[tuple[str, ...], PoseFit] = {}
        self._searched: dict[tuple[Stretch, bool], _Searched] = {}
        self._solved: _Solved | None = None

    def solve(
        self, sketch: Sketch, settings: SketchSettings | None = None, progress: Progress = no_progress
    ) -> SketchSolution:
        """Return the whole solution of a sketch.

        Raises:
            SettingsError: No clip has the requested behaviour.
            DatabaseError: No clip is long enough.
        """
        settings = settings or SketchSettings()
        library = self._library_for(sketch, settings)
        base, off_m2 = self._drawn(sketch, settings, library, progress)
        tilt = upright_from(sketch)
        if off_m2 > LIMITS.far_m**2 and tilt is not None:
            # the database has nothing similar: a lying body may move like a standing one
            upright, off_upright_m2 = self._drawn(tilted(sketch, tilt), settings, library, progress, is_tilted=True)
            if off_upright_m2 < 0.5 * off_m2:
                base = upright.turned(rot.conjugate(tilt))
        self._solved = solved = self._fitted(base, self._inputs(sketch, settings, base), progress)
        motion = self._motion(sketch, *solved.results)
        distances, unmet = key_distances(sketch, motion)
        return SketchSolution(motion, unmet, base.drawn_from, distances)

    def preview(self, sketch: Sketch, settings: SketchSettings, frame: float) -> Motion | None:
        """Return a preview for a moved key: one frame of the last motion, bent to the key.

        The result is None unless the last solution has the same controls and number of frames.
        """
        last = self._solved
        if last is None or last.inputs.joints != target_joints(sketch) or len(last.results[0]) != len(sketch.frames):
            return None
        inputs = self._inputs(sketch, settings, last.base)
        at = int(np.clip(frame - sketch.frames[0], 0, len(sketch.frames) - 1))
        results = tuple(array.copy() for array in last.results)
        for result, part in zip(results, self._fit_frames(inputs, np.array([at])), strict=True):
            result[at] = part[0]
        return sliced(self._motion(sketch, *results), at, at + 1)

    def _drawn(
        self,
        sketch: Sketch,
        settings: SketchSettings,
        library: MotionLibrary,
        progress: Progress,
        is_tilted: bool = False,
    ) -> tuple[BaseMotion, float]:
        """Return the database's motion for a sketch, and its mean squared distance from the sketch, m2."""
        samples, stretches = samples_of(sketch, library, settings.follow), stretches_of(sketch)
        searched = []
        for number, stretch in enumerate(stretches):
            progress(0.6 * number / len(stretches), "searching")
            near = samples.between(stretch.before_s, stretch.after_s)
            known = self._searched.get((stretch, is_tilted))
            if known is None or not known.samples.same(near):
                known = _Searched(near, nearest_windows(library, near, stretch))
            searched.append(known)
        kept = {key: each for key, each in self._searched.items() if key[1] != is_tilted}
        self._searched = kept | {(stretch, is_tilted): s for stretch, s in zip(stretches, searched, strict=True)}
        chosen = choose_windows(library, stretches, [each.windows for each in searched], settings.variation)
        times_s, parts = (sketch.frames - sketch.frames[0]) / sketch.fps, []
        for stretch, known, index in zip(stretches, searched, chosen, strict=True):
            key = index, sketch.fps
            if key not in known.motions:
                inside = times_s[stretch.shows(times_s)]
                known.motions[key] = corrected(library, known.samples, stretch, known.windows, index, inside)
            parts.append((stretch, known.motions[key]))
        off_m2 = float(np.mean([known.windows.costs[index] for known, index in zip(searched, chosen, strict=True)]))
        return blended(parts, times_s), off_m2

    def _library_for(self, sketch: Sketch, settings: SketchSettings) -> MotionLibrary:
        joints = [control.joint for control in sketch.controls]
        library = self._library
        if library is None or settings.behaviours != self._behaviours or not set(joints) <= set(library.joints):
            library = MotionLibrary(self._skeleton, self.database, joints, settings.behaviours)
            self._library, self._behaviours, self._searched = library, settings.behaviours, {}
        return library

    def _inputs(self, sketch: Sketch, settings: SketchSettings, base: BaseMotion) -> _FitInputs:
        """Return the targets that bend the database's motion to the keys."""
        skeleton, joints = self._skeleton, target_joints(sketch)
        rotations = rotations_from_pose(base.poses, self.database.reference_pose_of(skeleton), base.root_rotations)
        base_m = forward_kinematics(skeleton, rotations, base.root_positions_m)[0]
        base_m = base_m[:, [skeleton.index(name) for name in joints]]
        targets = targets_of(sketch, skeleton, base_m, base.standing, settings.follow, settings.hold_feet)
        roots = carried_root(targets, len(sketch.controls), base_m, base.root_rotations, base.root_positions_m)
        return _FitInputs(joints, (targets.points_m, targets.sigmas_m, base.poses, *roots))

    def _fitted(self, base: BaseMotion, inputs: _FitInputs, progress: Progress) -> _Solved:
        """Return the fit of all frames; unchanged frames keep their result."""
        last, count = self._solved, len(base.poses)
        results = tuple(array.copy() for array in inputs.arrays[2:])
        same = np.zeros(count, dtype=np.bool_) if last is None else inputs.unchanged(last.inputs)
        if last is not None and same.any():
            arrays = tuple(array.copy() for array in inputs.arrays)
            pairs = zip((*arrays, *results), (*last.inputs.arrays, *last.results), strict=True)
            for now, then in pairs:
                now[same] = then[same]  # keep the inputs too: small changes must not add up unnoticed
            inputs = _FitInputs(inputs.joints, arrays)
        changed = np.flatnonzero(~same)
        for first in range(0, len(changed), LIMITS.together):
            progress(0.6 + 0.4 * first / len(changed), "fitting")
            at = changed[first : first + LIMITS.together]
            for result, part in zip(results, self._fit_frames(inputs, at), strict=True):
                result[at] = part
        return _Solved(base, inputs, results)

    def _fit_frames(self, inputs: _FitInputs, at: IntArray) -> tuple[Array, Array, Array]:
        """Return poses (N, 28, 3), root rotations (N, 4) and positions (N, 3) of some frames."""
        if inputs.joints not in self._fits:
            self._fits[inputs.joints] = PoseFit(self._skeleton, self.database, inputs.joints)
        points_m, sigmas_m, poses, turns, places = (array[at] for array in inputs.arrays)
        fitted, roots = self._fits[inputs.joints].fit(poses, RootPose(turns, places), points_m, sigmas_m)
        return fitted, roots.rotation, roots.position_m

    def _motion(self, sketch: Sketch, poses: Array, turns: Array, places: Array) -> Motion:
        """Return poses (F, 28, 3) and roots as a motion of the character, with its feet above the floor."""
        rotations = rotations_from_pose(poses, self.database.reference_pose_of(self._skeleton), turns)
        motion = Motion(sketch.name, sketch.fps, self._skeleton, rotations, places)
        if not is_level(sketch, self._skeleton):
            return motion
        return above_floor(motion, *(_keyed_feet(sketch, joint) for joint in ("foot", "toes")))


def _keyed_feet(sketch: Sketch, joint: str) -> Mask:
    """Return a mask (F, 2) of the frames with a key of this joint of the left and the right foot."""
    keyed = np.zeros((len(sketch.frames), 2), dtype=np.bool_)
    for control in sketch.controls:
        if control.joint[1:] == joint:
            keyed[(control.frames - sketch.frames[0]).astype(np.int64), "lr".index(control.joint[0])] = True
    return keyed


def key_distances(sketch: Sketch, motion: Motion) -> tuple[Array, tuple[UnmetKey, ...]]:
    """Return the distances (K,) of all keys, control by control, and the unmet ones."""
    skeleton = motion.skeleton
    positions = forward_kinematics(skeleton, motion.rotations, motion.root_positions_m)[0]
    reach = Reach(skeleton, tuple(control.joint for control in sketch.controls))
    distances, unmet = [], []
    for control in sketch.controls:
        at = (control.frames - sketch.frames[0]).astype(np.int64)
        ways = positions[at, skeleton.index(control.joint)] - control.positions_m
        away = np.linalg.norm(ways[:, [0, 2]] if control.height_is_free else ways, axis=1)
        distances.append(away)
        for frame, distance in zip(control.frames.tolist(), away.tolist(), strict=True):
            if distance > LIMITS.met_m:
                reason = _reason(sketch, control, frame, reach)
                unmet.append(UnmetKey(control.joint, int(frame), distance, reason))
    return np.concatenate(distances), tuple(sorted(unmet, key=lambda key: key.frame))


def _reason(sketch: Sketch, control: Control, frame: float, reach: Reach) -> str:
    if np.sum(control.frames == frame) > 1:
        return "this control has several keys in this frame"
    at = np.array([frame])
    place = control.curve(at)[0]
    for other in sketch.controls:
        if not other.frames[0] <= frame <= other.frames[-1]:
            continue
        away_m, most_m = float(np.linalg.norm(other.curve(at)[0] - place)), reach.between(control.joint, other.joint)
        if away_m > most_m:
            return f"it is {away_m:.2f} m from {other.joint}, but the body reaches only {most_m:.2f} m"
    return "the body does not bend that far"
