"""Blender's side of a worker: starts, polls, ends and replaces its process.

This side has no threads. The worker queues messages while Blender is slow, so none is lost and neither side blocks.
"""

import time
from collections import deque
from collections.abc import Mapping
from typing import Any

from ..errors import CaptureError
from ..session.pose_filters import FilterSettings
from ..system.schema import table_of
from .child_process import ChildProcess
from .connection import WorkerConnection
from .liveness import Liveness
from .protocol import Message, MessageKind, encode, encode_json
from .requests import Request
from .restart_point import RestartPoint
from .worker_settings import WORKER


class RestartPolicy:
    """Limit on restarts: a few in total, or a few per minute if each new process sends frames."""

    def __init__(self) -> None:
        self._restarts_s: deque[float] = deque(maxlen=WORKER.restarts)

    def note_restart(self) -> None:
        """Count a restart."""
        self._restarts_s.append(time.monotonic())

    def allows_restart(self, works: bool) -> bool:
        """Return whether another restart is allowed; `works` says that the process has sent new frames."""
        is_full = len(self._restarts_s) == WORKER.restarts
        return not is_full or (works and time.monotonic() - self._restarts_s[0] >= WORKER.restarts_within_s)


class WorkerClient:
    """One worker process with one job.

    A process that sent frames and then died or hung can be replaced (`may_restart`, `restart`).

    Args:
        request: Request of the job, or its JSON object.
        python: Interpreter; must not be Blender's own executable.

    Raises:
        CaptureError: The process could not be started.
    """

    def __init__(self, request: Request | Mapping[str, Any], python: str | None = None) -> None:
        self._request = request.to_json() if isinstance(request, Request) else dict(request)
        self._python = python
        self._policy = RestartPolicy()
        self._stop_asked = False
        self.earlier_frames = 0  # frames or poses from the processes that were replaced
        self._launch()

    def _launch(self) -> None:
        self.ended = False  # the worker has sent END
        self._early: list[Message] = []  # messages received before the first poll
        self._liveness = Liveness()
        self._connection = WorkerConnection(self._request)
        job = str(self._request.get("job", ""))
        try:
            self._process = ChildProcess(self._connection.port, self._connection.token, job, self._python)
        except CaptureError:
            self._connection.close()
            raise

    @property
    def process_id(self) -> int:
        """Process id of the worker that is running now; it changes with a restart."""
        return self._process.id

    @property
    def running(self) -> bool:
        """Whether the process is running."""
        return self._process.status is None

    def ask(self, after: RestartPoint | None) -> None:
        """Wait until the process has received its request; from then on it works on its own.

        Args:
            after: Last frame of the previous process.

        Raises:
            CaptureError: As in `poll`.
        """
        self._go_on_after(after)
        while not self._connection.is_authenticated:
            self.wait(WORKER.retry_s)
            self._early = self.poll()

    def poll(self) -> list[Message]:
        """Return all complete messages that have arrived since the last call; never waits.

        Raises:
            CaptureError: The worker died, hangs, or sent a damaged message.
        """
        early, self._early = self._early, []
        if self.ended:
            return early
        messages = self._connection.receive()
        self._connection.send()
        if not messages and not self.running:
            messages = self._connection.receive()  # messages sent before it died
            # on a busy machine they arrive after its end, but before that of the connection
            if not messages and not self._connection.is_open:
                status = ", ".join(filter(None, (f"status {self._process.status}", self._connection.fault)))
                reason = f"ended unexpectedly ({status}){self._process.last_line()}"
                raise CaptureError(reason, where="worker", advice="start again")
        self._liveness.update(messages)
        self.ended = any(message.kind is MessageKind.END for message in messages)
        self._liveness.check(self._connection.is_authenticated)
        return early + messages

    @property
    def slowness(self) -> float:
        """Duration of the process's work relative to an idle machine."""
        return self._liveness.slowness

    def wait(self, limit_s: float) -> None:
        """Wait until there is something to poll, at most `limit_s`."""
        self._connection.wait(limit_s)

    @property
    def may_restart(self) -> bool:
        """Whether a worker that died can be replaced: only if this process or an earlier one has sent frames."""
        works = self._liveness.frames > 0
        return (works or self.earlier_frames > 0) and not self._stop_asked and self._policy.allows_restart(works)

    def restart(self, after: RestartPoint | None = None, cause: str = "") -> None:
        """Replace the process with a new one.

        Args:
            after: Last frame of the previous process.
            cause: Reason for the replacement, for the user.

        Raises:
            CaptureError: The process could not be started.
        """
        self._policy.note_restart()
        self._connection.close()
        self._process.kill()
        self.earlier_frames += self._liveness.frames
        self._go_on_after(after)
        self._request["cause"] = cause
        self._launch()

    def _go_on_after(self, point: RestartPoint | None) -> None:
        if point is not None:
            self._request["after"] = table_of(point)

    def acknowledge(self, frames: int) -> None:
        """Tell the worker how many frames have been processed, including those from earlier processes."""
        self._connection.send(encode_json(MessageKind.ACK, {"frames": max(frames - self.earlier_frames, 0)}))

    def set_filter(self, settings: FilterSettings) -> None:
        """Set the pose filter of this process and of its replacements."""
        self._request["shape"] = settings.table()
        if self._connection.is_authenticated:
            self._connection.send(encode_json(MessageKind.FILTER, settings.table()))

    def request_again(self, request: Request) -> None:
        """Send a further request to a connected job that accepts several."""
        self._connection.send(encode_json(MessageKind.REQUEST, request.to_json()))

    @property
    def connected(self) -> bool:
        """Whether the process is connected and has received its first request."""
        return self._connection.is_authenticated

    def request_stop(self) -> None:
        """Ask the worker to end cleanly; keep calling `poll` until `ended`."""
        self._stop_asked = True
        self._connection.send(encode(MessageKind.STOP))

    def close(self, grace_s: float = 1.0) -> None:
        """End the process and release everything; safe to call twice."""
        self._connection.close()
        self._process.end(grace_s)
        self._process.release()
        self.ended = True
