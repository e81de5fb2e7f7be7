"""Requests for the worker's jobs, as they are sent to its process.

The add-on creates requests; the job's module in `jobs` documents their effect. They are sent as JSON and checked on
arrival.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, TypeAlias

from ..errors import SettingsError
from ..geometry.rig_file import RigTables
from ..markers.marker_set import MarkerSet
from ..markers.prop import PropTables
from ..markers.subject import SkeletonRows, Subject
from ..session.pose_filters import FilterSettings
from ..simulate.studio.simulated_performer import SimulatedPerformer
from ..system.files import reading
from ..system.schema import About, Schema, Table, table_of
from ..vision.sources.source_requests import ImageFiles, LiveCameras, VideoFiles
from .restart_point import RestartPoint

_SECONDS = 3600.0
_PORT = About("UDP port", "", 0, 65_535)


@dataclass(frozen=True)
class TrackerSource:
    """Another program's trackers, received over VMC."""

    port: Annotated[int, _PORT]
    kind: Annotated[str, About("kind of source", choices=("vmc",), optional=False)] = "vmc"
    sender: Annotated[str, About("name or address of the only computer to accept; empty for all")] = ""
    is_live = True
    is_repeatable = False


ImageSourceRequest: TypeAlias = SimulatedPerformer | VideoFiles | ImageFiles | LiveCameras
SourceRequest: TypeAlias = ImageSourceRequest | TrackerSource


@dataclass(frozen=True)
class VmcTarget:
    """Program to which the poses are sent."""

    host: Annotated[str, About("name or address of its computer")]
    port: Annotated[int, _PORT]


@dataclass(frozen=True, kw_only=True)
class Request:
    """Request for a job."""

    job: ClassVar[str] = ""

    def to_json(self) -> dict[str, Any]:
        """Return the request as a JSON object."""
        return {"job": self.job, **table_of(self)}


@dataclass(frozen=True, kw_only=True)
class CamerasRequest(Request):
    """Turn images, or trackers if the source is one, into marker frames.

    A process that replaces another gets `after` and reuses the earlier backgrounds, because the performer is now in
    view.
    """

    job: ClassVar[str] = "cameras"
    source: Annotated[SourceRequest, About("image source")]
    rig: Annotated[RigTables | None, About("calibration; the simulated performer has its own")] = None
    background_s: Annotated[float, About("time to learn the empty capture space, cameras only", "s", 0.0, _SECONDS)] = (
        2.0
    )
    threshold: Annotated[
        float | None, About("grey levels above the background; by default automatic", "", 0.0, 255.0)
    ] = None
    in_flight: Annotated[
        int | None, About("number of frames that may wait for the receiver; by default any", "", 0, 1_000_000)
    ] = None
    people: Annotated[
        str, About("file of the body network that finds a person without markers; empty to find markers")
    ] = ""
    preview: Annotated[bool, About("whether small pictures are sent")] = False
    background_file: Annotated[str, About("file that keeps the backgrounds for a replacement of this process")] = ""
    after: Annotated[RestartPoint | None, About("last frame of the replaced process")] = None


@dataclass(frozen=True, kw_only=True)
class TrackersRequest(Request):
    """Turn another program's trackers into marker frames."""

    job: ClassVar[str] = "trackers"
    source: Annotated[TrackerSource, About("trackers")]
    marker_set: Annotated[MarkerSet, About("worn marker set")]
    after: Annotated[RestartPoint | None, About("last frame of the replaced process")] = None


@dataclass(frozen=True, kw_only=True)
class CaptureRequest(Request):
    """Live capture: turn images into poses."""

    job: ClassVar[str] = "capture"
    cameras: Annotated[CamerasRequest, About("cameras or trackers")]
    performers: Annotated[tuple[Subject, ...], About("performers, as in their files", fewest=1)]
    props: Annotated[tuple[PropTables, ...], About("props, as in their files")] = ()
    database: Annotated[str, About("motion database")]
    settings: Annotated[Table, About("`SolveSettings`")] = field(default_factory=dict)
    take: Annotated[str, About("take to write; empty for none")] = ""
    character: Annotated[str, About("character that is driven")] = ""
    shape: Annotated[FilterSettings, About("filter of the poses; the take keeps them unfiltered")] = field(
        default_factory=FilterSettings
    )
    vmc: Annotated[VmcTarget | None, About("program that also receives the poses")] = None
    after: Annotated[RestartPoint | None, About("last frame of the replaced process")] = None
    cause: Annotated[str, About("why the process was replaced")] = ""


@dataclass(frozen=True, kw_only=True)
class CommandRequest(Request):
    """Run a command of the command line."""

    job: ClassVar[str] = "command"
    arguments: Annotated[tuple[str, ...], About("arguments of the command line")]
    gently: Annotated[bool, About("whether to run at low priority")] = False


@dataclass(frozen=True, kw_only=True)
class _BoardRequest(Request):
    source: Annotated[ImageSourceRequest, About("image source")]
    board: Annotated[str, About("board, as `parse_board` reads it")]
    preview: Annotated[bool, About("whether small pictures are sent")] = False


@dataclass(frozen=True, kw_only=True)
class RecordBoardRequest(_BoardRequest):
    """Calibrate cameras from a board that is carried in front of them."""

    job: ClassVar[str] = "record board"
    limit: Annotated[int, About("number of views at which it ends even if the result is not good", "", 1, 10_000)]
    every_s: Annotated[
        float | None, About("time between views; by default one when the board is held still", "s", 0.0, _SECONDS)
    ] = None
    out: Annotated[str, About("folder that gets a folder of pictures for each camera")]


@dataclass(frozen=True, kw_only=True)
class RecordFloorRequest(_BoardRequest):
    """Find the floor from the board lying on it."""

    job: ClassVar[str] = "record floor"
    rig: Annotated[RigTables, About("calibration")]


@dataclass(frozen=True, kw_only=True)
class FloorMarkersRequest(CamerasRequest):
    """Find the floor, and optionally the scale, from markers lying on it."""

    job: ClassVar[str] = "record floor markers"
    rig: Annotated[RigTables, About("calibration")] = field()
    height_m: Annotated[float, About("height of the marker centres above the floor", "m", -10.0, 10.0)] = 0.0
    longest_m: Annotated[
        float | None,
        About("measured distance of the two markers farthest apart; by default the scale is kept", "m", 0.0, 100.0),
    ] = None


@dataclass(frozen=True, kw_only=True)
class RecordWalkRequest(CamerasRequest):
    """Calibrate live cameras by a person who walks about; `rig` has the lenses that are known."""

    job: ClassVar[str] = "record walk"
    countdown_s: Annotated[float, About("time to go in front of the cameras", "s", 0.0, _SECONDS)] = 0.0
    seconds: Annotated[float, About("duration of the walk", "s", 1.0, _SECONDS)] = 20.0
    height_m: Annotated[float, About("height of the person", "m", 1.0, 2.5)]


@dataclass(frozen=True, kw_only=True)
class RecordPoseRequest(CamerasRequest):
    """Record a take of the performer's calibration poses."""

    job: ClassVar[str] = "record pose"
    marker_set: Annotated[str, About("shipped marker set or its file")]
    poses: Annotated[tuple[str, ...], About("names in `POSES`, an upright one first")]
    countdown_s: Annotated[float, About("time to take the first pose, cameras only", "s", 0.0, _SECONDS)] = 0.0
    between_s: Annotated[float, About("time from each pose to the next", "s", 0.0, _SECONDS)] = 0.0
    seconds: Annotated[float, About("duration of each pose", "s", 0.0, _SECONDS)]
    out: Annotated[str, About("take to write")]
    floor_out: Annotated[
        str, About("calibration to write with the floor below the feet, if the present one has no floor")
    ] = ""


@dataclass(frozen=True, kw_only=True)
class CalibratePerformerRequest(RecordPoseRequest):
    """Record the calibration poses and measure the performer from them."""

    job: ClassVar[str] = "calibrate performer"
    name: Annotated[str, About("name of the performer")]
    subject_out: Annotated[str, About("subject to write")]


@dataclass(frozen=True, kw_only=True)
class ShowCamerasRequest(Request):
    """Take a picture with each plugged-in camera."""

    job: ClassVar[str] = "show cameras"


@dataclass(frozen=True, kw_only=True)
class CheckSetupRequest(CamerasRequest):
    """Check light, cameras and markers before a capture.

    Without `rig`, only faults visible in single pictures are found.
    """

    job: ClassVar[str] = "check setup"
    marker_set: Annotated[str, About("shipped marker set or its file")]
    countdown_s: Annotated[float, About("time to go in front of the cameras", "s", 0.0, _SECONDS)] = 0.0
    fault: Annotated[str, About("name of a `Fault`: its simulated studio replaces the source; empty for none")] = ""
    ignored: Annotated[
        tuple[tuple[float, float, float], ...],
        About("camera, x and y (px) of places to ignore if no calibration of the source lists them"),
    ] = ()
    floor_out: Annotated[
        str,
        About("calibration to write with the floor below a person's feet, if the present one has no floor"),
    ] = ""


@dataclass(frozen=True, kw_only=True)
class SketchEdit(Request):
    """An edit of a sketch that is being solved live."""

    job: ClassVar[str] = "sketch edit"
    sketch: Annotated[Table, About("table of a `Sketch`")]
    settings: Annotated[Table, About("table of `SketchSettings`")]
    number: Annotated[int, About("number of the edit", "", 0, 1e9)] = 0
    frame: Annotated[float, About("frame that is solved first", "", -1e9, 1e9)] = 0.0


@dataclass(frozen=True, kw_only=True)
class SketchRequest(SketchEdit):
    """Solve a body from keyframed controls; if live, again after each edit."""

    job: ClassVar[str] = "sketch"
    skeleton: Annotated[SkeletonRows, About("skeleton of the character", fewest=1)]
    database: Annotated[str, About("motion database")]
    live: Annotated[bool, About("whether edits follow")] = False


_CLASSES: tuple[type[Request], ...] = (
    CaptureRequest, CamerasRequest, TrackersRequest, CommandRequest, RecordBoardRequest, RecordFloorRequest,
    FloorMarkersRequest, RecordWalkRequest, RecordPoseRequest, CalibratePerformerRequest, ShowCamerasRequest,
    CheckSetupRequest, SketchRequest, SketchEdit,
)  # fmt: skip
_SCHEMAS = {cls.job: Schema(cls, cls.job, "", SettingsError, "start it again") for cls in _CLASSES}


def read_request(job: str, table: Mapping[str, Any]) -> Any:
    """Return the request of a job from its JSON object.

    Raises:
        SettingsError: A value is missing, of another kind, or out of range.
    """
    where = f"request of the job {job}"
    with reading(where, SettingsError, "start it again", "cannot be done"):
        return _SCHEMAS[job].read(table, where)
