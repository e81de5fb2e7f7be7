"""Live capture: marker frames of the cameras' process to poses for Blender.

Three processes share the work: the cameras' (OpenCV), this one (the solver) and Blender, where only the drawing is
left, so the window stays as quick as without a capture. When the cameras' process dies or hangs, this one starts
another; when this one does, Blender does. Either continues the same take, which records the gap.

Request: "cameras" (request of the job `cameras` or `trackers`), "performers" and "props" (tables as in their files),
"database" (file), "settings" (of `SolveSettings`), "take" (file to write, see `take_file`; optional), "character" (that
is driven), "shape" (settings of the pose filter, see `pose_filters`; the take keeps the poses unfiltered), "vmc" (host
and port of a program that gets the poses, too; optional).
A process that takes another's place also gets "after" (`RestartPoint` as a table) and "cause" (in plain words).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...body.foot_lock import floor_of
from ...database.store import Database, identity, open_database
from ...errors import PerfanimError, SettingsError
from ...formats.take_file.take_setup import TakeNotes, TakeSetup
from ...formats.take_file.take_writer import TakeWriter
from ...geometry.camera import CameraRig
from ...geometry.rig_file import rig_from
from ...markers.prop import prop_from
from ...markers.subject import subject_from
from ...session.pose_filters import FilterSettings, PoseFilter
from ...simulate.studio.studio_rig import default_rig
from ...solver.settings import SolveSettings
from ...system.files import reading
from ..channel import Channel
from ..client import WorkerClient
from ..restart_point import RestartPoint
from ..source_traits import has_no_cameras, is_live, is_repeatable, is_simulated
from .capture_loop import CaptureLoop
from .capture_stages import FrameRecorder, PoseOutput

if TYPE_CHECKING:
    from ...session.multi_target_session import MultiTargetSession

_FRAMES_AHEAD = 2  # of the solver, for sources that can wait
# The simulated performer keeps step with the window: each redraw shows its next frame. On a machine that draws slowly,
# poses computed ahead would take time from the drawing. Recorded images do run ahead.
_POSES_AHEAD = 1


def run(request: Mapping[str, Any], channel: Channel) -> None:
    """Send poses until STOP or the end of the source.

    Raises:
        PerfanimError: a file is bad, or the cameras' process failed.
    """
    cameras = dict(request["cameras"])
    if not is_live(cameras):
        cameras["in_flight"] = _FRAMES_AHEAD
    channel.send_status("opening the cameras")
    take, client = None, None
    try:
        # its Python starts while the files are opened here, and it opens the cameras while the session is prepared
        trackers = {"job": "trackers", "marker_set": request["performers"][0]["marker_set"]}
        client = WorkerClient({**cameras, **(trackers if has_no_cameras(cameras) else {"job": "cameras"})})
        database = open_database(request["database"])
        setup, settings = _setup(request, cameras, database)
        point = RestartPoint.of_table(request["after"]) if request.get("after") else None
        take = _open_take(request, setup, channel)
        if point is not None and take is not None and take.last_frame is not None:
            # the last tenth of a second of Blender's poses may not have been written: it comes once more
            point = point.moved_to(*take.last_frame)
        client.ask(after=point.table() if point is not None else None)
        recorder = FrameRecorder(take, channel, is_repeatable(cameras))
        if point is not None:
            recorder.expect_restart(point, str(request.get("cause", "")))
        session, output = _session(setup, database, settings), _output(request, setup, cameras, channel)
        CaptureLoop(client, recorder, session, output, channel, take, is_live=is_live(cameras)).run()
    except PerfanimError as error:
        if take is not None:
            take.add_event(f"ended: {error}")
        raise
    finally:
        if take is not None:
            take.close(orphaned=channel.disconnected.is_set())
            if not take.frames:  # stopped before the first
                take.path.unlink(missing_ok=True)
        if client is not None:
            client.close()
        if cameras.get("background_file"):
            Path(cameras["background_file"]).unlink(missing_ok=True)


def _setup(
    request: Mapping[str, Any], cameras: Mapping[str, Any], database: Database
) -> tuple[TakeSetup, SolveSettings]:
    given = request.get("settings") or {}
    with reading("solver", SettingsError, "choose the method again"):
        settings = SolveSettings.of_table(given)
    performers = [subject_from(table, "performer") for table in request["performers"]]
    props = [prop_from(table, "prop") for table in request.get("props") or ()]
    asked = {key: value for key, value in cameras.items() if key != "rig"}  # which the take has beside it
    return TakeSetup.of(_rig(cameras), performers, given, identity(database), asked, props), settings


def _rig(cameras: Mapping[str, Any]) -> CameraRig | None:
    if has_no_cameras(cameras):
        return None
    return rig_from(cameras["rig"], "calibration") if cameras.get("rig") else default_rig()


def _session(setup: TakeSetup, database: Database, settings: SolveSettings) -> "MultiTargetSession":
    from ...session.capture_setup import CaptureSetup

    return CaptureSetup.from_tables(setup, database, settings).make_session()


def _output(request: Mapping[str, Any], setup: TakeSetup, cameras: Mapping[str, Any], channel: Channel) -> PoseOutput:
    """Return the output to Blender, and by VMC if the request names a program."""
    floor_m = floor_of(setup.camera_rig()) if cameras.get("rig") else 0.0  # the simulated performer's is known
    skeletons = [subject.skeleton for subject in setup.subjects()]
    shaper = PoseFilter(skeletons, floor_m, FilterSettings.of_table(request.get("shape") or {}))
    ahead = _POSES_AHEAD if is_simulated(cameras) else None
    if not request.get("vmc"):
        return PoseOutput(shaper, channel, ahead)
    from ..vmc_sender import VmcSender  # a capture that sends nothing does not load it

    host, port = request["vmc"]
    return PoseOutput(shaper, channel, ahead, VmcSender(skeletons[0], str(host), int(port), channel.send_warning))


def _open_take(request: Mapping[str, Any], setup: TakeSetup, channel: Channel) -> TakeWriter | None:
    """Return the take to write; warn, and return None, when it cannot be written."""
    if not request.get("take"):
        return None
    notes = TakeNotes(character=str(request.get("character", "")))

    def warn(problem: str) -> None:
        channel.send_warning(problem, standing=True)

    try:
        # a full disk may have kept the first process from beginning the take
        resumed = bool(request.get("after")) and Path(request["take"]).exists()
        return TakeWriter(str(request["take"]), setup, notes, warn, resumed=resumed)
    except PerfanimError as error:
        warn(f"this capture is not kept as a take: {error}")
        return None
