"""Signs of life of a worker, used to tell a hung process from a slow one."""

import time
from collections.abc import Callable, Sequence

from ..errors import CaptureError
from .protocol import Message, MessageKind
from .worker_settings import WORKER


class Liveness:
    """Frames of one process, and the time since its last sign of life.

    Attributes:
        frames: Number of frames or poses so far.
        slowness: Last measured slowness of the process (see `Slowness`).
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.frames, self.slowness = 0, 1.0
        self._silent_s, self._stalled_s = 0.0, 0.0
        self._clock = clock
        self._polled_s = clock()

    def update(self, messages: Sequence[Message]) -> None:
        """Update with the messages of one poll."""
        now_s = self._clock()
        self._silent_s = 0.0 if messages else self._silent_s + min(now_s - self._polled_s, WORKER.poll_gap_s)
        self._polled_s = now_s
        for message in messages:
            if message.kind in (MessageKind.FRAME, MessageKind.POSE):
                self.frames += 1
                self._stalled_s = 0.0
            elif message.kind is MessageKind.STATUS:
                status = message.status()
                self._stalled_s = status.stalled_s
                self.slowness = status.slowness or self.slowness

    def check(self, connected: bool) -> None:
        """Raise CaptureError if the process hangs; before its first frame it may be silent for longer."""
        hung_s = min(WORKER.hung_s * self.slowness, WORKER.silence_s)
        limit_s = hung_s if self.frames else WORKER.silence_s if connected else WORKER.start_s
        if self._silent_s > limit_s:
            raise CaptureError(f"sent nothing for {self._silent_s:.1f} s", where="worker", advice="start again")
        if self.frames and self._stalled_s > hung_s:
            raise CaptureError(f"made no progress for {self._stalled_s:.1f} s", where="worker", advice="start again")
