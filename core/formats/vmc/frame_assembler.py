"""Assembly of frames from VMC packets, however a program distributes its data over packets."""

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from ...errors import FormatError
from .vmc_packets import TRACKERS, Clock, Placement, read_packet

Key = tuple[str, str]  # address and name


@dataclass(frozen=True)
class FloodLimits:
    """Limits on accepted input; the excess is dropped, so that no program can exhaust memory or time."""

    packets: int = 20_000  # per second; a program with a packet for every bone at 120 Hz sends a third of this
    size: int = 600_000  # bytes per second; a body with face at 60 Hz takes less than half of this
    frames: int = 300  # per second; programs send 60 to 240
    placed: int = 1000  # bones and trackers in a frame


LIMITS = FloodLimits()


@dataclass(frozen=True)
class VmcFrame:
    """Transforms and clock of one frame.

    Args:
        arrival_s: Arrival time of its first packet.
        clock_s: The sender's time; None if it does not send one.
        placed: Root, bones and trackers.
    """

    arrival_s: float
    clock_s: float | None
    placed: dict[Key, Placement]


class FrameAssembler:
    """Assembler of frames from VMC packets.

    A frame ends when something that it already contains arrives again; the order and number of packets do not matter.

    Attributes:
        packets, malformed: Number of packets, and of packets with something that violates the protocol.
        understood: Number of packets with something that follows the protocol.
        flooding: Number of packets and frames dropped because of `LIMITS`.
    """

    def __init__(self) -> None:
        self.packets = 0
        self.malformed = 0
        self.understood = 0
        self.flooding = 0
        self._second_s = -math.inf
        self._packets_left = self._bytes_left = self._frames_left = 0
        self._clear()

    def _clear(self) -> None:
        self._arrival_s = 0.0
        self._clock_s: float | None = None
        self._placed: dict[Key, Placement] = {}

    def add(self, packet: bytes, arrival_s: float) -> list[VmcFrame]:
        """Add a UDP packet and return the frames that it completed.

        Args:
            arrival_s: Time on any monotonic clock.
        """
        self.packets += 1
        if not self._admits(packet, arrival_s):
            self.flooding += 1
            return []
        faults: list[str] = []
        try:
            messages = read_packet(packet, faults)
        except FormatError:
            self.malformed += 1
            return []
        self.malformed += bool(faults)
        self.understood += bool(messages or not faults)
        return [frame for message in messages for frame in self._add(message, arrival_s)]

    def _admits(self, packet: bytes, arrival_s: float) -> bool:
        """Return whether another packet is within the limits for this second."""
        if arrival_s - self._second_s >= 1.0:
            self._second_s, self._frames_left = arrival_s, LIMITS.frames
            self._packets_left, self._bytes_left = LIMITS.packets, LIMITS.size
        self._packets_left -= 1
        self._bytes_left -= len(packet)
        return self._packets_left >= 0 and self._bytes_left >= 0

    def _add(self, message: Placement | Clock, arrival_s: float) -> list[VmcFrame]:
        if isinstance(message, Clock):
            again = self._clock_s is not None
        else:
            again = (message.address, message.name) in self._placed or len(self._placed) == LIMITS.placed
        ended = self.end() if again else []
        if self._clock_s is None and not self._placed:
            self._arrival_s = arrival_s
        if isinstance(message, Clock):
            self._clock_s = message.time_s
        else:
            self._placed[message.address, message.name] = message
        return ended

    def has_all(self, keys: Collection[Key]) -> bool:
        """Return whether the open frame contains all of these transforms."""
        return all(key in self._placed for key in keys)

    def end(self) -> list[VmcFrame]:
        """End the open frame and return it, unless it is empty or exceeds the limits."""
        frames = [VmcFrame(self._arrival_s, self._clock_s, self._placed)] if self._placed else []
        self._frames_left -= len(frames)
        if frames and self._frames_left < 0:
            self.flooding += 1
            frames = []
        self._clear()
        return frames


def tracker_names(keys: Iterable[Key]) -> dict[Key, str]:
    """Return names for the head sets, controllers and trackers among the keys.

    The name is the serial number, the kind of device if there is none, or both if two share a serial number.
    """
    names = {key: key[1] or TRACKERS[key[0]] for key in keys if key[0] in TRACKERS}
    given = list(names.values())
    return {key: name if given.count(name) == 1 else f"{TRACKERS[key[0]]}:{key[1]}" for key, name in names.items()}
