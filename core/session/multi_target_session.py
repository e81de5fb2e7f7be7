"""Session of several targets before the same cameras: performers and props.

Each point has at most one target. Props come first, as their patterns are exact; performers share the rest.
"""

from collections.abc import Sequence

from ..body.scene_pose import ScenePose
from ..errors import SettingsError
from ..labelling.prop_tracking import PropTracker
from ..markers.marker_frame import MarkerFrame, undistort_blobs
from ..markers.prop import Prop, check_distinct
from ..markers.usable_frame import FrameTimes, usable_frame
from .performer_assignment import PerformerAssignment
from .session import Session


class MultiTargetSession:
    """Session of performers and props.

    Args:
        sessions: new ones, in the order of `PerformerAssignment`.

    Raises:
        PropError: two props have patterns that cannot be distinguished.
        SettingsError: several performers before one camera.
    """

    def __init__(self, sessions: Sequence[Session], props: Sequence[Prop] = ()) -> None:
        check_distinct(props)
        self.rig = sessions[0].rig
        self.subjects = tuple(session.subject for session in sessions)
        cameras = self.rig.cameras if self.rig else ()
        if len(sessions) > 1 and len(cameras) == 1:
            raise SettingsError("one camera cannot tell several performers apart", advice="use two cameras")
        self._sessions = tuple(sessions)
        self._assignment = PerformerAssignment(sessions)
        self._times = FrameTimes()
        self._trackers = [PropTracker(prop, cameras) for prop in props]

    def step(self, frame: MarkerFrame) -> ScenePose:
        """Return the poses of all performers and props in the next marker frame."""
        if not self._times.admit(frame.time_s):
            waiting = [session.step(frame) for session in self._sessions]
            return ScenePose(tuple(waiting), tuple(tracker.last_pose() for tracker in self._trackers), waiting[0].notes)
        if self._times.jumped:
            self._assignment = PerformerAssignment(self._sessions)
            for session in self._sessions:
                session.restart()
        cameras = self.rig.cameras if self.rig else ()
        labels = max(len(subject.marker_set) for subject in self.subjects)
        frame = undistort_blobs(usable_frame(frame, labels, len(cameras)), cameras)
        props, hidden = [], []
        for tracker in self._trackers:
            detection = tracker.step(frame)
            frame = detection.rest
            props.append(detection.pose)
            if not detection.pose.found:
                hidden.append(f"{tracker.prop.name} hidden")
        shares = self._assignment.split_frame(frame) if len(self._sessions) > 1 else [frame]
        performers = tuple(session.step(share) for session, share in zip(self._sessions, shares, strict=True))
        further = [
            f"{subject.name}: {note}"
            for subject, performer in zip(self.subjects[1:], performers[1:], strict=True)
            for note in performer.notes
            if note not in frame.notes
        ]
        return ScenePose(performers, tuple(props), (*performers[0].notes, *further, *hidden))
