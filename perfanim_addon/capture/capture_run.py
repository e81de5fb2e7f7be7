"""State of one live capture, independent of Blender."""

import math
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from ...core.body.scene_pose import ScenePose
from ...core.errors import CaptureError, PerfanimError
from ...core.geometry.arrays import Image
from ...core.session.pose_filters import FilterSettings
from ...core.system.slowness import SLOWNESS
from ...core.worker.client import WorkerClient
from ...core.worker.job_status import JobStatus
from ...core.worker.protocol import Message, MessageKind
from ...core.worker.restart_point import RestartPoint
from ...core.worker.restarting_client import RestartingClient
from .pose_log import PoseLog
from .tuning import TUNING


class Phase(Enum):
    """Phases of a capture."""

    STARTING = "starting"
    RUNNING = "capturing"
    FINISHING = "finishing"
    DONE = "done"


@dataclass
class Statistics:
    """Statistics of a running capture."""

    received: int = 0  # number of poses
    lost: int = 0  # number of frames missing in the source, by their numbers
    waiting: int = 0  # number of marker frames in the solver's queue
    frames_per_s: float = 0.0  # poses received in the last second
    latency_s: float = 0.0  # time from the images' arrival to the pose on the armature, newest frame
    solve_s: float = 0.0  # time in the solver, newest frame
    confidence: float = 0.0  # confidence of the newest pose, 0 to 1
    not_shown: int = 0  # number of poses that newer ones replaced before display; they are recorded nevertheless
    blind: int = 0  # number of unusable images (late, repeated, black) of all cameras together
    skew_s: float | None = None  # delay of the last camera's image relative to the first's; None if unknown
    handed_over: int = -1  # number of marker frames sent by the camera process; -1 until it ends
    slowness: float = 1.0  # duration of work relative to an idle machine


class CaptureRun:
    """One capture; a worker that dies or hangs is replaced, and the capture continues.

    The workers' `temporary` file is removed at the end, because killed workers cannot do so.
    """

    def __init__(
        self, client: WorkerClient, clock: Callable[[], float] = time.perf_counter, temporary: str = ""
    ) -> None:
        self._temporary = temporary
        self.phase = Phase.STARTING
        self.activity = "starting the worker"
        self.fraction: float | None = None
        self.poses = PoseLog()
        self.warnings: list[str] = []
        self.persistent_warning = ""  # warning that the worker has not withdrawn
        self.error: PerfanimError | None = None
        self.statistics = Statistics()
        self._client = client
        self._solver_process = RestartingClient(client, "the solver process", self._on_restart)
        self._clock = clock
        self._arrivals: deque[float] = deque()
        self._stamp = 0.0
        self._preview: Message | None = None
        self._taken = 0  # number of poses received, including repeated ones
        self._restarting = ""  # message until the first pose of the restarted worker
        self._last_arrival = self._stop_asked = clock()

    @property
    def notices(self) -> list[str]:
        """Messages about current problems, the most important one first."""
        silent_s = self._clock() - self._last_arrival
        is_busy = self.statistics.slowness > SLOWNESS.busy
        found = [self._restarting, self.persistent_warning]
        if self.phase is Phase.RUNNING and silent_s > TUNING.freeze_notice_s and not is_busy:
            found.append(f"no images for {silent_s:.1f} s")
        else:
            found += [note.text for note in self.poses[-1].notes if not note.is_decision] if self.poses else []
        found += self.warnings[-1:]
        if is_busy:
            times = min(TUNING.slownesses, key=lambda each: abs(math.log(each / self.statistics.slowness)))
            found.append(f"this computer is busy: work takes {times} times as long as usual; close other programs")
        return list(dict.fromkeys(filter(None, found)))

    @property
    def notice(self) -> str:
        """The most important of the notices, "" if there is none."""
        return next(iter(self.notices), "")

    def tick(self) -> ScenePose | None:
        """Receive waiting poses; return the newest if it is new. Call `shown` afterwards."""
        if self.phase is Phase.DONE:
            return None
        before, taken = len(self.poses), self._taken
        try:
            for message in self._solver_process.poll():
                self._take(message)
        except PerfanimError as error:
            self.error = self.error or error
            self.phase = Phase.DONE
        now = self._clock()
        while self._arrivals and now - self._arrivals[0] > TUNING.rate_window_s:
            self._arrivals.popleft()
        self.statistics.frames_per_s = len(self._arrivals) / TUNING.rate_window_s
        if self._taken > taken:
            self._client.acknowledge(self._taken)
        if len(self.poses) > before:
            self.statistics.not_shown += len(self.poses) - before - 1
        if self._client.ended:
            self.phase = Phase.DONE
        elif self._stop_overdue():
            self.phase = Phase.DONE
            self.error = self.error or CaptureError(
                "the solver did not end in time, so the last frames may be missing",
                advice="check the end of the action",
            )
        return self.poses[-1] if len(self.poses) > before else None

    def _on_restart(self, point: RestartPoint, cause: str) -> None:
        self._restarting = f"{cause}: restarting it"

    def take_preview(self) -> Image | None:
        """Return a new picture of the cameras (height, width, 3), RGB, or None."""
        message, self._preview = self._preview, None
        return None if message is None else message.preview()

    def shown(self) -> None:
        """Measure the latency of the newest pose, which is now on the armature."""
        self.statistics.latency_s = self._clock() - self._stamp

    def tune(self, settings: FilterSettings) -> None:
        """Change the settings of the worker's pose filter (see `core.session.pose_filters`)."""
        self._client.set_filter(settings)

    def stop(self) -> None:
        """Request a clean end; call `tick` until the phase is DONE."""
        if self.phase in (Phase.STARTING, Phase.RUNNING):
            self.phase = Phase.FINISHING
            self.activity = self.phase.value
            self._stop_asked = self._clock()
            self._client.request_stop()

    def close(self) -> None:
        """End the worker process; `poses` keeps the solved ones."""
        self.phase = Phase.DONE
        self._client.close()
        if self._temporary:
            with suppress(OSError):
                Path(self._temporary).unlink(missing_ok=True)

    def _stop_overdue(self) -> bool:
        silent_s = self._clock() - max(self._stop_asked, self._last_arrival)
        return self.phase is Phase.FINISHING and silent_s > TUNING.stop_limit_s * self.statistics.slowness

    def _take(self, message: Message) -> None:
        if message.kind is MessageKind.POSE:
            self._take_pose(message)
        elif message.kind is MessageKind.STATUS:
            self._note_status(message.status())
        elif message.kind is MessageKind.WARNING:
            text = str(message.json().get("text", ""))
            if message.json().get("standing"):
                self.persistent_warning = text
            else:
                self.warnings.append(text)
        elif message.kind is MessageKind.PREVIEW:
            self._preview = message
        elif message.kind is MessageKind.ERROR:
            self.error = self.error or message.error()
        elif message.kind is MessageKind.END:
            self.statistics.handed_over = message.count("handed_over")

    def _note_status(self, status: JobStatus) -> None:
        self.statistics.slowness = status.slowness or self.statistics.slowness
        if self.phase is Phase.STARTING and status.activity is not None:
            self.activity, self.fraction = status.activity, status.fraction
        elif status.blind is not None:
            self.statistics.skew_s, self.statistics.blind = status.skew_s, status.blind

    def _take_pose(self, message: Message) -> None:
        solved = message.pose()
        figures = self.statistics
        self._taken += 1
        if self.poses and solved.pose.number <= self.poses[-1].number:
            return  # a restarted worker repeats poses that were not in the take yet
        if self.poses:
            figures.lost += max(0, solved.pose.number - self.poses[-1].number - 1)
        self.poses.append(message.payload, solved.pose)
        figures.received += 1
        figures.waiting = solved.waiting
        figures.solve_s = solved.solve_s
        figures.confidence = solved.pose.performers[0].confidence
        self._stamp = solved.stamp_s
        self._solver_process.note_frame(solved.pose.number, solved.pose.time_s, solved.stamp_s)
        self._restarting = ""
        self._last_arrival = self._clock()
        self._arrivals.append(self._last_arrival)
        if self.phase is Phase.STARTING:
            self.phase = Phase.RUNNING
            self.activity = self.phase.value
