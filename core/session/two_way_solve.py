"""Solving recorded takes in both directions of time.

Live, a pose depends on earlier frames only. A recorded take is also solved backwards, with the database's motion
reversed in time. The errors of the two solutions differ, so the solutions are averaged, with each part of the body
weighted by its expected errors, and low-pass filtered. This determines whatever the markers do not. A marker that
leaves its place on that body for a moment is wild: it is left out, and the take is solved again. The poses are then
fitted to the smoothed markers, whose gaps are filled by means of the average, and the remaining jitter is filtered out.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..body.clock import PAUSE_S, Clock, clock_of
from ..body.motion import Motion
from ..body.pose_notes import NoteKind, PoseNote
from ..body.scene_pose import PerformerPose
from ..body.skeleton import forward_kinematics
from ..database.store import pose_from_rotations
from ..formats.markers.recorded_take import take_of_poses
from ..geometry.arrays import Array, Mask, runs
from ..geometry.camera import Camera
from ..markers.filtering import smooth_poses
from ..markers.gap_filling import fill_gaps
from ..markers.marker_smoothing import smooth_markers
from ..markers.source_noise import SourceNoise, noise_of
from ..solver.observation import Observation
from ..solver.pose_solver import PoseSolver
from ..solver.subject_model import RootPose
from .leaving_markers import leaves_body
from .trajectories import TOGETHER, Trajectory, blended, live_trajectory, solved_trajectory

_SHORTEST = 12  # length of the shortest stretch that is solved again, frames
_CUT_M_S = 9.0  # median speed of the markers above which there is a cut: bodies are slower
_SMOOTH_HZ = 8.0  # cut-off for the averaged trajectories
# Highest cut-off for the fitted poses, which still contain marker noise, as a share of the frame rate.
_CALM_SHARE = 0.27
_CALM_STEP_HZ = 0.25  # step between the cut-offs that are tried
_AGAIN_S = 1.0  # time before and after a suspected marker for which a stretch is solved again: its history is forgotten


class TwoWaySolver:
    """Solves recorded stretches of one performer in both directions of time.

    Args:
        solver: Solver of the live poses, with the method "best".
        cameras: Cameras to which the poses' `single_cameras` refer.
    """

    def __init__(self, solver: PoseSolver, cameras: tuple[Camera, ...]) -> None:
        self._solver, self._cameras = solver, cameras
        self._backward = solver.backwards()
        self._source = noise_of(solver.subject.subject.marker_set.points)

    def solve(self, poses: Sequence[PerformerPose], progress: Callable[[float], None]) -> list[PerformerPose]:
        """Return a performer's poses, solved again in all stretches that are long enough; others are unchanged."""
        result = list(poses)
        for start, stop in _stretches(poses):
            share, done = (stop - start) / len(poses), start / len(poses)
            result[start:stop] = self._solve(poses[start:stop], lambda part: progress(done + share * part))  # noqa: B023
        return _started(result)

    def _solve(self, poses: Sequence[PerformerPose], progress: Callable[[float], None]) -> list[PerformerPose]:
        clock = _clock(poses)
        observations = self._observations(poses)
        backward = solved_trajectory(self._backward, poses, observations, lambda share: progress(0.5 * share), -1)
        trajectory = blended((live_trajectory(poses), backward), clock.mean_fps)
        kept, trajectory = self._without_wild(poses, trajectory, clock, lambda share: progress(0.5 + 0.5 * share))
        if kept is not poses:
            observations = self._observations(kept)
        progress(1.0)
        return self._calm(self._fitted(kept, trajectory, clock, observations), clock)

    def _without_wild(
        self, poses: Sequence[PerformerPose], trajectory: Trajectory, clock: Clock, progress: Callable[[float], None]
    ) -> tuple[Sequence[PerformerPose], Trajectory]:
        """Return poses and trajectory without wild markers; both as they are if there is none.

        The body may have followed wild markers, and then true ones seem wild. Around suspected ones it is solved again,
        in both directions, without any of them, and decides.
        """
        suspected = self._off_body(poses, trajectory, clock, judged=False)
        texts, parts = np.array(self._solver.subject.subject.marker_set.texts), _around(suspected, clock.fps)
        for number, part in enumerate(parts):

            def report(share: float, number: int = number) -> None:
                progress((number + share) / len(parts))

            left = [_without(*of) for of in zip(poses[part], suspected[part], strict=True)]
            other, own_clock = self._solved_again(left, report), _clock(left)
            wild = suspected[part] & self._off_body(poses[part], other, own_clock, judged=True)
            if wild.any():
                trajectory = trajectory.with_part(part, other)
                left = [
                    _noted(_without(pose, left_out), texts[left_out])
                    for pose, left_out in zip(poses[part], wild, strict=True)
                ]
                poses = [*poses[: part.start], *left, *poses[part.stop :]]
        return poses, trajectory

    def _solved_again(self, poses: Sequence[PerformerPose], progress: Callable[[float], None]) -> Trajectory:
        """Return poses solved in both directions, without the live solution."""
        observations = self._observations(poses)
        forward = solved_trajectory(self._solver, poses, observations, lambda share: progress(0.5 * share), 1)
        backward = solved_trajectory(self._backward, poses, observations, lambda share: progress(0.5 + 0.5 * share), -1)
        return blended((forward, backward), _clock(poses).mean_fps)

    def _observations(self, poses: Sequence[PerformerPose]) -> list[Observation]:
        """Return the markers of poses, smoothed in both directions of time."""
        return _smoothed(poses, [self._observation(pose) for pose in poses], self._source)

    def _off_body(self, poses: Sequence[PerformerPose], trajectory: Trajectory, clock: Clock, judged: bool) -> Mask:
        """Return a mask (F, M) of the markers that leave their places on a moving body for a moment."""
        motion = self._low_passed(trajectory.rotations, trajectory.root_positions_m, clock, _SMOOTH_HZ)
        model = self._solver.subject
        vectors = pose_from_rotations(motion.rotations, model.mean_rotations)
        worn_m = model.markers(vectors, RootPose(motion.rotations[:, 0], motion.root_positions_m))
        seen_m = np.array([pose.observed_m for pose in poses])
        return leaves_body(seen_m, worn_m, clock.fps, self._source, judged)

    def _observation(self, pose: PerformerPose) -> Observation:
        """Return the markers of a pose as an observation, which is empty if they do not fit the body."""
        if _has_note(pose, NoteKind.HELD):
            return Observation.of_points(np.full(pose.observed_m.shape, np.nan))
        return Observation(pose.observed_m, pose.single_cameras, pose.single_points, self._cameras)

    def _fitted(
        self, poses: Sequence[PerformerPose], trajectory: Trajectory, clock: Clock, observations: Sequence[Observation]
    ) -> list[PerformerPose]:
        """Return poses fitted to the markers, starting from the trajectory, which also fills the markers' gaps."""
        model = self._solver.subject
        motion = self._low_passed(trajectory.rotations, trajectory.root_positions_m, clock, _SMOOTH_HZ)
        marker_set = model.subject.marker_set
        take = take_of_poses(poses, marker_set.names, "", clock.fps)
        seen = np.array([observation.points_m for observation in observations])
        filled = fill_gaps(replace(take, positions_m=seen), marker_set, motion).positions_m
        observed = [
            replace(each, points_m=np.where(each.single[:, None], np.nan, points_m))
            for each, points_m in zip(observations, filled, strict=True)
        ]
        fitted: list[PerformerPose] = []
        for first in range(0, len(poses), TOGETHER):
            part = slice(first, first + TOGETHER)
            starts = pose_from_rotations(motion.rotations[part], model.mean_rotations)
            roots = RootPose(motion.rotations[part, 0], motion.root_positions_m[part])
            vectors, roots = self._solver.best.fit_about(starts.reshape(len(starts), -1), roots, observed[part])
            vectors = vectors.reshape(starts.shape)
            rotations, markers_m = model.rotations(vectors, roots), model.markers(vectors, roots)
            away_m = np.array([pose.observed_m for pose in poses[part]]) - markers_m
            squares = np.add.reduce(away_m * away_m, axis=-1)
            for row, pose in enumerate(poses[part]):
                renewed = pose.with_part_errors(trajectory.errors_deg[first + row])
                if _has_note(pose, NoteKind.LABELLED_LATER):  # no more certain than where its labels were found
                    renewed = replace(renewed, confidence=min(renewed.confidence, pose.confidence))
                fitted.append(
                    replace(
                        renewed,
                        rotations=rotations[row],
                        root_position_m=roots.position_m[row],
                        markers_m=markers_m[row],
                        marker_rms_m=_root_mean(squares[row], pose.marker_rms_m),
                        joint_errors_deg=trajectory.joint_errors_deg[first + row],
                    )
                )
        return fitted

    def _calm(self, poses: list[PerformerPose], clock: Clock) -> list[PerformerPose]:
        """Return the poses of a stretch without jitter that is faster than this body's motion.

        The cut-off is lowered as long as no joint moves by more than could be told from the source's lasting errors.
        """
        rotations, roots_m = (
            np.array([getattr(pose, of) for pose in poses]) for of in ("rotations", "root_position_m")
        )
        cutoff_hz = min(self._source.calm_hz, _CALM_SHARE * clock.fps)
        motion = self._low_passed(rotations, roots_m, clock, cutoff_hz)
        moving_m = _joints_m(motion)
        while (cutoff_hz := cutoff_hz - _CALM_STEP_HZ) >= self._source.calmest_hz:
            calmer = self._low_passed(rotations, roots_m, clock, cutoff_hz)
            changes_m = np.sqrt(np.mean(np.sum((_joints_m(calmer) - moving_m) ** 2, axis=-1), axis=0))
            if changes_m.max() > self._source.calmed_m:
                break
            motion = calmer
        shown = zip(poses, motion.rotations, motion.root_positions_m, strict=True)
        return [replace(pose, rotations=turns, root_position_m=root_m) for pose, turns, root_m in shown]

    def _low_passed(self, rotations: Array, root_positions_m: Array, clock: Clock, cutoff_hz: float) -> Motion:
        """Return poses low-pass filtered by their times; unchanged if the cut-off is above half the frame rate."""
        poses = rotations, root_positions_m
        if clock.fps > 2.0 * cutoff_hz:
            poses = smooth_poses(clock, *poses, cutoff_hz)
        return Motion("", clock.fps, self._solver.subject.skeleton, *poses)


def _without(pose: PerformerPose, markers: Mask) -> PerformerPose:
    """Return a pose without some of its observed markers (M,)."""
    return replace(pose, observed_m=np.where(markers[:, None], np.nan, pose.observed_m))


def _noted(pose: PerformerPose, jumped: NDArray[np.str_]) -> PerformerPose:
    return replace(pose, notes=(*pose.notes, PoseNote.jumped(jumped))) if len(jumped) else pose


def _joints_m(motion: Motion) -> Array:
    return forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0]


def _has_note(pose: PerformerPose, *kinds: NoteKind) -> bool:
    return any(note.kind in kinds for note in pose.notes)


def _is_solved(pose: PerformerPose) -> bool:
    return not _has_note(pose, NoteKind.WAITING, NoteKind.REFUSED)


def _root_mean(squares: Array, unknown: float) -> float:
    """Return the RMS of finite values, or `unknown` if there are none."""
    known = squares[np.isfinite(squares)]
    return math.sqrt(float(np.add.reduce(known)) / len(known)) if len(known) else unknown


def _smoothed(
    poses: Sequence[PerformerPose], observations: Sequence[Observation], source: SourceNoise
) -> list[Observation]:
    """Return the observations with markers smoothed in both directions of time."""
    times_s = np.array([pose.time_s for pose in poses])
    points_m, noise_m = smooth_markers(
        times_s, np.array([observation.points_m for observation in observations]), source
    )
    return [
        observation.smoothed(points, noise, source)
        for observation, points, noise in zip(observations, points_m, noise_m, strict=True)
    ]


def _stretches(poses: Sequence[PerformerPose]) -> list[tuple[int, int]]:
    """Return the stretches of continuous motion that are long enough to be solved again."""
    solved = np.array([_is_solved(pose) for pose in poses])
    begins = np.array([True, *(_begins(before, pose) for before, pose in pairwise(poses))])
    found = []
    for start, stop in runs(solved):
        cuts = [start, *(start + 1 + np.flatnonzero(begins[start + 1 : stop])).tolist(), stop]
        found += [(at, end) for at, end in pairwise(cuts) if end - at >= _SHORTEST]
    return found


def _around(suspected: Mask, fps: float) -> list[slice]:
    """Return the parts of a stretch that are near any of its suspected markers (F, M)."""
    near, beside = np.zeros(len(suspected), dtype=bool), round(_AGAIN_S * fps)
    for frame in np.flatnonzero(suspected.any(axis=1)):
        near[max(frame - beside, 0) : frame + beside + 1] = True
    return [slice(start, stop) for start, stop in runs(near)]


def _clock(poses: Sequence[PerformerPose]) -> Clock:
    return clock_of(np.array([pose.time_s for pose in poses]))


def _started(poses: Sequence[PerformerPose]) -> list[PerformerPose]:
    """Return the poses with the first solved one also in the frames before it, instead of the T pose."""
    first = next((index for index, pose in enumerate(poses) if _is_solved(pose)), 0)
    started = list(poses)
    for index in range(first):
        shown = poses[first]
        started[index] = replace(poses[index], rotations=shown.rotations, root_position_m=shown.root_position_m)
    return started


def _begins(before: PerformerPose, pose: PerformerPose) -> bool:
    """Return whether a new motion begins, after a pause or a cut."""
    passed_s = pose.time_s - before.time_s
    moved_m = np.linalg.norm(pose.observed_m - before.observed_m, axis=1)
    moved_m = moved_m[np.isfinite(moved_m)]
    is_cut = len(moved_m) > 0 and float(np.median(moved_m)) > _CUT_M_S * passed_s
    return bool(not 0.0 < passed_s < PAUSE_S or is_cut)
