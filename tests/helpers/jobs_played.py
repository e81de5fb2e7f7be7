"""Jobs of the real worker, played from the request to the end."""

import time
from collections.abc import Callable
from typing import Any

from perfanim.core.worker.client import WorkerClient
from perfanim.core.worker.protocol import Message, MessageKind

PATIENCE_S = 300.0


def played(request: dict[str, Any], stop: Callable[[Message], bool] | None = None) -> list[Message]:
    """Return all messages of a job, with each pose confirmed; it is asked to stop when `stop` holds for a message."""
    client, messages = WorkerClient(request), []
    limit = time.monotonic() + PATIENCE_S
    try:
        while not client.ended:
            for message in client.poll():
                messages.append(message)
                if stop is not None and stop(message):
                    client.request_stop()
            if poses := sum(message.kind is MessageKind.POSE for message in messages):
                client.acknowledge(poses)
            client.wait(0.05)
            assert time.monotonic() < limit
    finally:
        client.close()
    return messages


def outcome(messages: list[Message]) -> Message:
    (last,) = [m for m in messages if m.kind in (MessageKind.RESULT, MessageKind.ERROR)]
    return last


def said(messages: list[Message], key: str = "activity") -> list[str]:
    return [str(m.json().get(key)) for m in messages if m.kind is MessageKind.STATUS]
