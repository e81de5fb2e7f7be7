"""A command of the command line, running in a worker process for Blender."""

from collections.abc import Sequence
from typing import Any

from ..core.worker.client import WorkerClient
from ..core.worker.protocol import Message, MessageKind


class Job:
    """A command of the command line, running in a worker process.

    Args:
        title: what is being done, for the panel.
        panel: whose line shows the result.
        arguments: of the `perfanim` command.
        python: interpreter of the worker, None for Blender's own.
    """

    def __init__(self, title: str, panel: str, arguments: Sequence[str], python: str | None) -> None:
        self.title = title
        self.panel = panel
        self.text = "starting"
        self.fraction = 0.0
        self.summary: dict[str, Any] | None = None
        self._client = WorkerClient({"job": "command", "arguments": list(arguments)}, python)

    @property
    def ended(self) -> bool:
        """Whether the worker is done."""
        return self._client.ended

    def tick(self) -> None:
        """Take what the worker has sent; raises the PerfanimError that ended the work."""
        for message in self._client.poll():
            self._take(message)

    def _take(self, message: Message) -> None:
        content = message.json()
        if message.kind is MessageKind.STATUS:
            self.text = str(content.get("activity", self.text))
            fraction = content.get("fraction")
            self.fraction = float(fraction) if isinstance(fraction, int | float) else self.fraction
        elif message.kind is MessageKind.RESULT:
            self.summary = content
        elif message.kind is MessageKind.ERROR:
            raise message.error()

    def close(self) -> None:
        """End the worker."""
        self._client.close()

    def keep(self, context: object) -> str:
        """Keep nothing: what a command has not finished leaves nothing."""
        return ""
