"""A live capture: marker frames from the cameras' process through one session, poses to Blender.

Three processes share the work: the cameras' (OpenCV), this one (the solver) and Blender, whose only thread then has
nothing to do but to put poses on the armature, so that the window stays as quick as without a capture. Every marker
frame that the cameras' process hands over is solved here in order and handed on; nobody drops or waits.

Should the cameras' process die or hang, another takes its place; should this one, Blender starts another. Either goes
on in the same take, which has a record of what is missing.

Request: "cameras" (request of `camera_job`, or of `tracker_job`), "subject" (file), "database" (file), "settings" (of
`SolveSettings`), "take" (file that keeps the capture as it comes, see `take_file`; without it none does), "character"
(who is driven), "shape" (of the poses as they are handed over, see `pose_shaping`; the take keeps them as they are
solved), "props" (files of the props that are followed besides the performer, if any), "performers" (likewise
subjects), "vmc" (host and port of a program that gets the poses, too; without it none does).
Of a process that takes another's place also "after" (`seam.Seam` as a table: the last frame whose pose was taken) and
"cause" (what happened to the other, in plain words).
"""

import math
import os
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...body.foot_lock import floor_of
from ...body.scene_pose import PerformerPose
from ...database.store import Database, identity, open_database
from ...errors import CaptureError, PerfanimError, SettingsError
from ...formats.take_file.pose_codec import TimedPose, pack_solved
from ...formats.take_file.setup import TakeNotes, TakeSetup
from ...formats.take_file.writer import TakeWriter
from ...geometry.camera import CameraRig
from ...geometry.rig_file import load_rig
from ...markers.marker_frame import MarkerFrame
from ...markers.marker_frame_codec import pack_stamped, unpack_stamped
from ...markers.prop import load_prop
from ...markers.subject import load_subject
from ...session.pose_filters import FilterSettings, PoseFilter
from ...simulate.studio.rig import default_rig
from ...solver.settings import SolveSettings
from ..channel import Channel
from ..client import WorkerClient
from ..protocol import Message, MessageKind
from ..restart_point import Seam, Shift, missing_text
from ..source_traits import has_no_cameras, is_live, is_repeatable, is_simulated

if TYPE_CHECKING:
    from ...session.multi_target_session import Stepper

STOP_LIMIT_S = 5.0
GONE_LIMIT_S = 1.0  # the same when Blender is gone: the process has three seconds then, see `channel`
_IDLE_S = 0.02
_FULL_S = 0.25
_NICENESS = 14
_FRAMES_AHEAD = 2  # of the solver, for sources that can wait
# The simulated performer keeps step with the window: each redraw shows its next frame. On a machine that draws slowly,
# what is computed for poses that nobody sees would be taken from the drawing. Recorded images do run ahead.
_POSES_AHEAD = 1
_NO_SHIFT = Shift()
_TOLD_EVERY_S = 0.5


def run(request: Mapping[str, Any], channel: Channel) -> None:
    """Hand over poses until STOP or the end of the source.

    Raises:
        PerfanimError: a file is bad, or the cameras' process failed.
    """
    cameras = dict(request["cameras"])
    if not is_live(cameras):
        _give_way()
        cameras["in_flight"] = _FRAMES_AHEAD
    channel.send_status("opening the cameras")
    take, client = None, None
    try:
        # its Python starts while the files are opened here, and it opens the cameras while the session is prepared
        client = WorkerClient({**cameras, "job": "trackers" if has_no_cameras(cameras) else "cameras"})
        database = open_database(request["database"])
        setup, settings = _setup(request, cameras, database)
        seam = Seam.of_table(request["after"]) if request.get("after") else None
        take = _take(request, setup, channel)
        if seam is not None and take is not None and take.last_frame is not None:
            # what Blender has of the last tenth of a second may not have been written: it comes once more
            seam = seam.moved_to(*take.last_frame)
        client.ask(after=seam.number if seam is not None else None)
        session = _session(setup, database, settings)
        shaper = _shaper(request, setup, cameras, channel)
        relay = _Relay(client, session, shaper, channel, take, cameras)
        if seam is not None:
            relay.expect(seam, str(request.get("cause", "")))
        relay.run()
    except PerfanimError as error:
        if take is not None:
            take.add_event(f"ended: {error}")
        raise
    finally:
        if take is not None:
            take.close(orphaned=channel.gone.is_set())
            if not take.frames:  # stopped before the first
                take.path.unlink(missing_ok=True)
        if client is not None:
            client.close()
        if cameras.get("background_file"):
            Path(cameras["background_file"]).unlink(missing_ok=True)


def _give_way() -> None:
    """Let Blender go first: recorded and simulated images can wait, a window cannot (real cameras cannot either)."""
    if hasattr(os, "nice"):
        os.nice(_NICENESS)


def _setup(
    request: Mapping[str, Any], cameras: Mapping[str, Any], database: Database
) -> tuple[TakeSetup, SolveSettings]:
    """Return what a take of the capture begins with, and the solver's settings."""
    given = request.get("settings", {})
    try:
        settings = SolveSettings(**given)
    except TypeError as error:
        raise SettingsError(str(error), where="solver") from error
    subject, props = load_subject(request["subject"]), [load_prop(str(path)) for path in request.get("props", ())]
    performers = [load_subject(str(path)) for path in request.get("performers", ())]
    return TakeSetup.of(_rig(cameras), subject, given, identity(database), cameras, props, performers), settings


def _session(setup: TakeSetup, database: Database, settings: SolveSettings) -> "Stepper":
    """Return what solves the frames."""
    from ...session.multi_target_session import followed
    from ...session.session import Session

    subjects, rig = (setup.worn_subject(), *setup.further_subjects()), setup.camera_rig()
    return followed([Session(subject, database, rig, settings) for subject in subjects], setup.carried_props())


def _shaper(request: Mapping[str, Any], setup: TakeSetup, cameras: Mapping[str, Any], channel: Channel) -> PoseFilter:
    floor_m = floor_of(setup.camera_rig()) if cameras.get("rig") else 0.0  # the simulated performer's is known
    skeleton, shape = setup.worn_subject().skeleton, FilterSettings.of_table(request.get("shape", {}))
    others = [subject.skeleton for subject in setup.further_subjects()]
    if not request.get("vmc"):
        return PoseFilter(skeleton, floor_m, shape, others)
    from ..vmc_output import BroadcastShaper  # a capture that sends nothing does not load it

    host, port = request["vmc"]
    return BroadcastShaper(skeleton, floor_m, shape, str(host), int(port), channel.send_warning, others)


def _take(request: Mapping[str, Any], setup: TakeSetup, channel: Channel) -> TakeWriter | None:
    """Return the take that is asked for; one that cannot be written is told and does not hold the capture up."""
    if not request.get("take"):
        return None
    notes = TakeNotes(character=str(request.get("character", "")))

    def tell(problem: str) -> None:
        channel.send_warning(problem, standing=True)

    try:
        # one that was not begun, as its disk was full, is begun now
        resumed = bool(request.get("after")) and Path(request["take"]).exists()
        return TakeWriter(str(request["take"]), setup, notes, tell, resumed=resumed)
    except PerfanimError as error:
        tell(f"this capture is not kept as a take: {error}")
        return None


def _rig(cameras: Mapping[str, Any]) -> CameraRig | None:
    if has_no_cameras(cameras):
        return None
    return load_rig(str(cameras["rig"])) if cameras.get("rig") else default_rig()


class _Relay:
    """Takes messages of the cameras' process, keeps and solves frames, hands everything on.

    Args:
        client: of the cameras' process.
        session: solves.
        shaper: makes of solved poses what is handed over.
        channel: to Blender.
        take: keeps all that comes.
        cameras: what that process was asked for.
    """

    def __init__(
        self,
        client: WorkerClient,
        session: "Stepper",
        shaper: PoseFilter,
        channel: Channel,
        take: TakeWriter | None,
        cameras: Mapping[str, Any],
    ) -> None:
        self._client = client
        self._kept = take
        self._poses_ahead = _POSES_AHEAD if is_simulated(cameras) else None
        self._repeatable = is_repeatable(cameras)
        self._live = is_live(cameras)
        self._session = session
        self._shaper = shaper
        self._channel = channel
        self._pending: deque[bytes] = deque()
        self._first_frame = self._last_frame = b""
        self._seam: Seam | None = None  # until the first frame behind it
        self._cause = ""
        self._shift = Shift()
        self._solved: bytes | None = None  # ahead of time: Blender has it as soon as it has taken the last
        self._pose: PerformerPose | None = None  # the last
        self._blind = 0  # images of single cameras that were of no use
        self._told_s = 0.0
        self._stop_asked_s = 0.0
        self._error: PerfanimError | None = None

    def expect(self, seam: Seam, cause: str) -> None:
        """Take the next frame for the first after a process was replaced; `cause` says why, in plain words."""
        self._seam, self._cause = seam, cause

    def run(self) -> None:
        """Go on until the cameras' process has ended and all its frames are solved; raises what ended it early."""
        while self._solved or self._pending or not (self._client.ended or self._error):
            if self._live:  # other sources give way to all else on the machine: they may stand still for long
                self._channel.alive_s = time.monotonic()
            self._collect()
            if self._channel.gone.is_set():  # the frames are kept; their poses can be solved at any time
                self._pending.clear()
                self._solved = None
            if self._solved is not None and not self._is_far_ahead():
                self._hand_over(self._solved)
            elif self._solved is not None and self._poses_ahead is not None:
                self._channel.wait_taken(self._poses_ahead - 1, _FULL_S)
            elif self._pending:
                self._solved = self._solve(self._pending.popleft())
            else:
                self._client.wait(_IDLE_S)
        self._channel.alive_s = None
        if self._error is not None:
            raise self._error

    def _is_far_ahead(self) -> bool:
        """Whether Blender has yet to take as many poses as may wait for it."""
        if self._poses_ahead is None or self._channel.stop_requested.is_set():
            return False
        return self._channel.frames - self._channel.taken >= self._poses_ahead

    def _collect(self) -> None:
        if self._error is not None:
            return
        try:
            self._watch_stop()
            for message in self._poll():
                self._take(message)
        except PerfanimError as error:
            self._error = error  # what has arrived is solved all the same

    def _poll(self) -> list[Message]:
        """Return what the cameras' process has sent; one that died or hangs is replaced."""
        try:
            return self._client.poll()
        except CaptureError as error:
            if not self._last_frame or not self._client.may_restart or self._channel.stop_requested.is_set():
                raise
            cause = f"the cameras' process {error.what}"
        (_, first), (stamp_s, last) = unpack_stamped(self._first_frame), unpack_stamped(self._last_frame)
        seam = Seam.after((first.number, first.time_s), (last.number, last.time_s), stamp_s)
        self.expect(seam, cause)
        self._channel.send_warning(f"{cause}: starting it again", standing=True)
        self._client.restart(after=last.number)
        return []

    def _watch_stop(self) -> None:
        if not self._channel.stop_requested.is_set():
            return
        if not self._stop_asked_s:
            self._stop_asked_s = time.monotonic()
            self._client.request_stop()
        elif time.monotonic() - self._stop_asked_s > (GONE_LIMIT_S if self._channel.gone.is_set() else STOP_LIMIT_S):
            raise CaptureError("the cameras did not stop in time", advice="unplug the camera that hangs")

    def _take(self, message: Message) -> None:
        if message.kind is MessageKind.FRAME:
            self._take_frame(message.payload)
        elif message.kind is MessageKind.STATUS:
            content = message.json()
            self._channel.send_status(str(content.get("activity", "")), content.get("fraction"))
        elif message.kind is MessageKind.WARNING:
            content = message.json()
            text = str(content.get("text", ""))
            self._channel.send_warning(text, standing=bool(content.get("standing")))
            if self._kept is not None and text:
                self._kept.add_event(text)
        elif message.kind is MessageKind.PREVIEW:
            self._channel.send_preview(self._labelled(message.preview()))
        elif message.kind is MessageKind.END:
            self._channel.final["handed_over"] = self._client.earlier_frames + int(message.json().get("frames", -1))
        elif message.kind is MessageKind.ERROR:
            raise message.error()

    def _labelled(self, pictures: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return what the cameras see with the names of the markers as they were solved last."""
        from ...vision.blob_preview import draw_labels  # this process needs no OpenCV otherwise

        rig, pose = self._session.rig, self._pose
        if rig is None or pose is None or pose.confidence == 0.0:
            return pictures
        seen = np.isfinite(pose.observed_m[:, 0]) | (pose.single_cameras >= 0)
        return draw_labels(self._session.subject.marker_set.names, pose.markers_m, seen, rig, pictures)

    def _take_frame(self, record: bytes) -> None:
        if self._seam is not None:
            self._join(self._seam, *unpack_stamped(record))
        if self._shift != _NO_SHIFT:
            stamp_s, frame = unpack_stamped(record)
            record = pack_stamped(stamp_s, self._shift.applied(frame))
        self._first_frame, self._last_frame = self._first_frame or record, record
        self._pending.append(record)
        if self._kept is not None:
            self._kept.add_frame(record)

    def _join(self, seam: Seam, stamp_s: float, frame: MarkerFrame) -> None:
        """Find how numbers and times go on with this frame, and keep how much is missing before it."""
        self._seam = None
        self._shift = _NO_SHIFT if self._repeatable else seam.shift(stamp_s, frame)
        missing_s = seam.missing_s(self._shift.applied(frame))
        if self._kept is not None:
            text = f"{self._cause}: started again, {missing_text(missing_s)}"
            self._kept.add_gap(text, seam.number, missing_s)
        self._channel.send_warning("", standing=True)
        self._channel.send_warning(f"{self._cause}: it was started again, {missing_text(missing_s)}")

    def _solve(self, record: bytes) -> bytes:
        stamp_s, frame = unpack_stamped(record)
        started_s = time.perf_counter()
        pose = self._pose = self._session.step(frame)
        solved = TimedPose(pose, stamp_s, time.perf_counter() - started_s, len(self._pending))
        record = pack_solved(solved)
        if self._kept is not None:
            self._kept.add_pose(record)
        self._tell_cameras(frame)
        tuned, self._channel.tuned = self._channel.tuned, None
        if tuned is not None:
            self._shaper.tune(FilterSettings.of_table(tuned))
        shown = self._shaper.step(pose)
        return record if shown is pose else pack_solved(replace(solved, pose=shown))

    def _tell_cameras(self, frame: MarkerFrame) -> None:
        """Tell now and then how far apart the cameras' images are in time, and how many were of no use."""
        times_s = [time_s for time_s in frame.camera_times_s.tolist() if not math.isnan(time_s)]
        self._blind += len(frame.camera_times_s) - len(times_s)
        now_s = time.monotonic()
        if now_s - self._told_s < _TOLD_EVERY_S or len(frame.camera_times_s) < 2:
            return
        self._told_s = now_s
        skew_s = times_s[-1] - times_s[0] if len(times_s) == len(frame.camera_times_s) else None
        self._channel.send_status(self._channel.activity, skew_s=skew_s, blind=self._blind)

    def _hand_over(self, record: bytes) -> None:
        self._solved = None
        self._channel.send_pose(record)
        self._client.confirm_taken(self._channel.frames)
