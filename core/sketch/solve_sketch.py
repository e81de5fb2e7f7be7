"""Solver of sketches: a whole body from a few keyframed controls.

Keys bind. Between them the database's motion is kept as far as they allow: `retrieval` finds it, `base_motion` blends
it, `targets` bends it to the keys and holds standing feet, and each frame's pose is fitted to its targets with the
database's motion as prior. Joints without a control are free.
"""

from dataclasses import dataclass, field

import numpy as np

from ..body.motion import Motion
from ..body.skeleton import Skeleton, forward_kinematics
from ..database.store import Database, rotations_from_pose
from ..errors import SettingsError
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray, Mask
from ..solver.subject_model import RootPose
from ..system.progress import Progress, no_progress
from .base_motion import BaseMotion, blended, corrected
from .joint_targets import carried_root, target_joints, targets_of
from .motion_library import MotionLibrary
from .pose_fit import PoseFit
from .reach import Reach
from .retrieval import Looks, Stretch, Windows, choose_windows, looks_of, nearest_windows, stretches_of
from .sketch_file import Control, Sketch, tilted, upright_from

MET_M = 0.005  # a key this near is met
_FAR_M = 0.2  # distance of the controls from the database's motion, from which the body may lie
_TOGETHER = 32  # frames fitted at once: enough that Python's share is small, few enough to be ended by an edit
_UNCHANGED = 1e-4  # m and rad: a frame is not solved again if its inputs change less


@dataclass(frozen=True)
class SketchSettings:
    """Settings of `solve_sketch`.

    Args:
        follow: 0 is exact at keys with the database's motion between them, 1 follows the curves between keys.
        behaviours: patterns of the behaviours (or names) of clips to draw from; empty: all.
        variation: 0 is the best explanation, 1 the next best, ...
        hold_feet: keep standing feet in place.
    """

    follow: float = 0.3
    behaviours: tuple[str, ...] = ()
    variation: int = 0
    hold_feet: bool = True

    def __post_init__(self) -> None:
        if not 0.0 <= self.follow <= 1.0:
            raise SettingsError(f"follow {self.follow:g} is out of range", advice="give 0 to 1")
        if self.variation < 0:
            raise SettingsError(f"variation {self.variation} is out of range", advice="give 0 or more")


@dataclass(frozen=True)
class UnmetKey:
    """A key that the body does not reach.

    Args:
        frame: of the sketch.
        distance_m: from the key to the joint.
        reason: in plain words.
    """

    joint: str
    frame: int
    distance_m: float
    reason: str


@dataclass(frozen=True)
class SketchSolution:
    """A solved sketch.

    Args:
        motion: at the sketch's rate; its frame 0 is `sketch.frames[0]`.
        unmet: keys that are not met, by frame.
        drawn_from: names of the clips used, in order of time.
        key_distances_m: (K,) of all keys, control by control.
    """

    motion: Motion
    unmet: tuple[UnmetKey, ...]
    drawn_from: tuple[str, ...]
    key_distances_m: Array


@dataclass(frozen=True)
class _Searched:
    """Windows of a stretch for the looks in it; by window and frame rate its motion."""

    looks: Looks
    windows: Windows
    motions: dict[tuple[int, float], BaseMotion] = field(default_factory=dict)


@dataclass(frozen=True)
class _FitInputs:
    """Targets of joints (M) in all frames (F), and the poses to start from."""

    joints: tuple[str, ...]
    points_m: Array
    sigmas_m: Array
    poses: Array
    root_rotations: Array
    root_positions_m: Array

    @property
    def arrays(self) -> tuple[Array, ...]:
        return self.points_m, self.sigmas_m, self.poses, self.root_rotations, self.root_positions_m

    def unchanged(self, other: "_FitInputs") -> Mask:
        """Return (F,) whether frames have the inputs of another's frames."""
        if other.joints != self.joints or len(other.poses) != len(self.poses):
            return np.zeros(len(self.poses), dtype=np.bool_)
        changes = [
            np.abs(now - then).reshape(len(now), -1).max(axis=1)
            for now, then in zip(self.arrays, other.arrays, strict=True)
        ]
        return np.asarray(np.max(changes, axis=0) < _UNCHANGED)

    def with_frames(self, which: Mask, other: "_FitInputs") -> "_FitInputs":
        """Return these inputs with some frames of another's."""
        arrays = [
            np.where(which.reshape(-1, *[1] * (now.ndim - 1)), then, now)
            for now, then in zip(self.arrays, other.arrays, strict=True)
        ]
        return _FitInputs(self.joints, *arrays)


@dataclass(frozen=True)
class _Solved:
    """Motion of the database, and for all frames inputs and results of the fit."""

    base: BaseMotion
    inputs: _FitInputs
    poses: Array
    root_rotations: Array
    root_positions_m: Array


class SketchSolver:
    """Solves sketches of one character, again and again while keys move.

    It keeps the database's motion on the character, and of the last sketch what a moved key leaves as it was.
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
            SettingsError: no clip has the wanted behaviour.
            DatabaseError: no clip is long enough.
        """
        settings = settings or SketchSettings()
        library = self._library_for(sketch, settings)
        base, off_m2 = self._drawn(sketch, settings, library, progress)
        tilt = upright_from(sketch)
        if off_m2 > _FAR_M**2 and tilt is not None:
            # nothing like it: a body that lies may move like one that stands
            upright, off_upright_m2 = self._drawn(tilted(sketch, tilt), settings, library, progress, is_tilted=True)
            if off_upright_m2 < 0.5 * off_m2:
                base = upright.turned(rot.conjugate(tilt))
        self._solved = solved = self._fitted(base, self._inputs(sketch, settings, base), progress)
        motion = self._motion(sketch, solved.poses, solved.root_rotations, solved.root_positions_m)
        distances, unmet = key_distances(sketch, motion)
        return SketchSolution(motion, unmet, base.drawn_from, distances)

    def preview(self, sketch: Sketch, settings: SketchSettings, frame: float) -> Motion | None:
        """Return a first picture of a moved key: a frame of the last motion, bent to it.

        None without a last solution of the same controls and as many frames.
        """
        last = self._solved
        if last is None or last.inputs.joints != target_joints(sketch) or len(last.poses) != len(sketch.frames):
            return None
        inputs = self._inputs(sketch, settings, last.base)
        at = int(np.clip(frame - sketch.frames[0], 0, len(last.poses) - 1))
        poses, roots = self._fit_frames(inputs, np.array([at]))
        return self._motion(sketch, poses, roots.rotation, roots.position_m)

    def _drawn(
        self,
        sketch: Sketch,
        settings: SketchSettings,
        library: MotionLibrary,
        progress: Progress,
        is_tilted: bool = False,
    ) -> tuple[BaseMotion, float]:
        """Return the database's motion for a sketch, and its distance from it, m2."""
        looks, stretches = looks_of(sketch, library, settings.follow), stretches_of(sketch)
        searched = []
        for number, stretch in enumerate(stretches):
            progress(0.6 * number / len(stretches), "searching")
            near = looks.between(stretch.before_s, stretch.after_s)
            known = self._searched.get((stretch, is_tilted))
            if known is None or not known.looks.same(near):
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
                known.motions[key] = corrected(library, known.looks, stretch, known.windows, index, inside)
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
        return _FitInputs(joints, targets.points_m, targets.sigmas_m, base.poses, *roots)

    def _fitted(self, base: BaseMotion, inputs: _FitInputs, progress: Progress) -> _Solved:
        """Return the poses fitted to targets; frames without a change as they were."""
        last, count = self._solved, len(inputs.poses)
        results = inputs.poses.copy(), inputs.root_rotations.copy(), inputs.root_positions_m.copy()
        same = np.zeros(count, dtype=np.bool_) if last is None else inputs.unchanged(last.inputs)
        if last is not None and same.any():
            inputs = inputs.with_frames(same, last.inputs)  # small changes must not add up
            for new, old in zip(results, (last.poses, last.root_rotations, last.root_positions_m), strict=True):
                new[same] = old[same]
        poses, turns, places = results
        changed = np.flatnonzero(~same)
        for first in range(0, len(changed), _TOGETHER):
            progress(0.6 + 0.4 * first / len(changed), "fitting")
            at = changed[first : first + _TOGETHER]
            poses[at], roots = self._fit_frames(inputs, at)
            turns[at], places[at] = roots.rotation, roots.position_m
        return _Solved(base, inputs, poses, turns, places)

    def _fit_frames(self, inputs: _FitInputs, at: IntArray) -> tuple[Array, RootPose]:
        """Return poses (N, 28, 3) and roots (N) of some frames."""
        if inputs.joints not in self._fits:
            self._fits[inputs.joints] = PoseFit(self._skeleton, self.database, inputs.joints)
        roots = RootPose(inputs.root_rotations[at], inputs.root_positions_m[at])
        return self._fits[inputs.joints].fit(inputs.poses[at], roots, inputs.points_m[at], inputs.sigmas_m[at])

    def _motion(self, sketch: Sketch, poses: Array, turns: Array, places: Array) -> Motion:
        """Return poses (F, 28, 3) and roots as a motion of the character."""
        rotations = rotations_from_pose(poses, self.database.reference_pose_of(self._skeleton), turns)
        return Motion(sketch.name, sketch.fps, self._skeleton, rotations, places)


def solve_sketch(
    sketch: Sketch,
    skeleton: Skeleton,
    database: Database,
    settings: SketchSettings | None = None,
    progress: Progress = no_progress,
) -> SketchSolution:
    """Return the motion of a whole body that meets a sketch's keys.

    To solve one sketch again after each edit, keep a `SketchSolver`.

    Args:
        skeleton: standard skeleton with the character's proportions.

    Raises:
        SettingsError: no clip has the wanted behaviour.
        DatabaseError: no clip is long enough.
    """
    return SketchSolver(skeleton, database).solve(sketch, settings, progress)


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
            if distance > MET_M:
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
            return f"it is {away_m:.2f} m from {other.joint}, the body reaches {most_m:.2f} m"
    return "the body does not bend so far"
