"""VMC over UDP: play a motion live, record the packets of another program."""

import ipaddress
import socket
import struct
import sys
import time
from contextlib import AbstractContextManager
from typing import Any

from ...body.motion import Motion
from ...body.skeleton import Skeleton
from ...errors import CaptureError
from ...geometry.arrays import Array
from ...system.progress import Progress
from .humanoid import BONES, Humanoid
from .vmc_packets import FramePackets
from .vmc_recording import Recording

_LARGEST_PACKET = 65535
_BUFFER_BYTES = 1 << 22  # what the system may keep while this process is busy
_OVERFLOWS = 40  # Linux' SO_RXQ_OVFL: each packet says how many before it found no room; Python does not name it
_MOST_WAITING = 1000  # packets that are still read at the end
_MOST_STRANGERS = 10  # that are remembered; an address is easily made up
_LONGEST_WAIT_S = 0.5  # between two looks at how far it is


def play(motion: Motion, host: str, port: int, progress: Progress) -> int:
    """Send a motion in real time, one bundle a frame; returns the bytes sent.

    Raises:
        CaptureError: the host is not known, or the network takes no packets.
        SkeletonError: standard joints are missing.
    """
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
    """Sends poses of one body to another program.

    Raises:
        CaptureError: the host is not known.
        SkeletonError: standard joints are missing.
    """

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
        """Send a pose (J, 4) and (3,); return the bytes.

        Raises:
            CaptureError: the network takes no packets.
        """
        poses = self._humanoid.poses(rotations[None], root_position_m[None])
        try:
            packet = self._packets.packet(time_s, poses.positions_m[0], poses.rotations[0])
            return self._socket.sendto(packet, self._address)
        except OSError as error:
            raise self._failure(error) from error

    def close(self) -> None:
        """Send nothing any more."""
        self._socket.close()

    def _failure(self, error: Exception) -> CaptureError:
        return CaptureError(f"cannot be sent to ({error})", where=self.where, advice="check host and port")


class Receiver(AbstractContextManager["Receiver"]):
    """A UDP port of this computer.

    Args:
        port: 0 for any that is free.
        sender: name or address of the only computer that is listened to; where that is this one, nothing comes from
            its networks. "": all are.

    Attributes:
        strangers: addresses of other computers that have sent, too.
        overflowed: packets that found no room while this process was busy, as far as the system reports them (Linux).

    Raises:
        CaptureError: the port is taken, or the sender is not known.
    """

    def __init__(self, port: int, sender: str = "") -> None:
        self.strangers: set[str] = set()
        self.overflowed = 0
        self._sender = _address(sender)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
            if sys.platform == "linux":
                self._socket.setsockopt(socket.SOL_SOCKET, _OVERFLOWS, 1)
            is_local = bool(self._sender) and ipaddress.ip_address(self._sender).is_loopback
            self._socket.bind((self._sender if is_local else "", port))
        except OSError as error:
            self._socket.close()
            raise CaptureError(
                f"cannot be listened to ({error.strerror or error})",
                where=f"port {port}",
                advice="end the program that uses it, or choose another port",
            ) from error
        self.port: int = self._socket.getsockname()[1]

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def receive(self, timeout_s: float) -> bytes | None:
        """Return the next packet of the sender, None if none comes in time."""
        self._socket.settimeout(timeout_s)
        try:
            packet, address = self._read()
        except (TimeoutError, BlockingIOError):
            return None
        if self._sender and address != self._sender:
            if len(self.strangers) < _MOST_STRANGERS:
                self.strangers.add(address)
            return None
        return packet

    def _read(self) -> tuple[bytes, str]:
        """Return the next packet and its sender's address."""
        if sys.platform != "linux":
            packet, (address, _) = self._socket.recvfrom(_LARGEST_PACKET)
            return packet, address
        packet, said, _, (address, _) = self._socket.recvmsg(_LARGEST_PACKET, socket.CMSG_SPACE(4))
        self.overflowed = next((struct.unpack("I", count)[0] for _, what, count in said if what == _OVERFLOWS), 0)
        return packet, address


def _address(host: str) -> str:
    try:
        return socket.gethostbyname(host) if host else ""
    except (OSError, UnicodeError) as error:
        advice = "give its address, as 192.168.1.20, or none for all"
        raise CaptureError(f"is no computer that is known ({error})", where=host, advice=advice) from error


def record(receiver: Receiver, seconds: float, progress: Progress) -> Recording:
    """Return the packets that come within `seconds`."""
    recording = Recording()
    progress(0.0, f"listening on port {receiver.port}")
    begun_s = time.perf_counter()
    waiting = _MOST_WAITING
    while waiting:
        left_s = begun_s + seconds - time.perf_counter()
        packet = receiver.receive(min(max(left_s, 0.0), _LONGEST_WAIT_S))
        if left_s <= 0.0:
            waiting = waiting - 1 if packet is not None else 0
        if packet is not None:
            recording.add(packet, time.perf_counter() - begun_s)
        progress(
            min(1.0 - left_s / seconds, 1.0),
            f"listening on port {receiver.port}: {recording.gathering.packets} packets",
        )
    return recording
