"""Stages of a capture before and after the solver."""

import math
import time
from typing import TYPE_CHECKING

from ...formats.take_file.pose_codec import TimedPose, pack_solved
from ...formats.take_file.take_writer import TakeWriter
from ...markers.marker_frame import MarkerFrame
from ...markers.marker_frame_codec import pack_stamped, unpack_stamped
from ...session.pose_filters import FilterSettings, PoseFilter
from ..channel import Channel
from ..restart_point import FrameOffset, RestartPoint, gap_text
from ..worker_settings import WORKER

if TYPE_CHECKING:
    from ..vmc_sender import VmcSender


class FrameRecorder:
    """Unpacks each marker frame once and writes its bytes to the take, if there is one.

    Args:
        is_repeatable: Whether the source gives the same frame numbers and times when it is opened again.
    """

    def __init__(self, take: TakeWriter | None, channel: Channel, is_repeatable: bool) -> None:
        self._take = take
        self._channel = channel
        self._is_repeatable = is_repeatable
        self._offset = FrameOffset()
        self._restart: tuple[RestartPoint, str] | None = None  # a restart whose first frame is still awaited

    def expect_restart(self, point: RestartPoint, cause: str) -> None:
        """Treat the next frame as the first of a new process; `cause` says in plain words why there is one."""
        self._restart = point, cause

    def record(self, record: bytes) -> tuple[float, MarkerFrame]:
        """Write a packed frame to the take; return its stamp, and the frame with the capture's numbers and times."""
        stamp_s, frame = unpack_stamped(record)
        if self._restart is not None:
            point, cause = self._restart
            self._restart = None
            self._offset = FrameOffset() if self._is_repeatable else point.offset(stamp_s, frame)
            self._report_gap(point, cause, point.gap_s(self._offset.apply(frame)))
        if self._offset != FrameOffset():
            frame = self._offset.apply(frame)
            record = pack_stamped(stamp_s, frame)
        if self._take is not None:
            self._take.add_frame(record)
        return stamp_s, frame

    def _report_gap(self, point: RestartPoint, cause: str, gap_s: float) -> None:
        if self._take is not None:
            self._take.add_gap(f"{cause}: restarted, {gap_text(gap_s)}", point.number, gap_s)
        self._channel.send_warning("", standing=True)
        self._channel.send_warning(f"{cause}: it was restarted, {gap_text(gap_s)}")


class CameraReport:
    """Reports the skew between the cameras' images and the number of unusable images."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._unusable_images = 0  # total of all cameras
        self._reported_s = 0.0

    def update(self, frame: MarkerFrame) -> None:
        """Count the images of a frame, and send a report if it is due."""
        times_s = [time_s for time_s in frame.camera_times_s.tolist() if not math.isnan(time_s)]
        count = len(frame.camera_times_s)
        self._unusable_images += count - len(times_s)
        now_s = time.monotonic()
        if now_s - self._reported_s < WORKER.report_s or count < 2:
            return
        self._reported_s = now_s
        skew_s = times_s[-1] - times_s[0] if len(times_s) == count else None
        self._channel.send_status(self._channel.activity, skew_s=skew_s, blind=self._unusable_images)


class PoseOutput:
    """Filters poses and sends them over VMC, and to Blender as fast as it accepts them.

    Args:
        poses_ahead: Number of poses that may wait for Blender's acknowledgement; None for any number.
    """

    def __init__(
        self, pose_filter: PoseFilter, channel: Channel, poses_ahead: int | None, vmc: "VmcSender | None" = None
    ) -> None:
        self._filter = pose_filter
        self._channel = channel
        self._poses_ahead = poses_ahead
        self._vmc = vmc
        self._ready: bytes | None = None  # packed in advance, to be sent when the previous one is acknowledged

    @property
    def is_immediate(self) -> bool:
        """Whether poses are shown as soon as they are solved."""
        return self._filter.is_immediate

    @property
    def is_ready(self) -> bool:
        """Whether a pose is ready to be sent."""
        return self._ready is not None

    def put(self, solved: TimedPose, record: bytes | None) -> None:
        """Filter a pose, send it over VMC, and keep it for Blender.

        `record` is the pose as packed for the take; None if it was not written to a take.
        """
        settings = self._channel.take_filter_settings()
        if settings is not None:
            self._filter.set_settings(FilterSettings.of_table(settings))
        pose = self._filter.step(solved.pose)
        if self._vmc is not None:
            self._vmc.send(pose)
        if record is None or pose is not solved.pose:
            record = pack_solved(TimedPose(pose, solved.stamp_s, solved.solve_s, solved.waiting))
        self._ready = record

    def drop(self) -> None:
        """Drop the pose that is ready."""
        self._ready = None

    def send(self) -> bool:
        """Send the ready pose; if Blender lags, wait a little and return False."""
        if self._ready is None:
            return False
        channel, most = self._channel, self._poses_ahead
        if most is not None and channel.frames - channel.acknowledged >= most and not channel.stop_requested.is_set():
            channel.wait_for_ack(most - 1, WORKER.ack_s)
            return False
        self._channel.send_pose(self._ready)
        self._ready = None
        return True
