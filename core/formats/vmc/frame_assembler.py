"""Frames assembled from VMC packets, however a program spreads them."""

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from ...errors import FormatError
from .vmc_packets import TRACKERS, Clock, Placement, read_packet

MOST_PACKETS_S = 20_000  # within a second; a program that sends every bone by itself at 120 Hz sends a third
MOST_BYTES_S = 600_000  # within a second, of a body with its face at 60 Hz less than half; the rest is not read
MOST_FRAMES_S = 300  # within a second; programs send 60 to 240, a packet of one tracker each can be a frame as well
MOST_PLACED = 1000  # bones and trackers of a frame; a program that makes up ever new names fills no memory

Key = tuple[str, str]  # address and name


@dataclass(frozen=True)
class VmcFrame:
    """Transforms and clock of one moment.

    Args:
        arrival_s: when the first of it came.
        clock_s: the sender's time, None if it sends none.
        placed: root, bones and trackers.
    """

    arrival_s: float
    clock_s: float | None
    placed: dict[Key, Placement]


class FrameAssembler:
    """Frames of VMC packets.

    A frame ends where something that it has comes again, so it does not matter over how many packets a program spreads
    its frames, nor in which order.

    Attributes:
        packets, malformed: how many came, and how many of them were none.
        flooding: how many packets and frames came beyond what a second may bring, and were left out.
    """

    def __init__(self) -> None:
        self.packets = 0
        self.malformed = 0
        self.flooding = 0
        self._second_s = -math.inf
        self._packets_left = self._bytes_left = self._frames_left = 0
        self._clear()

    def _clear(self) -> None:
        self._arrival_s = 0.0
        self._clock_s: float | None = None
        self._placed: dict[Key, Placement] = {}

    @property
    def understood(self) -> int:
        """How many packets were read and well-formed."""
        return self.packets - self.malformed - self.flooding

    def add(self, packet: bytes, arrival_s: float) -> list[VmcFrame]:
        """Add a UDP packet and return the frames that ended; a malformed one only counts.

        `arrival_s` is of any clock that only goes forwards.
        """
        self.packets += 1
        if not self._admits(packet, arrival_s):
            self.flooding += 1
            return []
        try:
            messages = read_packet(packet)
        except FormatError:
            self.malformed += 1
            return []
        return [frame for message in messages for frame in self._add(message, arrival_s)]

    def _admits(self, packet: bytes, arrival_s: float) -> bool:
        """Return whether the present second may bring one more packet."""
        if arrival_s - self._second_s >= 1.0:
            self._second_s, self._frames_left = arrival_s, MOST_FRAMES_S
            self._packets_left, self._bytes_left = MOST_PACKETS_S, MOST_BYTES_S
        self._packets_left -= 1
        self._bytes_left -= len(packet)
        return self._packets_left >= 0 and self._bytes_left >= 0

    def _add(self, message: Placement | Clock, arrival_s: float) -> list[VmcFrame]:
        if isinstance(message, Clock):
            again = self._clock_s is not None
        else:
            again = (message.address, message.name) in self._placed or len(self._placed) == MOST_PLACED
        ended = self.end() if again else []
        if self._clock_s is None and not self._placed:
            self._arrival_s = arrival_s
        if isinstance(message, Clock):
            self._clock_s = message.time_s
        else:
            self._placed[message.address, message.name] = message
        return ended

    def has_all(self, keys: Collection[Key]) -> bool:
        """Return whether the open frame has all of these."""
        return all(key in self._placed for key in keys)

    def end(self) -> list[VmcFrame]:
        """End the open frame and return it; nothing where it is empty or one too many."""
        frames = [VmcFrame(self._arrival_s, self._clock_s, self._placed)] if self._placed else []
        self._frames_left -= len(frames)
        if frames and self._frames_left < 0:
            self.flooding += 1
            frames = []
        self._clear()
        return frames


def tracker_names(keys: Iterable[Key]) -> dict[Key, str]:
    """Return the serial numbers of head sets, controllers and trackers among keys.

    One without goes by its kind; of two with the same, each has its kind before it.
    """
    names = {key: key[1] or TRACKERS[key[0]] for key in keys if key[0] in TRACKERS}
    given = list(names.values())
    return {key: name if given.count(name) == 1 else f"{TRACKERS[key[0]]}:{key[1]}" for key, name in names.items()}
