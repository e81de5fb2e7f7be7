"""Packets of the VMC protocol: OSC bundles of named positions and rotations.

Unity's axes are left-handed: x to the performer's right, y up, z forward, which is ours with x mirrored. Positions
become (-x, y, z), rotations (w, x, -y, -z), sent in the order x, y, z, w; the conversion is its own inverse.

Protocol: https://protocol.vmc.info/marionette-spec (version 2.0 and later).
"""

import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
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
_IMMEDIATELY = struct.pack(">Q", 1)  # time tag of a bundle
_HEADER_BYTES = len(_BUNDLE + _IMMEDIATELY)
_MOST_NESTED = 4  # deepest nesting of bundles; programs send one level
_LONGEST_NAME = 128  # characters; names of bones and serial numbers have a few dozen at most
_MIRROR_POSITION = np.array([-1.0, 1.0, 1.0])
_MIRROR_ROTATION = np.array([1.0, 1.0, -1.0, -1.0])


@dataclass(frozen=True)
class Placement:
    """Pose of a bone, the root or a tracker, in our axes.

    Args:
        address: `ROOT`, `BONE` or one of `TRACKERS`.
        name: Name of the bone, or serial number of the tracker.
        position_m: Position (3,); for a bone relative to its parent.
        rotation: Unit quaternion (4,); for a bone relative to its parent.
    """

    address: str
    name: str
    position_m: Array
    rotation: Array


@dataclass(frozen=True)
class Clock:
    """The sender's time, in seconds since a moment of its choice."""

    time_s: float


class FramePackets:
    """Encoder of OSC bundles, one per frame: availability flag, time, root at the origin, always the same bones.

    The library encodes each message once; `packet` only replaces the numbers at its end, which is 50 times as fast.
    """

    def __init__(self, names: Sequence[str]) -> None:
        start = [_BUNDLE, _IMMEDIATELY, _message(AVAILABLE, 1), _message(TIME, 0.0)[:-4]]
        self._start = b"".join(start)
        self._root = _message(ROOT, "root", *_on_wire(np.zeros(3), rot.identity()).tolist())
        self._bones = [_message(BONE, name, *[0.0] * 7)[:-28] for name in names]

    def packet(self, time_s: float, positions_m: Array, rotations: Array) -> bytes:
        """Return the bundle of a frame.

        Args:
            positions_m, rotations: (B, 3) and (B, 4) in our axes, relative to the parent bone.
        """
        parts = [self._start, struct.pack(">f", time_s), self._root]
        for start, numbers in zip(self._bones, _on_wire(positions_m, rotations).astype(">f4"), strict=True):
            parts += start, numbers.tobytes()
        return b"".join(parts)


def _on_wire(positions_m: Array, rotations: Array) -> Array:
    turned = (_MIRROR_ROTATION * rotations)[..., [1, 2, 3, 0]]
    return np.concatenate((_MIRROR_POSITION * positions_m, turned), axis=-1)


def _message(address: str, *values: str | float) -> bytes:
    """Return a message preceded by its size, as in a bundle."""
    builder = OscMessageBuilder(address)
    for value in values:
        builder.add_arg(value, {str: "s", int: "i", float: "f"}[type(value)])
    data = builder.build().dgram
    return struct.pack(">I", len(data)) + data


def read_packet(packet: bytes, faults: list[str] | None = None) -> list[Placement | Clock]:
    """Return the transforms and times in a packet, in order.

    Args:
        faults: Receives descriptions of messages that violate the protocol; the others are still returned.

    Raises:
        FormatError: The packet violates the protocol, or, if `faults` is not given, one of its messages does.
    """
    found = []
    for each in _messages(packet, faults):
        try:
            message = _read_message(each)
        except FormatError as error:
            if faults is None:
                raise
            faults.append(error.what)
            continue
        if message is not None:
            found.append(message)
    return found


def _messages(packet: bytes, faults: list[str] | None) -> Iterator[bytes]:
    """Yield the messages in a packet, including those in nested bundles; invalid parts of a bundle are faults.

    The library's own reader loops forever if a size points backwards, so sizes are checked here.
    """
    pending = [(packet, 0)]
    while pending:
        item, depth = pending.pop()
        if item.startswith(b"/"):
            yield item
            continue
        if not item.startswith(_BUNDLE) or len(item) < _HEADER_BYTES:
            if depth == 0 or faults is None:
                raise _violation("is not an OSC packet")
            faults.append("is not an OSC packet")
            continue
        if depth == _MOST_NESTED:
            raise _violation(f"has OSC bundles nested more than {_MOST_NESTED} deep")
        inner, at = [], _HEADER_BYTES
        while at < len(item):
            size = int.from_bytes(item[at : at + 4], "big")
            end = at + 4 + size
            if size % 4 or size == 0 or end > len(item):
                raise _violation("has an OSC bundle with wrong sizes")
            inner.append((item[at + 4 : end], depth + 1))
            at = end
        pending += reversed(inner)


def _violation(what: str) -> FormatError:
    return FormatError(what, where="VMC packet", advice="check the program that sends it")


def _read_message(message: bytes) -> Placement | Clock | None:
    address = message.partition(b"\0")[0].decode("ascii", "replace")
    is_time = address == TIME
    if not (is_time or address in (ROOT, BONE) or address in TRACKERS):
        return None
    try:
        _, at = osc_types.get_string(message, 0)
        tags, at = osc_types.get_string(message, at)
        if not (_TIME_TAGS if is_time else _PLACED_TAGS).match(tags):
            raise _violation(
                f"has {address} with argument types {shorten(repr(tags), 40)}, not {',f' if is_time else ',sfffffff'!r}"
            )
        name, at = ("", at) if is_time else osc_types.get_string(message, at)
        if len(name) > _LONGEST_NAME:
            raise _violation(f"has {address} with a name of {len(name)} characters, {_LONGEST_NAME} at most")
        # the library would read missing bytes as zeros
        numbers = np.frombuffer(message, ">f4", 1 if is_time else 7, at)
    except (osc_types.ParseError, ValueError) as error:
        raise _violation(f"has a damaged message {address}") from error
    if not np.all(np.isfinite(numbers)):
        raise _violation(f"has {address} with numbers that are not finite")
    numbers = numbers.astype(np.float64)
    if is_time:
        return Clock(float(numbers[0]))
    rotation = _MIRROR_ROTATION * numbers[[6, 3, 4, 5]]
    if np.linalg.norm(rotation) < 0.5:
        raise _violation(f"has {address} with an invalid rotation")
    return Placement(address, name, _MIRROR_POSITION * numbers[:3], rot.normalize(rotation))
