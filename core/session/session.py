"""Session of one subject: turns marker frames into poses, live or from takes."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..body.body_parts import FOOT_JOINTS
from ..body.body_size import girth_scale
from ..body.calibration_poses import t_pose
from ..body.foot_lock import floor_of
from ..body.pose_notes import NoteKind, PoseNote, source_notes
from ..body.pose_slew_limit import PoseSlewLimit
from ..body.scene_pose import PerformerPose, body_confidence
from ..database.store import Database
from ..geometry.arrays import Array, Mask
from ..geometry.camera import CameraRig
from ..markers.frozen_markers import FrozenMarkers
from ..markers.jump_gate import Carried
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_smoothing import MarkerSmoother
from ..markers.source_noise import noise_of
from ..markers.subject import Subject
from ..markers.usable_frame import FrameTimes, usable_frame
from ..solver.observation import Observation
from ..solver.pose_solver import PoseSolver
from ..solver.settings import SolveSettings
from ..solver.solution import Solution, SolverState
from ..solver.subject_model import SubjectModel
from .frame_labelling import BodyExamples, FrameLabeller, is_labelled, rest_markers
from .hypothesis_tracking import HypothesisTracker
from .limb_coverage import doubted, open_limbs
from .part_errors import PartErrors
from .tracking_quality import Fit, TrackingQuality, assess_fit, tracking_of

_FASTEST_M_S = 10.0  # speed above which torso markers are not extrapolated: no torso is so fast
_WORN_S = 0.2  # time constant for averaging a marker's offset from the solved body
# tilt from the examples at which the confidence has fallen to 1/e; people are within 36 degrees in 95 % of the frames,
# lying bodies at 78 or more
_TILTED_DEG = 60.0
_GUESSED = 0.5  # factor of the confidence where depths are guessed: what a marker on a ray counts, see `assess_fit`
_OPEN_S = 0.5  # time without any known marker after which a limb is doubtful; before it, the motion goes on as expected
_WORSE_M = 0.004  # largest increase of the RMS distance from the body with alternative labels


class _Tracked(NamedTuple):
    """A labelled and solved frame."""

    observation: Observation  # markers that are used
    known_m: Array  # (M, 3) positions for the solver: smoothed, and extrapolated while briefly hidden
    doubted: Mask  # (M,) markers that jumped
    frozen: Mask  # (M,) markers whose positions the source repeats
    exchanged: Mask  # (M,) markers whose exchanged labels were corrected
    solution: Solution | None


class Session:
    """Labels and solves the frames of one subject; markers seen by a single camera are used only with a `rig`."""

    def __init__(
        self,
        subject: Subject,
        database: Database,
        rig: CameraRig | None = None,
        settings: SolveSettings | None = None,
    ) -> None:
        self.subject = subject
        self.settings = settings or SolveSettings()
        self.rig = rig
        cameras = rig.cameras if rig else ()
        self._has_one_camera = len(cameras) == 1
        self._model = SubjectModel(subject, database.reference_pose_of(subject.skeleton, subject.name))
        self.solver = PoseSolver(self._model, database, self.settings)
        examples = BodyExamples(self._model, database)
        # the floor shows how large the performer is; without it, a single camera's person has the average size
        size = 1.0 if floor_of(rig) is not None else girth_scale(subject.skeleton)
        self.labeller = FrameLabeller(self._model, cameras, examples, size)
        poses_m = examples.start_poses_m, examples.markers_m
        self._hypotheses = HypothesisTracker(cameras[0], self.solver, *poses_m) if self._has_one_camera else None
        self._source = noise_of(subject.marker_set.points)
        # cameras have decided a network's left and right before, and its errors last: a point that jumps is no worse
        self._gates_jumps = not (cameras and self._source.lasting_m > 0.0)
        self._feet = np.array([marker.joint in FOOT_JOINTS for marker in subject.marker_set.markers])
        self._quality = TrackingQuality(self._model.torso, self._has_one_camera, tracking_of(self._source))
        self._part_errors = PartErrors(self._model, len(cameras))
        self.reset()

    def reset(self) -> None:
        """Forget the motion so far."""
        self._last: PerformerPose | None = None
        self._marker_velocities: Array | None = None  # (M, 3), m/s
        self._times = FrameTimes()
        self._slew_limit = PoseSlewLimit(self._model.skeleton, self._model.joints, self._model.offsets_m)
        self.restart()

    def step(self, frame: MarkerFrame, check_labels: bool = True) -> PerformerPose:
        """Return the pose of the next frame; for a frame with an impossible time, repeat the last pose.

        Args:
            check_labels: Compare the labels found for a tracked body with alternatives, and doubt given labels whose
                markers jump.
        """
        if not self._times.admit(frame.time_s):
            return self.refuse(frame)
        if self._times.jumped:
            self.restart(NoteKind.TIMES_JUMPED)
        return self.step_usable(usable_frame(frame, len(self.subject.marker_set), len(self.rig or ())), check_labels)

    def refuse(self, frame: MarkerFrame) -> PerformerPose:
        """Repeat the last pose for a frame with an impossible time."""
        return self._last_pose(frame, self._last.time_s if self._last else 0.0, NoteKind.REFUSED)

    def step_usable(self, frame: MarkerFrame, check_labels: bool) -> PerformerPose:
        """Return the pose of the next frame, whose time and contents are known to be possible; see `step`."""
        before = self._state
        if self._hypotheses is None or is_labelled(frame):
            tracked = self._track(frame, doubts=check_labels and is_labelled(frame))
        else:
            tracked = self._track_hypotheses(frame, self._hypotheses)
        observation, solution = tracked.observation, tracked.solution
        if solution:
            pose = self._solved_pose(frame, tracked, solution)
        else:
            self._agreement = 0.0
            pose = self._last_pose(frame, frame.time_s, NoteKind.WAITING, observation)
        elapsed_s = self._elapsed_s(frame.time_s)
        self._last = pose
        self._note_markers(before.markers_m, observation, elapsed_s)
        if reason := self._quality.reason_lost(pose):
            self.restart(reason)
        elif check_labels and solution and not is_labelled(frame):
            self._compare_labels(frame, elapsed_s, before, observation, pose, solution)
        return pose

    @property
    def is_tracking(self) -> bool:
        """Whether the body has been found."""
        return self._state.markers_m is not None

    def expected_markers(self, time_s: float) -> tuple[Array, Array] | None:
        """Return the expected markers (M, 3) and their uncertainties (M,), metres; None if the body is not tracked."""
        if self._state.markers_m is None:
            return None
        return self.labeller.expected(self._state.markers_m, self._elapsed_s(time_s))

    def restart(self, reason: NoteKind | None = None) -> None:
        """Forget labels and pose: the next frame is treated like the first, and its pose gets a note of the reason."""
        self._decisions = [reason] if reason else []
        self._agreement = 0.0
        self.labeller.reset()
        self._forget()

    def _forget(self) -> None:
        """Forget the pose, so that the next frame is solved like the first."""
        self._state = self.solver.initial_state
        self._marker_velocities = None
        self._apart_m = np.full((len(self.subject.marker_set), 3), np.nan)  # offsets of observed from solved markers
        self._known_s = np.full(len(self._feet), -np.inf)  # times at which the solver last knew the markers
        self._labelled_s: float | None = None  # time at which one camera's labels were found
        self._frozen = FrozenMarkers(self._feet)
        self._smoother = MarkerSmoother(len(self.subject.marker_set), self._source, feet=self._feet)
        self._quality.reset()
        if self._hypotheses is not None:
            self._hypotheses.reset()

    def _elapsed_s(self, time_s: float) -> float:
        return time_s - self._last.time_s if self._last else 0.0

    def _track(self, frame: MarkerFrame, doubts: bool) -> _Tracked:
        """Label and solve a frame, starting from the last pose."""
        labellings = self.labeller.labellings
        observation = self.labeller.label(frame, self._state.markers_m, self._elapsed_s(frame.time_s))
        if self.labeller.labellings != labellings:
            self._decisions.append(NoteKind.LABELLED)
        is_measured = doubts and not observation.guessed.any()
        carried = self._carried(frame.time_s) if is_measured and self._gates_jumps else None
        points_m, frozen = observation.points_m, np.zeros(len(self._feet), dtype=bool)
        if is_measured:
            frozen = self._frozen.step(points_m, self._elapsed_s(frame.time_s))
            points_m = np.where(frozen[:, None], np.nan, points_m)
        found = self._smoother.step(frame.time_s, points_m, carried)
        smoothed = observation.smoothed(found.points_m, found.deviations_m, self._source)
        observation = replace(observation, points_m=found.believed.points_m)
        # at most one expensive search per frame
        solution, self._state = self.solver.step(self._state, smoothed, frame.time_s, self.labeller.searched)
        believed = found.believed
        return _Tracked(observation, smoothed.points_m, believed.doubted, frozen, believed.exchanged, solution)

    def _carried(self, time_s: float) -> Carried:
        """Return where the torso markers should be at a given time, extrapolated from the last two poses."""
        carried_m, torso = np.full((len(self.subject.marker_set), 3), np.nan), self._model.torso
        if self._state.markers_m is not None and self._marker_velocities is not None:
            slow = torso & (np.linalg.norm(self._marker_velocities, axis=1) < _FASTEST_M_S)  # faster after a cut
            # markers are not worn exactly where the body model has them, so their mean offsets are added
            worn_m = self._state.markers_m + np.nan_to_num(self._apart_m)
            carried_m[slow] = (worn_m + self._elapsed_s(time_s) * self._marker_velocities)[slow]
        return Carried(carried_m, self._nearness)

    def _nearness(self, given_m: Array, corrected_m: Array) -> float:
        """Return the distance of markers (M, 3) from the closest example, relative to that of others."""
        fresh = replace(self.solver.initial_state, root=self._state.root, markers_m=self._state.markers_m)
        own_m, other_m = (self.solver.closest_m(fresh, Observation.of_points(each)) for each in (given_m, corrected_m))
        return own_m / max(other_m, 1e-9)

    def _note_markers(self, before_m: Array | None, observation: Observation, elapsed_s: float) -> None:
        """Remember the velocities of the solved markers, and the mean offsets of observed markers from solved ones."""
        if self._state.markers_m is None:
            return
        if before_m is not None and elapsed_s > 0.0:
            self._marker_velocities = (self._state.markers_m - before_m) / elapsed_s
        apart_m = observation.points_m - self._state.markers_m
        mean_m = self._apart_m + -np.expm1(-elapsed_s / _WORN_S) * (apart_m - self._apart_m)
        apart_m = np.where(np.isfinite(mean_m), mean_m, apart_m)
        self._apart_m = np.where(np.isfinite(apart_m), apart_m, self._apart_m)

    def _compare_labels(
        self,
        frame: MarkerFrame,
        elapsed_s: float,
        before: SolverState,
        observation: Observation,
        pose: PerformerPose,
        solution: Solution,
    ) -> None:
        """Continue with alternative labels of a solved frame if they explain it better."""
        alternative = self.labeller.find_alternative(frame, elapsed_s, pose, self._agreement, solution.reinitialised)
        if alternative is None:
            return
        limit_m, fresh = alternative.nearer * solution.nearest_m, self.solver.initial_state
        if alternative.keeps_torso:
            fresh = self.solver.begin_at_torso(solution)
            if limit_m < np.inf and not alternative.adds:  # history may have kept the pose from a closer example
                limit_m = min(limit_m, alternative.nearer * self.solver.closest_m(fresh, observation))
        if (
            alternative.adds
            and limit_m < np.inf
            and not self.solver.closest_m(fresh, alternative.observation) < limit_m
        ):
            return
        found, state = self.solver.step(
            before if alternative.adds else fresh, alternative.observation, frame.time_s, True, limit_m
        )
        if found is None:
            return
        # compare only the markers that both labellings locate, because additional markers increase the error
        seen = alternative.observation.located & np.isfinite(pose.observed_m[:, 0])
        away_m = np.linalg.norm(found.markers_m[seen] - alternative.observation.points_m[seen], axis=1)
        if np.any(seen) and np.sqrt(np.mean(away_m**2)) > pose.marker_rms_m + _WORSE_M:
            self.labeller.refute_alternative(alternative)
            return
        if not alternative.adds:
            self._quality.reset()
        self.labeller.follow_alternative(alternative)
        self._decisions.append(NoteKind.LABELLED_MORE if alternative.adds else NoteKind.RELABELLED)
        self._state = state

    def _track_hypotheses(self, frame: MarkerFrame, tracker: HypothesisTracker) -> _Tracked:
        """Label and solve a frame of a single camera, with the best of several hypotheses."""
        best = tracker.step(frame, self._agreement)
        nothing = np.full((len(self.subject.marker_set), 3), np.nan)
        none = np.zeros(len(nothing), dtype=bool)
        if best is None:
            return _Tracked(Observation.of_points(nothing), nothing, none, none, none, None)
        if best.start_s != self._labelled_s:
            self._decisions.append(NoteKind.LABELLED if self._labelled_s is None else NoteKind.RELABELLED)
            self._labelled_s = best.start_s
        self._state = best.state
        return _Tracked(best.observation, nothing, none, none, none, best.solution)

    def _solved_pose(self, frame: MarkerFrame, tracked: _Tracked, solution: Solution) -> PerformerPose:
        observation = tracked.observation
        # with one camera, markers are compared with the rays
        shown = observation
        if self._has_one_camera:
            shown = observation.without_guesses().back_projected(solution.markers_m)
        fit = assess_fit(shown, solution, self._quality.settings)
        self._agreement = fit.agreement
        texts = np.array(self.subject.marker_set.texts)
        hidden = texts[~fit.located & ~(tracked.doubted | tracked.frozen)]
        notes = [*source_notes(frame.notes), *([PoseNote.hidden(hidden)] if len(hidden) else [])]
        found = [(PoseNote.jumped, tracked.doubted), (PoseNote.frozen, tracked.frozen)]
        found.append((PoseNote.exchanged, tracked.exchanged))
        notes += [note(texts[markers]) for note, markers in found if markers.any()]
        notes += [PoseNote.of(NoteKind.UNFAMILIAR)] if solution.nearest_m > self._quality.settings.familiar_m else []
        notes += map(PoseNote.of, self._decided(solution))
        held = fit.rms_m > self._quality.settings.wrong_m
        notes += [PoseNote.of(NoteKind.HELD)] if held else []
        rotations = self._model.rotations(solution.pose, solution.root)
        joint_errors_deg = self._part_errors.expected_joints_deg(solution)
        errors_deg = self._part_errors.expected_deg(joint_errors_deg)
        known, root_m = is_labelled(frame), solution.root.position_m
        # the slew limit must not take a marker hidden for a moment as one that disappears and returns
        points_m = shown.points_m if self._has_one_camera else tracked.known_m
        rotations = self._slew_limit.step(frame.time_s, rotations, root_m, points_m, held, known)
        confidence = self._confidence(fit, solution, errors_deg)
        if observation.guessed.any():
            confidence *= _GUESSED
        if not (self._has_one_camera or known):
            confidence *= self.labeller.confidence(frame, observation.seen)
        pose = PerformerPose(
            number=frame.number,
            time_s=frame.time_s,
            rotations=rotations,
            root_position_m=root_m,
            confidence=confidence,
            markers_m=solution.markers_m,
            observed_m=observation.points_m,
            single_cameras=observation.cameras,
            marker_rms_m=fit.rms_m,
            neighbours=solution.neighbours,
            dimensions=solution.dimensions,
            single_points=observation.image_points,
            part_errors_deg=errors_deg,
            joint_errors_deg=joint_errors_deg,
        )
        self._known_s[np.isfinite(points_m[:, 0]) | observation.single] = frame.time_s
        self._known_s[tracked.frozen] = -np.inf  # what is extrapolated from a frozen marker is wrong
        lately = frame.time_s - self._known_s < _OPEN_S
        if not lately.all():
            names = [name for name, is_known in zip(self.subject.marker_set.names, lately, strict=True) if is_known]
            pose = doubted(pose, open_limbs(self.subject.marker_set, names))
        return replace(pose, notes=(*notes, *self._part_errors.notes(pose)))

    def _confidence(self, fit: Fit, solution: Solution, errors_deg: Array) -> float:
        """Return the confidence in a pose with these expected errors of its parts, given its labels."""
        if not len(errors_deg):
            return fit.agreement
        tilt = math.degrees(solution.tilt_rad) / _TILTED_DEG
        return fit.explained * body_confidence(errors_deg) * math.exp(-(tilt**2))

    def _decided(self, solution: Solution) -> list[NoteKind]:
        """Return, and forget, the decisions made since the last pose, with those of a solution."""
        decisions, self._decisions = self._decisions, []
        decisions += [solution.begun] if solution.begun else []
        return [*decisions, *([NoteKind.PRIOR_LED] if solution.prior_led else [])]

    def _last_pose(
        self, frame: MarkerFrame, time_s: float, note: NoteKind, observation: Observation | None = None
    ) -> PerformerPose:
        """Return the last pose, or else the T pose at the origin, for a frame that was not solved."""
        seen = observation or Observation.of_points(np.full((len(self.subject.marker_set), 3), np.nan))
        return _kept_pose(self._last or _first_pose(self._model), frame, time_s, note, seen)


def _kept_pose(
    pose: PerformerPose, frame: MarkerFrame, time_s: float, note: NoteKind, seen: Observation
) -> PerformerPose:
    """Return an earlier pose as that of a frame that was not solved."""
    return replace(
        pose,
        number=frame.number,
        time_s=time_s,
        confidence=0.0,
        observed_m=seen.points_m,
        single_cameras=seen.cameras,
        marker_rms_m=float("nan"),
        notes=(*source_notes(frame.notes), PoseNote.of(note)),
        single_points=seen.image_points,
    )


def _first_pose(model: SubjectModel) -> PerformerPose:
    rotations = t_pose(model.skeleton)
    markers = rest_markers(model, rotations)
    position = np.array([0.0, -float(markers[:, 1].min()), 0.0])
    unseen = Observation.of_points(np.full(markers.shape, np.nan))
    return PerformerPose(
        0, 0.0, rotations, position, 0.0, markers + position, unseen.points_m, unseen.cameras, float("nan")
    )
