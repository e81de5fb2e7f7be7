"""Packets of the VMC protocol: OSC bundles of named positions and rotations.

Unity's axes are left-handed: x to the performer's right, y up, z forward, so ours with x turned round. Positions become
(-x, y, z). A rotation's axis is mirrored too, and turns the other way: (w, x, y, z) becomes (w, x, -y, -z), on the wire
in the order x, y, z, w. Both ways are the same.

The protocol: https://protocol.vmc.info/marionette-spec (version 2.0 and later).
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message import OscMessage
from pythonosc.osc_message_builder import OscMessageBuilder
from pythonosc.parsing import osc_types

from ...errors import FormatError, shorten
from ...geometry import rotations as rot
from ...geometry.arrays import Array

AVAILABLE = "/VMC/Ext/OK"
TIME = "/VMC/Ext/T"
ROOT = "/VMC/Ext/Root/Pos"
BONE = "/VMC/Ext/Bone/Pos"
TRACKERS = {"/VMC/Ext/Hmd/Pos": "Hmd", "/VMC/Ext/Con/Pos": "Con", "/VMC/Ext/Tra/Pos": "Tra"}

_PLACED_TAGS = re.compile(",sf{7}")  # later versions of the protocol append values
_TIME_TAGS = re.compile(",f")
_BUNDLE = b"#bundle\0"
_BUNDLE_HEAD = 16  # its mark and its time
_DEEPEST = 4  # bundles in bundles; programs send one level
_LONGEST_NAME = 128  # characters; bones and serial numbers have a few dozen at most
_MIRROR_POSITION = np.array([-1.0, 1.0, 1.0])
_MIRROR_ROTATION = np.array([1.0, 1.0, -1.0, -1.0])
_AT_REST = (-0.0, 0.0, 0.0, 0.0, -0.0, -0.0, 1.0)  # the origin and no turn, mirrored


@dataclass(frozen=True)
class Placement:
    """Where a bone, the root or a tracker is, in our axes.

    Args:
        address: `ROOT`, `BONE` or one of `TRACKERS`.
        name: of the bone, or the tracker's serial number.
        position_m: (3,), of a bone relative to the one above.
        rotation: (4,) unit quaternion, of a bone relative to the one above.
    """

    address: str
    name: str
    position_m: Array
    rotation: Array


@dataclass(frozen=True)
class Clock:
    """The sender's time, seconds from a start of its own."""

    time_s: float


class FramePackets:
    """Bundles of frames with the same bones: available, time, root and bones.

    Only the numbers differ from frame to frame, and OSC keeps each at a multiple of four bytes. So they are written
    into one bundle, in a fiftieth of the time that the library takes to build it. The root rests in the origin.
    """

    def __init__(self, names: Sequence[str]) -> None:
        bundle = OscBundleBuilder(IMMEDIATELY)
        bundle.add_content(_message(AVAILABLE, (("i", 1),)))
        bundle.add_content(_message(TIME, (("f", 0.0),)))
        for address, name in ((ROOT, "root"), *((BONE, name) for name in names)):
            bundle.add_content(_message(address, (("s", name), *(("f", number) for number in _AT_REST))))
        self._first = bundle.build().dgram
        ends: dict[str, list[int]] = {TIME: [], BONE: []}
        at = _BUNDLE_HEAD
        while at < len(self._first):
            end = at + 4 + int.from_bytes(self._first[at : at + 4], "big")
            address = self._first[at + 4 : end].partition(b"\0")[0].decode()
            ends.get(address, []).append(end // 4)
            at = end
        self._time = ends[TIME][0] - 1
        self._bones = np.array(ends[BONE])[:, None] + np.arange(-7, 0)

    def packet(self, time_s: float, positions_m: Array, rotations: Array) -> bytes:
        """Return the bundle of a frame.

        Args:
            positions_m, rotations: (B, 3) and (B, 4) in our axes, relative to the bone above.
        """
        numbers = np.frombuffer(bytearray(self._first), ">f4")
        numbers[self._time] = time_s
        placed = np.empty(self._bones.shape)
        placed[:, :3] = _MIRROR_POSITION * positions_m
        placed[:, 3:] = (_MIRROR_ROTATION * rotations)[:, [1, 2, 3, 0]]
        numbers[self._bones] = placed
        return numbers.tobytes()


def _message(address: str, arguments: Sequence[tuple[str, str | int | float]]) -> OscMessage:
    builder = OscMessageBuilder(address)
    for tag, value in arguments:
        builder.add_arg(value, tag)
    return builder.build()


def read_packet(packet: bytes) -> list[Placement | Clock]:
    """Return the transforms and times of a packet, in its order.

    Raises:
        FormatError: it is no OSC packet, or one of these messages is not as the protocol has it.
    """
    found = (_read_message(message) for message in _messages(packet))
    return [message for message in found if message is not None]


def _messages(packet: bytes) -> Iterator[bytes]:
    """Yield the messages of a packet, of bundles in bundles too.

    The library's own reader follows a size that points backwards for ever, so sizes are checked here.
    """
    pending = [(packet, 0)]
    while pending:
        item, depth = pending.pop()
        if item.startswith(b"/"):
            yield item
            continue
        if not item.startswith(_BUNDLE) or len(item) < _BUNDLE_HEAD:
            raise FormatError("is no OSC packet")
        if depth == _DEEPEST:
            raise FormatError(f"has OSC bundles nested more than {_DEEPEST} deep")
        inner, at = [], _BUNDLE_HEAD
        while at < len(item):
            size = int.from_bytes(item[at : at + 4], "big")
            end = at + 4 + size
            if size % 4 or size == 0 or end > len(item):
                raise FormatError("has an OSC bundle with wrong sizes")
            inner.append((item[at + 4 : end], depth + 1))
            at = end
        pending += reversed(inner)


def _read_message(message: bytes) -> Placement | Clock | None:
    address = message.partition(b"\0")[0].decode("ascii", "replace")
    is_time = address == TIME
    if not (is_time or address in (ROOT, BONE) or address in TRACKERS):
        return None
    try:
        _, at = osc_types.get_string(message, 0)
        tags, at = osc_types.get_string(message, at)
        if not (_TIME_TAGS if is_time else _PLACED_TAGS).match(tags):
            raise FormatError(f"has {address} with values of the types {shorten(repr(tags), 40)}")
        name, at = ("", at) if is_time else osc_types.get_string(message, at)
        if len(name) > _LONGEST_NAME:
            raise FormatError(f"has {address} with a name of {len(name)} characters, {_LONGEST_NAME} at most")
        # not by the library, which takes numbers that are cut off for zeros
        numbers = np.frombuffer(message, ">f4", 1 if is_time else 7, at)
    except (osc_types.ParseError, ValueError) as error:
        raise FormatError(f"has a damaged message {address}") from error
    if not np.all(np.isfinite(numbers)):
        raise FormatError(f"has {address} with numbers that are not finite")
    numbers = numbers.astype(np.float64)
    if is_time:
        return Clock(float(numbers[0]))
    rotation = _MIRROR_ROTATION * numbers[[6, 3, 4, 5]]
    if np.linalg.norm(rotation) < 0.5:
        raise FormatError(f"has {address} with a rotation that is none")
    return Placement(address, name, _MIRROR_POSITION * numbers[:3], rot.normalize(rotation))
