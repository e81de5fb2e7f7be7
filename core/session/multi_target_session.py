"""Session with several targets in view of the same cameras: performers and props.

Each point belongs to at most one target. Props come first, because their patterns are exact; performers share the rest.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..body.pose_notes import NoteKind, PoseNote
from ..body.scene_pose import PerformerPose, PropPose, ScenePose
from ..errors import SettingsError
from ..labelling.prop_tracking import PropTracker
from ..markers.marker_frame import MarkerFrame, undistort_blobs
from ..markers.prop import Prop, check_distinct
from ..markers.take_frames import SIGMA_M
from ..markers.usable_frame import FrameTimes, usable_frame
from .performer_assignment import PerformerAssignment
from .session import Session
from .two_way_solve import TwoWaySolver


class MultiTargetSession:
    """Session with performers and props.

    Args:
        sessions: New sessions of the performers, from left to right.

    Raises:
        PropError: Two props have patterns that cannot be distinguished.
        SettingsError: There are several performers, but only one camera.
    """

    def __init__(self, sessions: Sequence[Session], props: Sequence[Prop] = ()) -> None:
        check_distinct(props)
        self.rig = sessions[0].rig
        self.subjects = tuple(session.subject for session in sessions)
        cameras = self.rig.cameras if self.rig else ()
        if len(sessions) > 1 and len(cameras) == 1:
            raise SettingsError("one camera cannot tell several performers apart", advice="use two cameras")
        self._sessions, self._props = tuple(sessions), tuple(props)
        self._begin()

    def _begin(self) -> None:
        self._assignment = PerformerAssignment(self._sessions)
        self._times = FrameTimes()
        self._trackers = [PropTracker(prop, self.rig.cameras if self.rig else ()) for prop in self._props]

    def reset(self) -> None:
        """Forget the motion so far."""
        self._begin()
        for session in self._sessions:
            session.reset()

    @property
    def labellings(self) -> int:
        """Number of times so far that labels were found without history, or replaced."""
        return sum(session.labellings for session in self._sessions)

    def label_cost(self, frame: MarkerFrame, pose: ScenePose) -> float:
        """Return the negative log likelihood of the labels of a frame's pose."""
        return sum(
            session.label_cost(frame, each) for session, each in zip(self._sessions, pose.performers, strict=True)
        )

    def step(self, frame: MarkerFrame, check_labels: bool = True) -> ScenePose:
        """Return the poses of all performers and props; see `Session.step`."""
        usable = self._usable(frame)
        if usable is None:
            return self._refused(frame)
        frame = undistort_blobs(usable, self.rig.cameras if self.rig else ())
        props = []
        for tracker in self._trackers:
            detection = tracker.step(frame)
            frame = detection.rest
            props.append(detection.pose)
        shares = self._assignment.split_frame(frame) if len(self._sessions) > 1 else [frame]
        return self._solve(shares, tuple(props), check_labels)

    def step_labelled(self, frame: MarkerFrame, known: ScenePose) -> ScenePose:
        """Return the poses of the next frame, solved with the labels and props of known poses."""
        usable = self._usable(frame)
        if usable is None:
            return self._refused(frame)
        shares = [_labelled_share(usable, pose) for pose in known.performers]
        return self._solve(shares, known.props, check_labels=False)

    def solve_two_ways(self, poses: Sequence[ScenePose], progress: Callable[[float], None]) -> list[ScenePose]:
        """Return the poses of a recorded take, solved again in both directions of time with the same labels."""
        columns: list[Sequence[PerformerPose]] = []
        for index, session in enumerate(self._sessions):
            own = [pose.performers[index] for pose in poses]

            def report(share: float, index: int = index) -> None:
                progress((index + share) / len(self._sessions))

            if session.settings.method == "best":  # other methods use no history
                own = TwoWaySolver(session.solver, self.rig.cameras if self.rig else ()).solve(own, report)
            columns.append(own)
        rows = zip(poses, zip(*columns, strict=True), strict=True)
        return [replace(pose, performers=performers) for pose, performers in rows]

    def _usable(self, frame: MarkerFrame) -> MarkerFrame | None:
        """Return the frame without impossible contents, None if its time is impossible; restart if times jumped."""
        if not self._times.admit(frame.time_s):
            return None
        if self._times.jumped:
            self._assignment = PerformerAssignment(self._sessions)
            for session in self._sessions:
                session.restart(NoteKind.TIMES_JUMPED)
        # labels given by the source refer to the first performer's markers
        return usable_frame(frame, len(self.subjects[0].marker_set), len(self.rig or ()))

    def _refused(self, frame: MarkerFrame) -> ScenePose:
        waiting = tuple(session.refuse(frame) for session in self._sessions)
        return ScenePose(waiting, tuple(tracker.last_pose() for tracker in self._trackers), waiting[0].notes)

    def _solve(self, shares: Sequence[MarkerFrame], props: tuple[PropPose, ...], check_labels: bool) -> ScenePose:
        performers = tuple(
            session.step_usable(share, check_labels) for session, share in zip(self._sessions, shares, strict=True)
        )
        further = [
            replace(note, text=f"{subject.name}: {note.text}")
            for subject, performer in zip(self.subjects[1:], performers[1:], strict=True)
            for note in performer.notes
            if note.kind is not NoteKind.SOURCE
        ]
        pairs = zip(self._props, props, strict=True)
        hidden = [PoseNote.hidden([prop.name]) for prop, pose in pairs if not pose.found]
        return ScenePose(performers, props, (*performers[0].notes, *further, *hidden))


def _labelled_share(frame: MarkerFrame, pose: PerformerPose) -> MarkerFrame:
    """Return a frame with only the points and rays that are labelled in a pose."""
    points, rays = np.flatnonzero(np.isfinite(pose.observed_m[:, 0])), np.flatnonzero(pose.single_cameras >= 0)
    return MarkerFrame(
        frame.number,
        frame.time_s,
        pose.observed_m[points],
        np.broadcast_to(SIGMA_M**2 * np.eye(3), (len(points), 3, 3)),
        points,
        single_cameras=pose.single_cameras[rays],
        single_blobs=np.full(len(rays), -1, dtype=np.int64),
        single_points=pose.single_points[rays],
        single_labels=rays,
        notes=frame.notes,
    )
