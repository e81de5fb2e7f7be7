"""Job: live capture, from the marker frames of the camera process to poses for Blender.

Three processes share the work: the camera process (OpenCV), this one (the solver process) and Blender, which only
draws, so that its window stays responsive. If the camera process dies or hangs, this one replaces it; Blender replaces
this one. The take then continues, and the gap is recorded.
"""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ...body.foot_lock import floor_of
from ...database.store import Database, identity, open_database
from ...errors import PerfanimError, SettingsError
from ...formats.take_file.take_setup import TakeNotes, TakeSetup
from ...formats.take_file.take_writer import TakeWriter
from ...session.pose_filters import PoseFilter
from ...simulate.studio.simulated_performer import SimulatedPerformer
from ...simulate.studio.studio_rig import default_rig
from ...solver.settings import SolveSettings
from ...system.files import reading
from ...system.schema import table_of
from ..channel import Channel
from ..client import WorkerClient
from ..requests import CamerasRequest, CaptureRequest, TrackerSource, TrackersRequest
from ..worker_settings import WORKER
from .capture_loop import CaptureLoop
from .capture_stages import FrameRecorder, PoseOutput

if TYPE_CHECKING:
    from ...session.multi_target_session import MultiTargetSession

# The simulated performer keeps pace with the window: each redraw shows the next frame. On a machine that draws slowly,
# solving further ahead would take time from drawing. Recorded images may be solved any number of frames ahead.
_POSES_AHEAD = 1


def run(request: CaptureRequest, channel: Channel) -> None:
    """Send poses until STOP or the end of the source.

    Raises:
        PerfanimError: A file cannot be used, or the camera process failed.
    """
    cameras, source = request.cameras, request.cameras.source
    if not source.is_live:
        cameras = replace(cameras, in_flight=WORKER.frames_ahead)
    channel.send_status("opening the cameras")
    take, client = None, None
    try:
        # started first: its Python loads while files are opened here, and cameras open while the session is prepared
        if isinstance(source, TrackerSource):
            client = WorkerClient(TrackersRequest(source=source, marker_set=request.performers[0].marker_set))
        else:
            client = WorkerClient(cameras)
        database = open_database(request.database)
        setup, settings = _setup(request, cameras, database)
        point = request.after
        take = _open_take(request, setup, channel)
        if point is not None and take is not None and take.last_frame is not None:
            # the take may lack the last tenth of a second, so the capture continues after the take's last frame
            point = point.moved_to(*take.last_frame)
        client.ask(point)
        recorder = FrameRecorder(take, channel, source.is_repeatable)
        if point is not None:
            recorder.expect_restart(point, request.cause)
        session, output = _session(setup, database, settings), _output(request, setup, channel)
        CaptureLoop(client, recorder, session, output, channel, take, is_live=source.is_live).run()
    except PerfanimError as error:
        if take is not None:
            take.add_event(f"ended: {error}")
        raise
    finally:
        if take is not None:
            take.close(orphaned=channel.disconnected.is_set())
            if not take.frames:  # stopped before the first frame
                take.path.unlink(missing_ok=True)
        if client is not None:
            client.close()
        if cameras.background_file:
            Path(cameras.background_file).unlink(missing_ok=True)


def _setup(request: CaptureRequest, cameras: CamerasRequest, database: Database) -> tuple[TakeSetup, SolveSettings]:
    with reading("solver", SettingsError, "choose the method again"):
        settings = SolveSettings.of_table(request.settings)
    rig = None if isinstance(cameras.source, TrackerSource) else cameras.rig or default_rig()
    asked = table_of(replace(cameras, rig=None))  # the take stores the calibration separately
    facts = (request.settings, identity(database), asked)
    return TakeSetup.of(rig, request.performers, *facts, request.props), settings


def _session(setup: TakeSetup, database: Database, settings: SolveSettings) -> "MultiTargetSession":
    from ...session.capture_setup import CaptureSetup

    return CaptureSetup.from_tables(setup, database, settings).make_session()


def _output(request: CaptureRequest, setup: TakeSetup, channel: Channel) -> PoseOutput:
    """Return the output to Blender, and over VMC if the request names a program."""
    floor_m = floor_of(setup.camera_rig()) if request.cameras.rig else 0.0  # the simulated performer's floor is y = 0
    performers = setup.subjects()
    shaper = PoseFilter(performers, floor_m, request.shape)
    ahead = _POSES_AHEAD if isinstance(request.cameras.source, SimulatedPerformer) else None
    if request.vmc is None:
        return PoseOutput(shaper, channel, ahead)
    from ..vmc_sender import VmcSender  # loaded only by captures that send over VMC

    sender = VmcSender(performers[0].skeleton, request.vmc.host, request.vmc.port, channel.send_warning)
    return PoseOutput(shaper, channel, ahead, sender)


def _open_take(request: CaptureRequest, setup: TakeSetup, channel: Channel) -> TakeWriter | None:
    """Return the take to write; if it cannot be written, warn and return None."""
    if not request.take:
        return None
    notes = TakeNotes(character=request.character)

    def warn(problem: str) -> None:
        channel.send_warning(problem, standing=True)

    try:
        # the first process may have failed to create the take on a full disk
        resumed = request.after is not None and Path(request.take).exists()
        return TakeWriter(request.take, setup, notes, warn, resumed=resumed)
    except PerfanimError as error:
        warn(f"this capture is not kept as a take: {error}")
        return None
