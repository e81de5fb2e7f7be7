"""The course of one live capture, without Blender: marker frames in, poses out, nothing lost.

Every frame that the worker hands over is solved and kept, however rarely `tick` is called; only the newest pose of a
tick is meant to be shown. Solving is cut into slices, so that a backlog never freezes the window.
"""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from ..core.errors import CaptureError, PerfanimError
from ..core.marker_frame import MarkerFrame
from ..core.pose_frame import PoseFrame
from ..core.worker.protocol import Message, MessageKind

LEAST_BUDGET_S = 0.1
MOST_BUDGET_S = 0.5
STOP_LIMIT_S = 5.0
FREEZE_NOTICE_S = 1.0
_RATE_WINDOW_S = 1.0


class Phase(Enum):
    """Where a capture stands."""

    STARTING = "starting"
    RUNNING = "capturing"
    FINISHING = "solving the last frames"
    DONE = "done"


class Client(Protocol):
    """What a capture needs of a worker client."""

    ended: bool

    def poll(self) -> list[Message]: ...  # noqa: D102

    def request_stop(self) -> None: ...  # noqa: D102

    def close(self) -> None: ...  # noqa: D102


class Solver(Protocol):
    """What a capture needs of a session."""

    def step(self, frame: MarkerFrame) -> PoseFrame: ...  # noqa: D102


@dataclass
class Statistics:
    """Figures of a running capture.

    Args:
        received, solved: marker frames so far.
        lost: frame numbers that the source left out.
        frames_per_s: frames solved in the last second.
        latency_s: from the images in hand to the pose on the armature, newest frame.
        solve_s: time in the solver, newest frame.
        confidence: of the newest pose, 0 to 1.
        announced: frames that the worker says it handed over in all; -1 until it has ended.
    """

    received: int = 0
    solved: int = 0
    lost: int = 0
    frames_per_s: float = 0.0
    latency_s: float = 0.0
    solve_s: float = 0.0
    confidence: float = 0.0
    announced: int = -1


class CaptureRun:
    """One capture.

    Args:
        client: of the worker that was asked to capture.
        solver: session that solves the frames in order.
        clock: `time.perf_counter`, the clock of the frames' stamps.
    """

    def __init__(self, client: Client, solver: Solver, clock: Callable[[], float] = time.perf_counter) -> None:
        self.phase = Phase.STARTING
        self.activity = "starting the worker"
        self.fraction: float | None = None
        self.poses: list[PoseFrame] = []
        self.warnings: list[str] = []
        self.error: PerfanimError | None = None
        self.statistics = Statistics()
        self._client = client
        self._solver = solver
        self._clock = clock
        self._pending: deque[Message] = deque()
        self._solved_at: deque[float] = deque()
        self._stamp = 0.0
        self._last_number: int | None = None
        self._last_arrival = self._stop_asked = self._ticked = clock()
        self._nothing_follows = False

    @property
    def behind(self) -> int:
        """Marker frames that have arrived and are not solved yet."""
        return len(self._pending)

    @property
    def notice(self) -> str:
        """What is wrong at the moment, in plain words; "" when all is well."""
        silent_s = self._clock() - self._last_arrival
        if self.phase is Phase.RUNNING and silent_s > FREEZE_NOTICE_S:
            return f"no images for {silent_s:.0f} s"
        if self.poses and self.poses[-1].notes:
            return "; ".join(self.poses[-1].notes)
        return self.warnings[-1] if self.warnings else ""

    def tick(self) -> PoseFrame | None:
        """Take what the worker has sent and solve it; never waits.

        Solving may take as long as whatever else was done since the last tick (drawing, mostly), within limits: so it
        keeps pace with a slow viewport, and the window stays alive behind a backlog.

        Returns:
            The newest pose if there is a new one. After it is shown, call `shown`.
        """
        if self.phase is Phase.DONE:
            return None
        started = self._clock()
        budget_s = min(max(started - self._ticked, LEAST_BUDGET_S), MOST_BUDGET_S)
        self._collect()
        newest: PoseFrame | None = None
        while self._pending and (newest is None or self._clock() - started < budget_s):
            newest = self._solve(self._pending.popleft()) or newest
        self._count_rate()
        self._ticked = self._clock()
        if self.phase is Phase.FINISHING and not self._pending and self._is_over():
            self.phase = Phase.DONE
        return newest

    def shown(self) -> None:
        """Note that the newest pose stands on the armature now: its latency ends here."""
        self.statistics.latency_s = self._clock() - self._stamp

    def stop(self) -> None:
        """Ask for a clean end; go on calling `tick` until the phase is DONE."""
        if self.phase in (Phase.STARTING, Phase.RUNNING):
            self.phase = Phase.FINISHING
            self.activity = self.phase.value
            self._stop_asked = self._clock()
            self._client.request_stop()

    def close(self) -> None:
        """End the worker process; what is solved stays in `poses`."""
        self.phase = Phase.DONE
        self._client.close()

    def _is_over(self) -> bool:
        overdue = self._clock() - self._stop_asked > STOP_LIMIT_S
        return self._client.ended or self._nothing_follows or overdue

    def _collect(self) -> None:
        try:
            messages = self._client.poll()
        except PerfanimError as error:
            self._fail(error)
            return
        for message in messages:
            self._take(message)
        if self._client.ended and self.phase is not Phase.FINISHING:  # the source's end
            self.phase = Phase.FINISHING
            self.activity = self.phase.value
            self._nothing_follows = True

    def _take(self, message: Message) -> None:
        if message.kind is MessageKind.FRAME:
            self.statistics.received += 1
            self._last_arrival = self._clock()
            self._pending.append(message)
            if self.phase is Phase.STARTING:
                self.phase = Phase.RUNNING
                self.activity = self.phase.value
        elif message.kind is MessageKind.STATUS and self.phase is not Phase.FINISHING:
            content = message.json()
            self.activity = str(content.get("activity", self.activity))
            fraction = content.get("fraction")
            self.fraction = float(fraction) if isinstance(fraction, int | float) else None
        elif message.kind is MessageKind.WARNING:
            self.warnings.append(str(message.json().get("text", "")))
        elif message.kind is MessageKind.ERROR:
            content = message.json()
            self._fail(
                CaptureError(
                    str(content.get("what", "")),
                    where=str(content.get("where", "")),
                    advice=str(content.get("advice", "")),
                )
            )
        elif message.kind is MessageKind.END:
            self.statistics.announced = int(message.json().get("frames", -1))

    def _fail(self, error: PerfanimError) -> None:
        """Keep the error; what has arrived is still solved and kept."""
        self.error = self.error or error
        self.phase = Phase.FINISHING
        self._nothing_follows = True

    def _solve(self, message: Message) -> PoseFrame | None:
        started = self._clock()
        try:
            stamp, frame = message.frame()
            pose = self._solver.step(frame)
        except PerfanimError as error:
            self._fail(error)
            return None
        now = self._clock()
        figures = self.statistics
        if self._last_number is not None:
            figures.lost += max(0, frame.number - self._last_number - 1)
        self._last_number = frame.number
        self._stamp = stamp
        figures.solve_s = now - started
        figures.solved += 1
        figures.confidence = pose.confidence
        self._solved_at.append(now)
        self.poses.append(pose)
        return pose

    def _count_rate(self) -> None:
        now = self._clock()
        while self._solved_at and now - self._solved_at[0] > _RATE_WINDOW_S:
            self._solved_at.popleft()
        self.statistics.frames_per_s = len(self._solved_at) / _RATE_WINDOW_S
