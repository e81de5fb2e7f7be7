"""A live capture: marker frames from the cameras' process through one session, poses to Blender.

Three processes share the work: the cameras' (OpenCV), this one (the solver) and Blender, whose only thread then has
nothing to do but to put poses on the armature, so that the window stays as quick as without a capture. Every marker
frame that the cameras' process hands over is solved here in order and handed on; nobody drops or waits.

Request: "cameras" (request of `camera_job`), "subject" (file), "database" (file), "settings" (of `SolveSettings`).
"""

import os
import time
from collections import deque
from collections.abc import Mapping
from typing import Any

from ..camera import CameraRig, load_rig
from ..database.store import open_database
from ..errors import CaptureError, PerfanimError, SettingsError
from ..marker_set import load_subject
from ..pose_bytes import SolvedPose
from ..session import Session
from ..simulate.studio.rig import default_rig
from ..solver.settings import SolveSettings
from .channel import Channel
from .client import WorkerClient
from .protocol import Message, MessageKind

STOP_LIMIT_S = 5.0
_IDLE_S = 0.02
_FULL_S = 0.25
_RECORDED_NICENESS = 14
_SIMULATED_NICENESS = 10
_FRAMES_AHEAD = 2  # of the solver, for sources that can wait
# The simulated performer keeps step with the window: each redraw shows its next frame. On a machine that draws slowly,
# what is computed for poses that nobody sees would be taken from the drawing. Recorded images do run ahead.
_POSES_AHEAD = 1


def run(request: Mapping[str, Any], channel: Channel) -> None:
    """Hand over poses until STOP or the end of the source.

    Raises:
        PerfanimError: a file is bad, or the cameras' process failed.
    """
    cameras = dict(request["cameras"])
    kind = cameras["source"].get("kind")
    if kind != "cameras":
        _give_way(_SIMULATED_NICENESS if kind == "simulated" else _RECORDED_NICENESS)
        cameras["in_flight"] = _FRAMES_AHEAD
    channel.send_status("opening the cameras")
    client = WorkerClient({**cameras, "job": "cameras"})
    try:
        ahead = _POSES_AHEAD if kind == "simulated" else None
        _Relay(client, _session(request, cameras), channel, ahead).run()
    finally:
        client.close()


def _give_way(niceness: int) -> None:
    """Let Blender go first: recorded and simulated images can wait, a window cannot (real cameras cannot either)."""
    if hasattr(os, "nice"):
        os.nice(niceness)


def _session(request: Mapping[str, Any], cameras: Mapping[str, Any]) -> Session:
    try:
        settings = SolveSettings(**request.get("settings", {}))
    except TypeError as error:
        raise SettingsError(str(error), where="solver") from error
    subject, database = load_subject(request["subject"]), open_database(request["database"])
    return Session(subject, database, _rig(cameras), settings)


def _rig(cameras: Mapping[str, Any]) -> CameraRig:
    return load_rig(str(cameras["rig"])) if cameras.get("rig") else default_rig()


class _Relay:
    """Takes messages of the cameras' process, solves frames, hands everything on."""

    def __init__(self, client: WorkerClient, session: Session, channel: Channel, poses_ahead: int | None) -> None:
        self._client = client
        self._poses_ahead = poses_ahead
        self._session = session
        self._channel = channel
        self._pending: deque[Message] = deque()
        self._solved: SolvedPose | None = None  # ahead of time: Blender has it as soon as it has taken the last
        self._stop_asked_s = 0.0
        self._error: PerfanimError | None = None

    def run(self) -> None:
        """Go on until the cameras' process has ended and all its frames are solved; raises what ended it early."""
        while self._solved or self._pending or not (self._client.ended or self._error):
            self._collect()
            if self._solved is not None and not self._is_far_ahead():
                self._hand_over(self._solved)
            elif self._solved is not None and self._poses_ahead is not None:
                self._channel.wait_taken(self._poses_ahead - 1, _FULL_S)
            elif self._pending:
                self._solved = self._solve(self._pending.popleft())
            else:
                self._client.wait(_IDLE_S)
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
            for message in self._client.poll():
                self._take(message)
        except PerfanimError as error:
            self._error = error  # what has arrived is solved all the same

    def _watch_stop(self) -> None:
        if not self._channel.stop_requested.is_set():
            return
        if not self._stop_asked_s:
            self._stop_asked_s = time.monotonic()
            self._client.request_stop()
        elif time.monotonic() - self._stop_asked_s > STOP_LIMIT_S:
            raise CaptureError("the cameras did not stop in time", advice="unplug the camera that hangs")

    def _take(self, message: Message) -> None:
        if message.kind is MessageKind.FRAME:
            self._pending.append(message)
        elif message.kind is MessageKind.STATUS:
            content = message.json()
            self._channel.send_status(str(content.get("activity", "")), content.get("fraction"))
        elif message.kind is MessageKind.WARNING:
            self._channel.send_warning(str(message.json().get("text", "")))
        elif message.kind is MessageKind.END:
            self._channel.final["handed_over"] = int(message.json().get("frames", -1))
        elif message.kind is MessageKind.ERROR:
            raise message.error()

    def _solve(self, message: Message) -> SolvedPose:
        stamp_s, frame = message.frame()
        started_s = time.perf_counter()
        pose = self._session.step(frame)
        return SolvedPose(pose, stamp_s, time.perf_counter() - started_s, len(self._pending))

    def _hand_over(self, solved: SolvedPose) -> None:
        self._solved = None
        self._channel.send_pose(solved)
        self._client.confirm_taken(self._channel.frames)
