"""Main loop of a capture: poll the camera process, record, solve, filter, send."""

import time
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...body.scene_pose import PerformerPose, ScenePose
from ...errors import CaptureError, PerfanimError
from ...formats.take_file.pose_codec import TimedPose, pack_solved
from ...formats.take_file.take_writer import TakeWriter
from ...geometry.arrays import Image
from ...markers.marker_frame import MarkerFrame
from ...markers.marker_set import PointKind
from ...markers.source_noise import noise_of
from ...session.delayed_poses import DelayedPoses
from ..channel import Channel
from ..client import WorkerClient
from ..protocol import Message, MessageKind
from ..restart_point import RestartPoint
from ..restarting_client import RestartingClient
from ..worker_settings import WORKER
from .capture_stages import CameraReport, FrameRecorder, PoseOutput

if TYPE_CHECKING:
    from ...session.multi_target_session import MultiTargetSession


class CaptureLoop:
    """Solves every marker frame in order and drops none.

    Args:
        take: Take to which poses and events are written; None for no take.
        is_live: The source cannot wait; other sources may pause for a long time.
    """

    def __init__(
        self,
        client: WorkerClient,
        recorder: FrameRecorder,
        session: "MultiTargetSession",
        output: PoseOutput,
        channel: Channel,
        take: TakeWriter | None,
        *,
        is_live: bool,
    ) -> None:
        self._client = client
        self._cameras = RestartingClient(client, "the camera process", self._on_restart)
        self._recorder = recorder
        self._session = session
        self._output = output
        self._channel = channel
        self._take = take
        self._is_live = is_live
        self._report = CameraReport(channel)
        self._frames: deque[tuple[float, MarkerFrame]] = deque()  # recorded but not solved yet
        self._pose: PerformerPose | None = None  # the last pose
        self._delayed = DelayedPoses(noise_of(session.subjects[0].marker_set.points))
        self._held: deque[TimedPose] = deque()  # solved, but the zero-lag filter still waits for later poses
        self._solved = 0  # number of frames
        self._stop_asked_s = 0.0
        self._error: PerfanimError | None = None

    def run(self) -> None:
        """Loop until all frames are solved; then raise the camera process's error, if there was one."""
        while self._output.is_ready or self._frames or not (self._client.ended or self._error):
            if self._is_live:
                self._channel.progress_s = time.monotonic()
            self._receive()
            if self._channel.disconnected.is_set():  # the frames are in the take and can be solved later
                self._frames.clear()
                self._output.drop()
            if self._output.is_ready:
                if self._output.send():
                    self._client.acknowledge(self._solved)
            elif self._frames:
                self._solve(*self._frames.popleft())
            else:
                self._client.wait(WORKER.idle_s)
        self._end()
        self._channel.progress_s = None
        if self._error is not None:
            raise self._error

    def _receive(self) -> None:
        if self._error is not None:
            return
        try:
            self._pass_stop_on()
            for message in self._cameras.poll():
                self._on_message(message)
        except PerfanimError as error:
            self._error = error  # frames that have arrived are still solved

    def _pass_stop_on(self) -> None:
        if not self._channel.stop_requested.is_set():
            return
        if not self._stop_asked_s:
            self._stop_asked_s = time.monotonic()
            self._client.request_stop()
        is_alone = self._channel.disconnected.is_set()
        limit_s = WORKER.orphan_stop_s if is_alone else WORKER.stop_s * self._channel.slowness.factor
        if time.monotonic() - self._stop_asked_s > limit_s:
            raise CaptureError("the cameras did not stop in time", advice="unplug the camera that does not respond")

    def _on_restart(self, point: RestartPoint, cause: str) -> None:
        self._recorder.expect_restart(point, cause)
        self._channel.send_warning(f"{cause}: restarting it", standing=True)

    def _on_message(self, message: Message) -> None:
        if message.kind is MessageKind.FRAME:
            stamp_s, frame = self._recorder.record(message.payload)
            self._cameras.note_frame(frame.number, frame.time_s, stamp_s)
            self._frames.append((stamp_s, frame))
        elif message.kind is MessageKind.STATUS:
            status = message.status()
            self._channel.slowness.beside = self._client.slowness
            if status.activity is not None:
                self._channel.send_status(status.activity, status.fraction)
        elif message.kind is MessageKind.WARNING:
            content = message.json()
            text = str(content.get("text", ""))
            self._channel.send_warning(text, standing=bool(content.get("standing")))
            if self._take is not None and text:
                self._take.add_event(text)
        elif message.kind is MessageKind.PREVIEW:
            self._channel.send_preview(self._draw_labels(message.preview()))
        elif message.kind is MessageKind.END:
            self._channel.final["handed_over"] = self._client.earlier_frames + message.count("frames")
        elif message.kind is MessageKind.ERROR:
            raise message.error()

    def _draw_labels(self, pictures: Image) -> Image:
        """Draw the names of the last solved markers in the cameras' pictures; keypoints are drawn as a skeleton."""
        from ...vision.blob_preview import draw_labels  # loaded late: nothing else in this process needs OpenCV

        rig, pose, worn = self._session.rig, self._pose, self._session.subjects[0].marker_set
        if rig is None or pose is None or pose.confidence == 0.0 or worn.points is PointKind.KEYPOINTS:
            return pictures
        seen = np.isfinite(pose.observed_m[:, 0]) | (pose.single_cameras >= 0)
        return draw_labels(worn.names, pose.markers_m, seen, rig, pictures)

    def _solve(self, stamp_s: float, frame: MarkerFrame) -> None:
        started_s, processor_s = time.perf_counter(), time.thread_time()
        pose = self._session.step(frame)
        self._pose = pose.performers[0]
        solved = TimedPose(pose, stamp_s, time.perf_counter() - started_s, len(self._frames))
        self._channel.slowness.add(solved.solve_s, time.thread_time() - processor_s)
        self._solved += 1
        self._held.append(solved)
        self._report.update(frame)
        calm = self._delayed.step(pose)
        if self._output.is_immediate:
            self._output.put(solved, None)
        if calm is not None:
            self._keep(calm)
        if not self._output.is_ready:  # the filter still waits for later poses: no pose is sent for this frame
            self._client.acknowledge(self._solved)

    def _end(self) -> None:
        """Write and send the last poses, which are filtered without later ones."""
        for pose in self._delayed.rest():
            self._keep(pose)
            while self._output.is_ready and not self._channel.disconnected.is_set():
                self._output.send()

    def _keep(self, pose: ScenePose) -> None:
        """Write the oldest held frame's filtered pose to the take; send it unless it was already sent unfiltered."""
        calm = replace(self._held.popleft(), pose=pose)
        record = None
        if self._take is not None:
            record = pack_solved(calm)
            self._take.add_pose(record)
        if not self._output.is_immediate:
            self._output.put(calm, record)
