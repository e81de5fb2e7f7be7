"""Solver of sketches: a whole body from a few keyframed controls.

Keys bind. Between them the database's motion is kept as far as they allow: `retrieval` finds it, `base_motion` blends
it, `targets` bends it to the keys and holds standing feet, and each frame's pose is fitted to its targets with the
database's motion as prior. Joints without a control are free.
"""

from dataclasses import dataclass

import numpy as np

from ..body.motion import Motion
from ..body.skeleton import Skeleton, forward_kinematics
from ..database.store import Database, rotations_from_pose
from ..errors import SettingsError
from ..geometry.arrays import Array
from ..solver.subject_model import RootPose
from ..system.progress import Progress, no_progress
from .base_motion import BaseMotion, blended
from .body_fit import BodyFit
from .motion_library import TOES, MotionLibrary, standing_toes_m
from .reach import Reach
from .retrieval import Looks, Stretch, Windows, choose_windows, looks_of, nearest_windows, stretches_of
from .sketch import Control, Sketch
from .targets import (
    KEY_SIGMA_M,
    STAND_SIGMA_M,
    SWING_SIGMA_M,
    Targets,
    control_targets,
    held_foot,
    standing_runs,
)

MET_M = 0.005  # a key this near is met
_ANKLES = ("lfoot", "rfoot")
_SHORTEST_CONTACT_S = 0.1
_UNCHANGED_M = 1e-4  # or rad: a frame whose inputs change less is not solved again


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
class _Found:
    """Windows of a sketch's stretches, and the choice."""

    stretches: list[Stretch]
    candidates: list[Windows]
    chosen: list[int]


@dataclass(frozen=True)
class _Solved:
    """Inputs and poses of all frames, to solve again only what changes."""

    base: BaseMotion
    targets: Targets
    poses: Array
    root_rotations: Array
    root_positions_m: Array


class SketchSolver:
    """Solves sketches of one character, again and again while keys move.

    It keeps the database's motion on the character, and of the last sketch what a moved key leaves as it was.
    """

    def __init__(self, skeleton: Skeleton, database: Database) -> None:
        self._skeleton, self._database = skeleton, database
        self._library: MotionLibrary | None = None
        self._behaviours: tuple[str, ...] = ()
        self._fits: dict[tuple[str, ...], BodyFit] = {}
        self._found: _Found | None = None
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
        looks, stretches = looks_of(sketch, library, settings.follow), stretches_of(sketch)
        candidates = []
        for number, stretch in enumerate(stretches):
            progress(0.6 * number / len(stretches), "searching")
            candidates.append(nearest_windows(library, looks, stretch))
        chosen = choose_windows(library, stretches, candidates, settings.variation)
        self._found = _Found(stretches, candidates, chosen)
        return self._posed(sketch, settings, library, looks, progress)

    def preview(self, sketch: Sketch, settings: SketchSettings | None = None) -> SketchSolution:
        """Return a first picture of a moved key: the last motion, bent to the keys.

        Without a last solution of as many frames this is `solve`.
        """
        settings = settings or SketchSettings()
        library = self._library_for(sketch, settings)
        if self._found is None or self._solved is None or len(self._solved.poses) != len(sketch.frames):
            return self.solve(sketch, settings)
        return self._posed(sketch, settings, library, None, no_progress)

    def _library_for(self, sketch: Sketch, settings: SketchSettings) -> MotionLibrary:
        joints = [control.joint for control in sketch.controls]
        library = self._library
        if library is None or settings.behaviours != self._behaviours or not set(joints) <= set(library.joints):
            library = MotionLibrary(self._skeleton, self._database, joints, settings.behaviours)
            self._library, self._behaviours, self._found, self._solved = library, settings.behaviours, None, None
        return library

    def _posed(
        self, sketch: Sketch, settings: SketchSettings, library: MotionLibrary, looks: Looks | None, progress: Progress
    ) -> SketchSolution:
        found, last = self._found, self._solved
        assert found is not None
        if looks is not None or last is None:
            looks = looks or looks_of(sketch, library, settings.follow)
            times_s = (sketch.frames - sketch.frames[0]) / sketch.fps
            base = blended(library, looks, found.stretches, found.candidates, found.chosen, times_s)
        else:
            base = last.base
        targets = self._targets(sketch, settings, base)
        self._solved = solved = self._fitted(base, targets, progress)
        rotations = rotations_from_pose(solved.poses, self._database.zero_of(self._skeleton), solved.root_rotations)
        motion = Motion(sketch.name, sketch.fps, self._skeleton, rotations, solved.root_positions_m)
        distances, unmet = key_distances(sketch, motion)
        clips = [
            library.clip_of(windows.starts[index]).name
            for windows, index in zip(found.candidates, found.chosen, strict=True)
        ]
        return SketchSolution(motion, unmet, tuple(dict.fromkeys(clips)), distances)

    def _targets(self, sketch: Sketch, settings: SketchSettings, base: BaseMotion) -> Targets:
        """Return the targets of controls and feet in every frame, within reach."""
        frames, controls = sketch.frames, {control.joint: control for control in sketch.controls}
        names = sorted(controls, key=lambda name: (name != "root", name not in _ANKLES, name))
        joints = (*names, *(name for name in (*_ANKLES, *TOES) if name not in controls))
        indices = [self._skeleton.index(name) for name in joints]
        zero = self._database.zero_of(self._skeleton)
        rotations = rotations_from_pose(base.poses, zero, base.root_rotations)
        base_m = forward_kinematics(self._skeleton, rotations, base.root_positions_m)[0][:, indices]
        points = base_m.copy()
        sigmas = np.full(points.shape[:2], SWING_SIGMA_M)
        for column, name in enumerate(names):
            points[:, column] = control_targets(controls[name], frames, base_m[:, column], settings.follow)
            sigmas[:, column] = KEY_SIGMA_M
        moved = points[:, 0] - base_m[:, 0] if "root" in controls else np.zeros((len(frames), 3))
        for side, (ankle, toes) in enumerate(zip(_ANKLES, TOES, strict=True)):
            at, toe = joints.index(ankle), joints.index(toes)
            wanted = points[:, at] - base_m[:, at] if ankle in controls else moved
            keyed = np.zeros(len(frames), dtype=np.bool_)
            if ankle in controls:
                keyed[(controls[ankle].frames - frames[0]).astype(np.int64)] = True
            stands = np.zeros(len(frames), dtype=np.bool_)
            if settings.hold_feet:
                shortest = round(_SHORTEST_CONTACT_S * sketch.fps)
                floor_m = None if set(_ANKLES) & set(controls) else standing_toes_m(self._skeleton)
                contacts = standing_runs(base.standing[:, side], shortest)
                wanted, stands = held_foot(base_m[:, toe], wanted, contacts, keyed, floor_m)
            for column in {at, toe} - {joints.index(name) for name in set(controls) - {ankle}}:
                points[:, column] = base_m[:, column] + wanted
                sigmas[stands, column] = np.minimum(sigmas[stands, column], STAND_SIGMA_M)
        points, _ = Reach(self._skeleton, joints).limited(points)
        return Targets(joints, points, sigmas)

    def _fitted(self, base: BaseMotion, targets: Targets, progress: Progress) -> _Solved:
        """Return the poses fitted to targets; unchanged frames as they were solved."""
        if targets.joints not in self._fits:
            self._fits[targets.joints] = BodyFit(self._skeleton, self._database, targets.joints)
        fit, last = self._fits[targets.joints], self._solved
        count = len(base.poses)
        same = np.zeros(count, dtype=np.bool_)
        poses, turns, places = base.poses.copy(), base.root_rotations.copy(), base.root_positions_m.copy()
        if last is not None and last.targets.joints == targets.joints and len(last.poses) == count:
            close = np.abs(targets.points_m - last.targets.points_m).max(axis=(1, 2)) < _UNCHANGED_M
            close &= np.abs(base.poses - last.base.poses).max(axis=(1, 2)) < _UNCHANGED_M
            close &= np.abs(targets.sigmas_m - last.targets.sigmas_m).max(axis=1) < 1e-9
            same = close & (np.abs(base.root_positions_m - last.base.root_positions_m).max(axis=1) < _UNCHANGED_M)
            poses[same], turns[same] = last.poses[same], last.root_rotations[same]
            places[same] = last.root_positions_m[same]
        for frame in np.flatnonzero(~same).tolist():
            progress(0.6 + 0.4 * frame / count, "fitting")
            root = RootPose(base.root_rotations[frame], base.root_positions_m[frame])
            poses[frame], root = fit.fit(base.poses[frame], root, targets.points_m[frame], targets.sigmas_m[frame])
            turns[frame], places[frame] = root.rotation, root.position_m
        return _Solved(base, targets, poses, turns, places)


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
    distances, unmet = [], []
    for control in sketch.controls:
        at = (control.frames - sketch.frames[0]).astype(np.int64)
        away = np.linalg.norm(positions[at, skeleton.index(control.joint)] - control.positions_m, axis=1)
        distances.append(away)
        for frame, distance in zip(control.frames.tolist(), away.tolist(), strict=True):
            if distance > MET_M:
                reason = _reason(sketch, control, frame)
                unmet.append(UnmetKey(control.joint, int(frame), distance, reason))
    return np.concatenate(distances), tuple(sorted(unmet, key=lambda key: key.frame))


def _reason(sketch: Sketch, control: Control, frame: float) -> str:
    if np.sum(control.frames == frame) > 1:
        return "this control has several keys in this frame"
    return "the body does not bend so far"
