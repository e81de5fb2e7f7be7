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
from ..geometry import rotations as rot
from ..geometry.arrays import Array
from ..solver.subject_model import RootPose
from ..system.progress import Progress, no_progress
from .base_motion import BaseMotion, blended
from .body_fit import BodyFit
from .motion_library import MotionLibrary
from .reach import Reach
from .retrieval import Looks, Stretch, Windows, choose_windows, looks_of, nearest_windows, stretches_of
from .sketch import Control, Sketch, tilted, upright_from
from .targets import Targets, carried_root, target_joints, targets_of

MET_M = 0.005  # a key this near is met
_FAR_M = 0.2  # distance of the controls from the database's motion, from which the body may lie
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
class _Solved:
    """Inputs and poses of all frames, kept for the next solution."""

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
        self._skeleton, self.database = skeleton, database
        self._library: MotionLibrary | None = None
        self._behaviours: tuple[str, ...] = ()
        self._fits: dict[tuple[str, ...], BodyFit] = {}
        self._searched: dict[Stretch, tuple[Looks, Windows]] = {}
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
            upright, off_upright_m2 = self._drawn(tilted(sketch, tilt), settings, library, progress)
            if off_upright_m2 < 0.5 * off_m2:
                base = upright.turned(rot.conjugate(tilt))
        return self._bent(sketch, settings, base, progress)

    def _drawn(
        self, sketch: Sketch, settings: SketchSettings, library: MotionLibrary, progress: Progress
    ) -> tuple[BaseMotion, float]:
        """Return the database's motion for a sketch, and its distance from it, m2."""
        looks, stretches = looks_of(sketch, library, settings.follow), stretches_of(sketch)
        candidates, searched = [], {}
        for number, stretch in enumerate(stretches):
            progress(0.6 * number / len(stretches), "searching")
            near = looks.between(stretch.before_s, stretch.after_s)
            before = self._searched.get(stretch)
            if before is None or not before[0].same(near):
                before = near, nearest_windows(library, near, stretch)
            searched[stretch] = before
            candidates.append(before[1])
        self._searched = searched
        chosen = choose_windows(library, stretches, candidates, settings.variation)
        times_s = (sketch.frames - sketch.frames[0]) / sketch.fps
        picks = list(zip(stretches, candidates, chosen, strict=True))
        off_m2 = float(np.mean([windows.costs[index] for _, windows, index in picks]))
        return blended(library, looks, picks, times_s), off_m2

    def preview(self, sketch: Sketch, settings: SketchSettings | None = None) -> SketchSolution:
        """Return a first picture of a moved key: the last motion, bent to the keys.

        Without a last solution of the same controls and as many frames this is `solve`.
        """
        settings, last = settings or SketchSettings(), self._solved
        if last is None or last.targets.joints != target_joints(sketch) or len(last.poses) != len(sketch.frames):
            return self.solve(sketch, settings)
        return self._bent(sketch, settings, last.base, no_progress)

    def _library_for(self, sketch: Sketch, settings: SketchSettings) -> MotionLibrary:
        joints = [control.joint for control in sketch.controls]
        library = self._library
        if library is None or settings.behaviours != self._behaviours or not set(joints) <= set(library.joints):
            library = MotionLibrary(self._skeleton, self.database, joints, settings.behaviours)
            self._library, self._behaviours, self._searched = library, settings.behaviours, {}
        return library

    def _bent(self, sketch: Sketch, settings: SketchSettings, base: BaseMotion, progress: Progress) -> SketchSolution:
        """Return the database's motion bent to the keys."""
        skeleton, zero, joints = self._skeleton, self.database.zero_of(self._skeleton), target_joints(sketch)
        rotations = rotations_from_pose(base.poses, zero, base.root_rotations)
        base_m = forward_kinematics(skeleton, rotations, base.root_positions_m)[0]
        base_m = base_m[:, [skeleton.index(name) for name in joints]]
        targets = targets_of(sketch, skeleton, base_m, base.standing, settings.follow, settings.hold_feet)
        roots = carried_root(targets, len(sketch.controls), base_m, base.root_rotations, base.root_positions_m)
        self._solved = solved = self._fitted(base, roots, targets, progress)
        rotations = rotations_from_pose(solved.poses, zero, solved.root_rotations)
        motion = Motion(sketch.name, sketch.fps, skeleton, rotations, solved.root_positions_m)
        distances, unmet = key_distances(sketch, motion)
        return SketchSolution(motion, unmet, base.drawn_from, distances)

    def _fitted(self, base: BaseMotion, roots: tuple[Array, Array], targets: Targets, progress: Progress) -> _Solved:
        """Return the poses fitted to targets; frames without a change as they were."""
        if targets.joints not in self._fits:
            self._fits[targets.joints] = BodyFit(self._skeleton, self.database, targets.joints)
        fit, last, count = self._fits[targets.joints], self._solved, len(base.poses)
        poses, turns, places = base.poses.copy(), *(values.copy() for values in roots)
        same = np.zeros(count, dtype=np.bool_)
        if last is not None and last.targets.joints == targets.joints and len(last.poses) == count:
            pairs = (
                (targets.points_m, last.targets.points_m), (targets.sigmas_m, last.targets.sigmas_m),
                (base.poses, last.base.poses), (base.root_rotations, last.base.root_rotations),
                (base.root_positions_m, last.base.root_positions_m),
            )  # fmt: skip
            changes = [np.abs(now - then).reshape(count, -1).max(axis=1) for now, then in pairs]
            same = np.max(changes, axis=0) < _UNCHANGED
            poses[same], turns[same] = last.poses[same], last.root_rotations[same]
            places[same] = last.root_positions_m[same]
        for frame in np.flatnonzero(~same).tolist():
            progress(0.6 + 0.4 * frame / count, "fitting")
            root = RootPose(turns[frame], places[frame])
            poses[frame], root = fit.fit(poses[frame], root, targets.points_m[frame], targets.sigmas_m[frame])
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
    reach = Reach(skeleton, tuple(control.joint for control in sketch.controls))
    distances, unmet = [], []
    for control in sketch.controls:
        at = (control.frames - sketch.frames[0]).astype(np.int64)
        away = np.linalg.norm(positions[at, skeleton.index(control.joint)] - control.positions_m, axis=1)
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
