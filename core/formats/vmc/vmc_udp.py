"""VMC over UDP: sending poses, receiving and recording packets."""

import ipaddress
import socket
import struct
import sys
import time
from contextlib import AbstractContextManager
from typing import Any

from ...body.motion import Motion
from ...body.skeleton import Skeleton
from ...errors import CaptureError, counted
from ...geometry.arrays import Array
from ...system.progress import Progress
from .humanoid import BONES, Humanoid
from .sender_choice import SenderChoice, Source
from .vmc_packets import FramePackets
from .vmc_recording import Recording

_LARGEST_PACKET = 65535  # bytes
_SO_RXQ_OVFL = 40  # on Linux each packet reports the number of dropped packets; Python lacks this constant


def play(motion: Motion, host: str, port: int, progress: Progress) -> int:
    """Send a motion in real time, one bundle per frame; return the number of bytes sent."""
    sent = 0
    with Sender(motion.skeleton, host, port) as sender:
        begun_s = time.perf_counter()
        for frame in range(motion.frames):
            time_s = frame / motion.fps
            early_s = begun_s + time_s - time.perf_counter()
            if early_s > 0.0:
                time.sleep(early_s)
            sent += sender.send(time_s, motion.rotations[frame], motion.root_positions_m[frame])
            progress((frame + 1) / motion.frames, f"sending to {sender.where}")
    return sent


class Sender(AbstractContextManager["Sender"]):
    """Sender of one body's poses to another program; CaptureError if the host is unknown."""

    def __init__(self, skeleton: Skeleton, host: str, port: int) -> None:
        self.where = f"{host}:{port}"
        self._humanoid = Humanoid(skeleton)
        self._packets = FramePackets(tuple(BONES))
        try:
            family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._address: tuple[Any, ...] = address
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
        except (OSError, UnicodeError) as error:
            raise self._failure(error) from error

    def __exit__(self, *_: object) -> None:
        self.close()

    def send(self, time_s: float, rotations: Array, root_position_m: Array) -> int:
        """Send a pose and return the number of bytes sent; CaptureError if the network does not accept them.

        Args:
            rotations, root_position_m: (J, 4) and (3,), as in a `Motion`.
        """
        poses = self._humanoid.poses(rotations[None], root_position_m[None])
        try:
            packet = self._packets.packet(time_s, poses.positions_m[0], poses.rotations[0])
            return self._socket.sendto(packet, self._address)
        except OSError as error:
            raise self._failure(error) from error

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _failure(self, error: Exception) -> CaptureError:
        return CaptureError(f"cannot be reached ({error})", where=self.where, advice="check host and port")


class Receiver(AbstractContextManager["Receiver"]):
    """A UDP port of this computer.

    Args:
        port: Port number; 0 for any free one.
        sender: Name or address of the only computer that is accepted; "" for all. If it is this computer, the port is
            not reachable from its networks.

    Attributes:
        strangers: Addresses of other computers that have sent packets, at most ten.
        overflowed: Packets that the system dropped while this process was busy (reported by Linux only).

    Raises:
        CaptureError: The port is taken, or the sender is unknown.
    """

    def __init__(self, port: int, sender: str = "") -> None:
        self.strangers: set[str] = set()
        self.overflowed = 0
        self._choice = SenderChoice()
        family, self._sender = _address(sender)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
            if sys.platform == "linux":
                self._socket.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
            is_local = bool(self._sender) and ipaddress.ip_address(self._sender).is_loopback
            self._socket.bind((self._sender if is_local else "", port))
        except OSError as error:
            self._socket.close()
            raise CaptureError(
                f"cannot be opened ({error.strerror or error})",
                where=f"port {port}",
                advice="close the program that uses it, or choose another port",
            ) from error
        self.port: int = self._socket.getsockname()[1]

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    @property
    def others(self) -> list[str]:
        """Further programs that have sent packets, as HOST:PORT; only one is listened to at a time."""
        return [f"{address}:{port}" for address, port in sorted(self._choice.others)]

    def receive(self, timeout_s: float) -> bytes | None:
        """Return the next packet of the sender, or None after the timeout."""
        self._socket.settimeout(timeout_s)
        try:
            packet, source = self._read()
        except (TimeoutError, BlockingIOError):
            return None
        if self._sender and source[0] != self._sender:
            if len(self.strangers) < 10:
                self.strangers.add(source[0])
            return None
        return packet if self._choice.accepts(source, time.monotonic()) else None

    def _read(self) -> tuple[bytes, Source]:
        """Return the next packet and its sender's address and port."""
        if sys.platform != "linux":
            packet, source = self._socket.recvfrom(_LARGEST_PACKET)
            return packet, source[:2]
        packet, said, _, source = self._socket.recvmsg(_LARGEST_PACKET, socket.CMSG_SPACE(4))
        self.overflowed = next((struct.unpack("I", count)[0] for _, what, count in said if what == _SO_RXQ_OVFL), 0)
        return packet, source[:2]


def _address(host: str) -> tuple[socket.AddressFamily, str]:
    """Return the family and address of a computer, IPv4 if it has both."""
    try:
        found = socket.getaddrinfo(host or "0.0.0.0", None, type=socket.SOCK_DGRAM)  # noqa: S104 - only looked up
        family, *_, address = min(found, key=lambda each: each[0] != socket.AF_INET)
        return family, str(address[0]) if host else ""
    except (OSError, UnicodeError) as error:
        advice = "give its address, such as 192.168.1.20, or none to accept all"
        raise CaptureError(f"cannot be resolved ({error})", where=host, advice=advice) from error


def record(receiver: Receiver, seconds: float, progress: Progress) -> Recording:
    """Return the packets that arrive within `seconds`."""
    recording = Recording()
    progress(0.0, f"listening on port {receiver.port}")
    begun_s = time.perf_counter()
    waiting = 1000  # limit on packets read from the system's buffer after the end
    while waiting:
        left_s = begun_s + seconds - time.perf_counter()
        packet = receiver.receive(min(max(left_s, 0.0), 0.5))  # progress is reported twice a second
        if left_s <= 0.0:
            waiting = waiting - 1 if packet is not None else 0
        if packet is not None:
            recording.add(packet, time.perf_counter() - begun_s)
        progress(
            min(1.0 - left_s / seconds, 1.0),
            f"listening on port {receiver.port}: {counted(recording.gathering.packets, 'packet')}",
        )
    return recording
