"""Work that a worker process does for Blender, with its progress and result."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.worker.client import WorkerClient
from ...core.worker.protocol import Message, MessageKind


def command(arguments: Sequence[str]) -> dict[str, Any]:
    """Return the request for a command of the `perfanim` command line."""
    return {"job": "command", "arguments": list(arguments)}


class Job:
    """Work with progress and a result, running in a worker process.

    Args:
        title: what is being done, for the panel.
        panel: whose line shows the result.
        request: what the worker is asked for (see `core.worker.process`).
        python: interpreter of the worker, None for Blender's own.
        finishable: whether it can be asked to end early with what it has.
        first: work that must be done before, None for none.
    """

    def __init__(
        self,
        title: str,
        panel: str,
        request: Mapping[str, Any],
        python: str | None,
        finishable: bool = False,
        first: "Job | None" = None,
    ) -> None:
        self.title = title
        self.panel = panel
        self.finishable = finishable
        self.text = "starting"
        self.heading = ""  # how far it is, for the panel's header line
        self.fraction = 0.0
        self.summary: dict[str, Any] | None = None
        self._preview: Message | None = None
        self._first = first
        self._request, self._python = request, python
        self._client = None if first else WorkerClient(request, python)

    @property
    def ended(self) -> bool:
        """Whether the worker is done."""
        return self._client is not None and self._client.ended

    def tick(self) -> None:
        """Take what the worker has sent; raises the PerfanimError that ended the work."""
        if self._client is None:
            self._prepare()
            return
        for message in self._client.poll():
            self._take(message)

    def _prepare(self) -> None:
        """Go on with what must be done before, and begin when it is."""
        if self._first is not None:
            self._first.tick()
            self.text, self.fraction = self._first.title, self._first.fraction
            if not self._first.ended:
                return
            self._first.close()
        self._client = WorkerClient(self._request, self._python)

    def _take(self, message: Message) -> None:
        if message.kind is MessageKind.PREVIEW:
            self._preview = message
            return
        content = message.json()
        if message.kind is MessageKind.STATUS:
            self.text = str(content.get("activity", self.text))
            self.heading = str(content.get("heading", self.heading))
            fraction = content.get("fraction")
            self.fraction = float(fraction) if isinstance(fraction, int | float) else self.fraction
        elif message.kind is MessageKind.RESULT:
            self.summary = content
        elif message.kind is MessageKind.ERROR:
            raise message.error()

    def take_preview(self) -> NDArray[np.uint8] | None:
        """Return the newest picture (height, width, 3), RGB, of what the cameras see; None when there is no new one."""
        message, self._preview = self._preview, None
        return None if message is None else message.preview()

    def finish(self) -> None:
        """Ask the worker to end with what it has; go on calling `tick` until `ended`."""
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
        """Keep nothing: what a command has not finished leaves nothing."""
        return ""
