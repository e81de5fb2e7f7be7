"""Session of one subject: turns marker frames into poses, live or from takes."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ..body.body_parts import FOOT_JOINTS
from ..body.body_size import girth_scale
from ..body.calibration_poses import t_pose
from ..body.foot_lock import floor_of
from ..body.pose_notes import NoteKind, PoseNote, source_notes
from ..body.pose_slew_limit import PoseSlewLimit
from ..body.scene_pose import PerformerPose, body_confidence
from ..database.store import Database
from ..geometry.arrays import Array
from ..geometry.camera import CameraRig
from ..labelling.initial_labelling import InitialLabels
from ..markers.marker_frame import MarkerFrame
from ..markers.source_noise import noise_of
from ..markers.subject import Subject
from ..markers.usable_frame import FrameTimes, usable_frame
from ..solver.observation import Observation
from ..solver.pose_solver import PoseSolver
from ..solver.settings import SolveSettings
from ..solver.solution import Solution
from ..solver.subject_model import SubjectModel
from .body_examples import BodyExamples, rest_markers
from .hypotheses import Hypotheses, Tracked
from .limb_coverage import doubted, open_limbs
from .one_camera_labels import OneCameraLabels
from .part_errors import PartErrors
from .point_labels import PointLabels
from .tracking_quality import Fit, TrackingQuality, assess_fit, tracking_of

# tilt from the examples at which the confidence has fallen to 1/e; people are within 36 degrees in 95 % of the frames,
# lying bodies at 78 or more
_TILTED_DEG = 60.0
_GUESSED = 0.5  # factor of the confidence where depths are guessed: what a marker on a ray counts, see `assess_fit`
_OPEN_S = 0.5  # time without any known marker after which a limb is doubtful; before it, the motion goes on as expected


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
        self._texts = np.array(subject.marker_set.texts)
        self._model = SubjectModel(subject, database.reference_pose_of(subject.skeleton, subject.name))
        self.solver = PoseSolver(self._model, database, self.settings)
        examples = BodyExamples(self._model, database)
        # the floor shows how large the performer is; without it, a single camera's person has the average size
        size = 1.0 if floor_of(rig) is not None else girth_scale(subject.skeleton)
        self._source = noise_of(subject.marker_set.points)
        feet = np.array([marker.joint in FOOT_JOINTS for marker in subject.marker_set.markers])
        self.point_labels = PointLabels(self.solver, cameras, examples, self._source, feet, size)
        self._given: Hypotheses[Any] = Hypotheses(self.point_labels)  # for labels from the source, too
        self._hypotheses: Hypotheses[Any] = self._given
        if self._has_one_camera:
            poses_m = examples.start_poses_m, examples.markers_m
            self._hypotheses = Hypotheses(OneCameraLabels(cameras[0], self.solver, *poses_m))
        self._quality = TrackingQuality(self._model.torso, self._has_one_camera, tracking_of(self._source))
        self._part_errors = PartErrors(self._model, len(cameras))
        self.reset()

    def reset(self) -> None:
        """Forget the motion so far."""
        self._last: PerformerPose | None = None
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
        tracker = self._given if frame.is_labelled else self._hypotheses
        self._best = tracker.step(frame, check_labels)
        if tracker.changed:
            self._decisions.append(tracker.changed)
            if tracker.changed is not NoteKind.LABELLED_MORE:
                self._quality.reset()
        tracked = self._best.tracked if self._best else None
        if self._best and tracked and tracked.solution:
            confidence = 1.0 if frame.is_labelled else tracker.confidence(frame)
            pose = self._solved_pose(frame, tracked, tracked.solution, confidence)
        else:
            pose = self._last_pose(frame, frame.time_s, NoteKind.WAITING, tracked.observation if tracked else None)
        self._last = pose
        if reason := self._quality.reason_lost(pose):
            self.restart(reason)
        return pose

    @property
    def is_tracking(self) -> bool:
        """Whether the body has been found."""
        return self._best is not None and self._best.state.markers_m is not None

    @property
    def labellings(self) -> int:
        """Number of times so far that labels of points were found without history, or replaced."""
        return self._given.labellings

    def expected_markers(self, time_s: float) -> tuple[Array, Array] | None:
        """Return the expected markers (M, 3) and their uncertainties (M,), metres; None if the body is not tracked."""
        best = self._given.best
        if best is None or best.state.markers_m is None:
            return None
        return best.labeller.expected(best.state.markers_m, time_s - self._last.time_s if self._last else 0.0)

    def label_initially(self, points_m: Array) -> InitialLabels | None:
        """Return labels of points (N, 3) without history, or None if the points do not look like a body."""
        return self.point_labels.label_initially(points_m)

    def label_cost(self, frame: MarkerFrame, pose: PerformerPose) -> float:
        """Return the negative log likelihood of the labels with which a frame's pose was solved."""
        return self.point_labels.label_cost(len(frame.points_m), pose.observed_m, pose.markers_m, pose.marker_rms_m)

    def restart(self, reason: NoteKind | None = None) -> None:
        """Forget labels and pose: the next frame is treated like the first, and its pose gets a note of the reason."""
        self._decisions = [reason] if reason else []
        self._best = None
        self._given.reset()
        self._hypotheses.reset()
        # times at which the solver last knew the markers
        self._known_s = np.full(len(self.subject.marker_set), -np.inf)
        self._quality.reset()

    def _solved_pose(
        self, frame: MarkerFrame, tracked: Tracked, solution: Solution, label_confidence: float
    ) -> PerformerPose:
        observation = tracked.observation
        # with one camera, markers are compared with the rays
        shown = observation
        if self._has_one_camera:
            shown = observation.without_guesses().back_projected(solution.markers_m)
        fit = assess_fit(shown, solution, self._quality.settings)
        texts = self._texts
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
        known, root_m = frame.is_labelled, solution.root.position_m
        # the slew limit must not take a marker hidden for a moment as one that disappears and returns
        points_m = shown.points_m if self._has_one_camera else tracked.known_m
        rotations = self._slew_limit.step(frame.time_s, rotations, root_m, points_m, held, known)
        confidence = label_confidence * self._confidence(fit, solution, errors_deg)
        if observation.guessed.any():
            confidence *= _GUESSED
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
