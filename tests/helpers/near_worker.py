"""What a worker does for a job, in the test's own process: its start takes longer than most jobs."""

import queue
import threading
from collections.abc import Callable
from importlib import import_module
from typing import Any

import pytest


def use_near_worker(part: Callable[[str], Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the add-on's jobs be done here, when they are asked for the first time."""
    module = part("jobs.job")
    core = module.__name__.removesuffix("perfanim_addon.jobs.job") + "core"  # as the add-on has imported it
    monkeypatch.setattr(module, "WorkerClient", lambda request, python: _NearWorker(core, request))


class _NearWorker:
    """Stands for `WorkerClient`."""

    def __init__(self, core: str, request: Any) -> None:
        self._core, self._request = core, request
        self.ended = False

    def poll(self) -> list[Any]:
        """Do the job; return all its messages."""
        errors, process, requests = (self._part(name) for name in ("errors", "worker.process", "worker.requests"))
        channel = self._channel()
        name = self._request.job
        try:
            job = self._part(f"worker.jobs.{process.JOBS[name]}")
            job.run(requests.read_request(name, self._request.to_json()), channel)
        except errors.PerfanimError as error:
            channel.send_error(error)
        self.ended = True
        sent = [channel._queue.get() for _ in range(channel._queue.qsize())]
        return list(self._part("worker.protocol").Decoder().feed(b"".join(sent)))

    def close(self) -> None:
        self.ended = True

    def _channel(self) -> Any:
        """Return a channel that keeps what is sent."""
        kind = self._part("worker.channel").Channel
        channel = kind.__new__(kind)
        channel._queue, channel.frames = queue.SimpleQueue(), 0
        channel.stop_requested = threading.Event()
        return channel

    def _part(self, name: str) -> Any:
        return import_module(f"{self._core}.{name}")
