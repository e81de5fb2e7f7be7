"""Jobs in a worker process, with progress and a result."""

import time
from collections.abc import Sequence
from typing import Any

from ...core.errors import counted
from ...core.geometry.arrays import Image
from ...core.worker.client import WorkerClient
from ...core.worker.job_status import PoseCue
from ...core.worker.protocol import Message, MessageKind
from ...core.worker.requests import CommandRequest, Request

# before this share, and this time, nothing is said about the time left
_EARLY = 0.03
_EARLY_S = 5.0


def command(arguments: Sequence[str], gently: bool = False) -> CommandRequest:
    """Return the request for a command of `perfanim`; `gently` lowers its priority."""
    return CommandRequest(arguments=tuple(arguments), gently=gently)


class Job:
    """Job in a worker process, with progress and a result.

    Args:
        panel: Key of the panel that shows the job.
        request: Request for the worker.
        python: Interpreter of the worker; None for Blender's own.
        finishable: Whether the job can end early with the result so far.
        first: Job to run first, or None.
    """

    def __init__(
        self,
        title: str,
        panel: str,
        request: Request,
        python: str | None,
        finishable: bool = False,
        first: "Job | None" = None,
    ) -> None:
        self.title = title
        self.panel = panel
        self.finishable = finishable
        self.text = "starting"
        self.cue: PoseCue | None = None
        self.views = 0
        self.heading = ""  # progress shown in the panel's header
        self.fraction = 0.0
        self.summary: dict[str, Any] | None = None
        self._preview: Message | None = None
        self._first = first
        self._request, self._python = request, python
        self._client = None if first else WorkerClient(request, python)
        self._begun_s = time.monotonic()

    @property
    def time_left(self) -> str:
        """How much longer the job will take at its rate so far, in words; "" if that is not known yet."""
        spent_s = time.monotonic() - self._begun_s
        if self._first is not None or self.fraction < _EARLY or spent_s < _EARLY_S:
            return ""
        left_s = spent_s * (1.0 - self.fraction) / self.fraction
        return f"about {counted(round(left_s / 60.0), 'minute')} left" if left_s > 90.0 else f"{left_s:.0f} s left"

    @property
    def ended(self) -> bool:
        """Whether the worker is done."""
        return self._client is not None and self._client.ended

    def tick(self) -> None:
        """Read the worker's messages; raise the PerfanimError that ended the job."""
        if self._client is None:
            self._prepare()
            return
        for message in self._client.poll():
            self._on_message(message)

    def _prepare(self) -> None:
        """Advance the first job, and start this one after it."""
        if self._first is not None:
            self._first.tick()
            self.text, self.fraction = self._first.title, self._first.fraction
            if not self._first.ended:
                return
            self._first.close()
            self._first = None
        self._client = WorkerClient(self._request, self._python)
        self.fraction, self._begun_s = 0.0, time.monotonic()

    def _on_message(self, message: Message) -> None:
        if message.kind is MessageKind.PREVIEW:
            self._preview = message
            return
        if message.kind is MessageKind.STATUS:
            status = message.status()
            if status.activity is not None:
                self.text, self.cue, self.views = status.activity, status.cue, status.views
            self.heading = self.heading if status.heading is None else status.heading
            self.fraction = self.fraction if status.fraction is None else status.fraction
        elif message.kind is MessageKind.RESULT:
            self.summary = message.json()
        elif message.kind is MessageKind.ERROR:
            raise message.error()

    def take_preview(self) -> Image | None:
        """Return a new camera image (height, width, 3), RGB, or None."""
        message, self._preview = self._preview, None
        return None if message is None else message.preview()

    def finish(self) -> None:
        """Ask the worker to end with the result so far; keep calling `tick` until `ended`."""
        self.finishable = False
        if self._client is not None:
            self._client.request_stop()

    def close(self) -> None:
        """End the worker."""
        if self._first is not None:
            self._first.close()
        if self._client is not None:
            self._client.close()

    def keep(self, context: object) -> str:
        """Keep nothing, because an unfinished command has no result."""
        return ""
