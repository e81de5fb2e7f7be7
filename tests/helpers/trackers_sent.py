"""Trackers as another program sends them by VMC, in Unity's axes."""

import socket
from collections.abc import Mapping, Sequence
from typing import Any

from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder

TRACKER = "/VMC/Ext/Tra/Pos"
UNTURNED = (1.0, 0.0, 0.0, 0.0)


def tracker_packet(
    places_m: Mapping[str, Sequence[float]],
    rotations: Mapping[str, Sequence[float]] | None = None,
    address: str = TRACKER,
) -> bytes:
    """Return the bundle of one frame; places (3,) and rotations (w, x, y, z) in our axes, by name."""
    bundle = OscBundleBuilder(IMMEDIATELY)
    for name, (x, y, z) in places_m.items():
        w, i, j, k = (rotations or {}).get(name, UNTURNED)
        message = OscMessageBuilder(address)
        message.add_arg(name, "s")
        for number in (-x, y, z, i, -j, -k, w):
            message.add_arg(float(number), "f")
        bundle.add_content(message.build())
    packet: bytes = bundle.build().dgram
    return packet


class Program:
    """Another program of this computer, which sends to a port."""

    def __init__(self, port: int) -> None:
        self._to = ("127.0.0.1", port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def __enter__(self) -> "Program":
        return self

    def __exit__(self, *_: Any) -> None:
        self._socket.close()

    def send(self, packet: bytes) -> None:
        """Send a packet."""
        self._socket.sendto(packet, self._to)


def free_port() -> int:
    """Return a UDP port that nobody uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("127.0.0.1", 0))
        port: int = link.getsockname()[1]
        return port
