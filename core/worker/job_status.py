"""Status of a job, as sent to Blender."""

from dataclasses import dataclass
from enum import Enum
from typing import Annotated

from ..errors import CaptureError
from ..system.schema import About, Schema

_MOST = 1e12


class PoseStage(Enum):
    """Stages in the recording of a calibration pose."""

    GET_READY = "get ready"
    HOLD = "hold"


@dataclass(frozen=True)
class PoseCue:
    """Current instruction for the performer."""

    stage: Annotated[PoseStage, About("stage of the pose")]
    left_s: Annotated[int, About("whole seconds until the next stage", "s", 0, 1e6)]


@dataclass(frozen=True)
class JobStatus:
    """Activity and progress of a job; a heartbeat has no activity."""

    activity: Annotated[str | None, About("activity in plain words")] = None
    fraction: Annotated[float | None, About("fraction done", "", -_MOST, _MOST)] = None
    heading: Annotated[str | None, About("progress in a word or two")] = None
    views: Annotated[int, About("views of the board taken", "", 0, _MOST)] = 0
    cue: Annotated[PoseCue | None, About("cue for the performer")] = None
    frames: Annotated[int, About("frames or poses sent", "", 0, _MOST)] = 0
    queued: Annotated[int, About("messages that the receiver has not taken", "", 0, _MOST)] = 0
    skew_s: Annotated[
        float | None, About("delay of the last camera's image behind the first's", "s", -_MOST, _MOST)
    ] = None
    blind: Annotated[int | None, About("unusable images of all cameras together", "", 0, _MOST)] = None
    stalled_s: Annotated[float, About("time without progress", "s", 0.0, _MOST)] = 0.0
    slowness: Annotated[float | None, About("duration of work relative to an idle machine", "", 0.0, _MOST)] = None


STATUS = Schema(JobStatus, "Status", "Status of a job.", CaptureError, "start again")
