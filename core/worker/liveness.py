"""Signs of life of a worker: when one that runs counts as hung."""

import time
from collections.abc import Sequence

from ..errors import CaptureError
from .protocol import Message, MessageKind

START_LIMIT_S = 60.0
SILENCE_LIMIT_S = 15.0
# Once frames come, a process gives a sign of life every half second (`channel.HEARTBEAT_S`).
HUNG_S = 1.25
_LOOKED_AWAY_S = (
    0.25  # of the time between two polls counts as silence at most: the poller itself may have been held up
)


class Liveness:
    """Frames that one process has sent, and seconds since its last sign of life."""

    def __init__(self) -> None:
        self.frames = 0  # and poses
        self._silent_s, self._stalled_s = 0.0, 0.0
        self._polled_s = time.monotonic()

    def update(self, messages: Sequence[Message]) -> None:
        """Note the messages of one poll."""
        now_s = time.monotonic()
        self._silent_s = 0.0 if messages else self._silent_s + min(now_s - self._polled_s, _LOOKED_AWAY_S)
        self._polled_s = now_s
        for message in messages:
            if message.kind in (MessageKind.FRAME, MessageKind.POSE):
                self.frames += 1
                self._stalled_s = 0.0
            elif message.kind is MessageKind.STATUS:
                self._stalled_s = float(message.json().get("stalled_s", 0.0))

    def check(self, connected: bool) -> None:
        """Raise CaptureError when the process hangs; its first frame may take longer."""
        limit_s = HUNG_S if self.frames else SILENCE_LIMIT_S if connected else START_LIMIT_S
        if self._silent_s > limit_s:
            raise CaptureError(f"sent nothing for {self._silent_s:.1f} s", where="worker", advice="start again")
        if self.frames and self._stalled_s > HUNG_S:
            raise CaptureError(f"made no progress for {self._stalled_s:.1f} s", where="worker", advice="start again")
