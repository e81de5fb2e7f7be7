"""Several targets before the same cameras: performers and props. What is seen belongs to one of them at most.

Props come first. Their distances are exact, so four points that are a prop's are nothing else; a performer's markers
are known by a pose that may be a hand's breadth off, and would take whatever lies there. Each prop leaves what is
not its own to the next, and the performers share the rest.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from ..body.scene_pose import PerformerPose
from ..errors import SettingsError
from ..geometry.camera import CameraRig
from ..labelling.prop_tracking import PropTracker
from ..markers.marker_frame import MarkerFrame
from ..markers.prop import Prop, check_distinct
from ..markers.subject import Subject
from .performer_assignment import PerformerAssignment
from .session import Session


class Stepper(Protocol):
    """What turns the marker frames of one capture into poses, in order: a `Session`, or an `MultiTargetSession`."""

    subject: Subject
    rig: CameraRig | None

    def step(self, frame: MarkerFrame) -> PerformerPose:
        """Return the pose of the next marker frame."""


class MultiTargetSession:
    """Performers and props.

    Args:
        sessions: of the performers, which have seen nothing yet; the first is the one whose pose has the others and
            the props. See `PerformerAssignment` for who is who.
        props: each with a pattern of its own.

    Raises:
        PropError: two props cannot be told from each other.
        SettingsError: several performers before one camera.
    """

    def __init__(self, sessions: Sequence[Session], props: Sequence[Prop]) -> None:
        check_distinct(props)
        first = sessions[0]
        self.subject, self.rig = first.subject, first.rig
        cameras = first.rig.cameras if first.rig else ()
        if len(sessions) > 1 and len(cameras) == 1:
            raise SettingsError("one camera cannot tell several performers apart", advice="use two cameras")
        self._sessions = tuple(sessions)
        self._company = PerformerAssignment(sessions)
        self._trackers = [PropTracker(prop, cameras) for prop in props]

    def step(self, frame: MarkerFrame) -> PerformerPose:
        """Return the first performer's pose with those of the others, and where the props are."""
        poses, hidden = [], []
        for tracker in self._trackers:
            sighting = tracker.step(frame)
            frame = sighting.rest
            poses.append(sighting.pose)
            if not sighting.pose.found:
                hidden.append(f"{tracker.prop.name} hidden")
        shares = self._company.shares(frame) if len(self._sessions) > 1 else [frame]
        pose, *others = (session.step(share) for session, share in zip(self._sessions, shares, strict=True))
        told = [
            f"{session.subject.name}: {note}"
            for session, other in zip(self._sessions[1:], others, strict=True)
            for note in other.notes
            if note not in frame.notes
        ]
        return replace(pose, props=tuple(poses), others=tuple(others), notes=(*pose.notes, *told, *hidden))


def followed(sessions: Sequence[Session], props: Sequence[Prop]) -> Stepper:
    """Return a session of performers and props. Errors as of `MultiTargetSession`."""
    return MultiTargetSession(sessions, props) if props or len(sessions) > 1 else sessions[0]
