"""Several targets before the same cameras: a performer and props. What is seen belongs to one of them at most.

Props come first. Their distances are exact, so four points that are a prop's are nothing else; a performer's markers
are known by a pose that may be a hand's breadth off, and would take whatever lies there. Each target leaves what is
not its own to the next.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from .camera import CameraRig
from .marker_frame import MarkerFrame
from .marker_set import Subject
from .pose_frame import PoseFrame
from .prop import Prop, check_together
from .prop_tracking import PropTracker


class Stepper(Protocol):
    """What turns the marker frames of one capture into poses, in order: a `Session`, or an `Ensemble`."""

    subject: Subject
    rig: CameraRig | None

    def step(self, frame: MarkerFrame) -> PoseFrame:
        """Return the pose of the next marker frame."""


class Ensemble:
    """A performer and props.

    Args:
        session: of the performer, which has seen nothing yet.
        props: each with a pattern of its own.

    Raises:
        PropError: two props cannot be told from each other.
    """

    def __init__(self, session: Stepper, props: Sequence[Prop]) -> None:
        check_together(props)
        self.subject = session.subject
        self.rig = session.rig
        self._session = session
        cameras = session.rig.cameras if session.rig else ()
        self._trackers = [PropTracker(prop, cameras) for prop in props]

    def step(self, frame: MarkerFrame) -> PoseFrame:
        """Return the performer's pose and where the props are."""
        poses, hidden = [], []
        for tracker in self._trackers:
            sighting = tracker.step(frame)
            frame = sighting.rest
            poses.append(sighting.pose)
            if not sighting.pose.found:
                hidden.append(f"{tracker.prop.name} hidden")
        pose = self._session.step(frame)
        return replace(pose, props=tuple(poses), notes=(*pose.notes, *hidden))


def with_props(session: Stepper, props: Sequence[Prop]) -> Stepper:
    """Return what follows a performer and props; the session itself when there are none. Errors as of `Ensemble`."""
    return Ensemble(session, props) if props else session
