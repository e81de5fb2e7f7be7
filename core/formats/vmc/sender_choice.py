"""Choice of one program if several send to one port."""

import math
from dataclasses import dataclass
from typing import TypeAlias

Source: TypeAlias = tuple[str, int]  # address and port of a sender


@dataclass(frozen=True)
class SenderLimits:
    """Limits for accepting another program."""

    silence_s: float = 1.0  # silence after which a sender counts as gone; programs send every 4 to 33 ms
    fresh_ports: int = 3  # number of new ports in succession that reveals a program that opens a port for each packet


LIMITS = SenderLimits()


class SenderChoice:
    """Choice of the first program that sends packets; once it is silent, of the next one.

    Attributes:
        others: Programs whose packets were dropped, ten at most.
    """

    def __init__(self) -> None:
        self.others: set[Source] = set()
        self._chosen: Source | None = None
        self._heard_s = -math.inf
        self._since: set[Source] = set()  # other sources since the chosen one was last heard
        self._has_fresh_ports = False

    def accepts(self, source: Source, time_s: float) -> bool:
        """Return whether to accept a packet from a source; `time_s` is its arrival on any monotonic clock."""
        if self._has_fresh_ports and (self._chosen is None or source[0] == self._chosen[0]):
            return True
        if source != self._chosen and time_s - self._heard_s <= LIMITS.silence_s:
            self._since.add(source)
            if len({other for other in self._since if other[0] == source[0]}) < LIMITS.fresh_ports:
                if len(self.others) < 10:
                    self.others.add(source)
                return False
            self._has_fresh_ports = True
            self.others -= self._since
        self._chosen, self._heard_s = source, time_s
        self._since.clear()
        return True
