"""Byte structure of a take file: a preamble, then chunks that are only ever appended.

A chunk is a header (magic, kind, sequence number, length and CRC-32 of the payload, CRC-32 of all these) and a payload.
Checksums cover every bit of the file. After damage, reading continues at the next intact header.
"""

import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from io import FileIO
from typing import BinaryIO

from ...errors import TakeError
from ...system.file_content import check_kind

VERSION = 1

_MAGIC = b"PERFANIM-TAKE\n"
_PREAMBLE = struct.Struct("<14sHI")  # magic, version, CRC-32 of both
_CHUNK_MAGIC = b"\x89PFC"
_HEAD = struct.Struct("<4sHHIII")  # magic, kind, 0, sequence number, bytes and CRC-32 of the payload
_SUM = struct.Struct("<I")  # CRC-32 of the head
_RECORD = struct.Struct("<I")  # size of a record in bytes

HEADER_BYTES = _HEAD.size + _SUM.size
PREAMBLE_BYTES = _PREAMBLE.size


class ChunkKind(IntEnum):
    """Kinds of chunks."""

    SETUP = 1  # JSON: the set-up
    FRAMES = 2  # records: stamp and marker frame
    POSES = 3  # records: solved poses
    EVENT = 4  # JSON: an incident or action
    NOTES = 5  # JSON: name, notes, rating; the last chunk counts
    END = 6  # footer: index of a complete file


@dataclass(frozen=True)
class Chunk:
    """An intact chunk: kind, sequence number, first byte in the file, and content."""

    kind: int
    sequence: int
    offset: int
    payload: memoryview | bytes


@dataclass(frozen=True)
class Fault:
    """Unreadable bytes of a take file: damaged, or `cut` off at the end."""

    offset: int
    size: int
    what: str
    cut: bool = False

    def __str__(self) -> str:
        return f"{self.what} (byte {self.offset}, {self.size} bytes)"


def preamble() -> bytes:
    """Return the first bytes of a take file."""
    head = _PREAMBLE.pack(_MAGIC, VERSION, 0)[: -_SUM.size]
    return head + _SUM.pack(zlib.crc32(head))


def encode_chunk(kind: int, sequence: int, payload: bytes) -> bytes:
    """Return a chunk as bytes."""
    head = _HEAD.pack(_CHUNK_MAGIC, kind, 0, sequence, len(payload), zlib.crc32(payload))
    return b"".join((head, _SUM.pack(zlib.crc32(head)), payload))


def join_records(records: Sequence[bytes]) -> bytes:
    """Return byte strings joined into one, each preceded by its length."""
    return b"".join(part for record in records for part in (_RECORD.pack(len(record)), record))


def split_records(payload: memoryview | bytes) -> Iterator[bytes]:
    """Yield the byte strings that `join_records` joined; TakeError if the lengths do not fit."""
    position = 0
    while position < len(payload):
        start = position + _RECORD.size
        size = int.from_bytes(payload[position:start], "little")
        position = start + size
        if position > len(payload):
            raise TakeError("a chunk ends within a record")
        yield bytes(payload[start:position])


def scan(data: bytes, where: str) -> tuple[list[Chunk], list[Fault]]:
    """Return the intact chunks and the faults; TakeError for another kind of file or version."""
    view = memoryview(data)
    faults = preamble_faults(data, where)
    chunks: list[Chunk] = []
    position = PREAMBLE_BYTES
    while position < len(data):
        head = _head(view, position)
        if head is None:
            position = _skip(data, position, faults)
            continue
        kind, sequence, size, checksum = head
        start, stop = position + HEADER_BYTES, position + HEADER_BYTES + size
        if stop <= len(data) and zlib.crc32(view[start:stop]) == checksum:
            chunks.append(Chunk(kind, sequence, position, view[start:stop]))
            position = stop
        elif stop > len(data) and _next_head(data, start) == len(data):
            what = f"the file is cut off within chunk {sequence} ({_name(kind)})"
            faults.append(Fault(position, len(data) - position, what, cut=True))
            break
        elif stop == len(data) or _head(view, stop) is not None:
            faults.append(Fault(position, stop - position, f"chunk {sequence} ({_name(kind)}) is damaged"))
            position = stop
        else:  # the payload lacks bytes or has extra ones
            position = _skip(data, position, faults)
    return chunks, faults + _gaps(chunks, faults)


def preamble_faults(data: bytes, where: str) -> list[Fault]:
    """Return the faults in the first bytes of a take (preamble and first header).

    Raises:
        TakeError: The file is not a take, is of another version, or ends within the preamble.
    """
    if data[:PREAMBLE_BYTES] == preamble():
        return []
    check_kind(data, where, "recorded take", TakeError)
    if len(data) < PREAMBLE_BYTES:
        if not data or not preamble().startswith(data):
            raise TakeError(
                "is not a recorded take" if data else "is empty", where=where, advice="choose a .perftake file"
            )
        raise TakeError(
            "was cut off before anything was recorded",
            where=where,
            advice="record it again: nothing in it can be recovered",
        )
    magic, version, checksum = _PREAMBLE.unpack_from(data)
    if magic == _MAGIC and checksum == zlib.crc32(data[: PREAMBLE_BYTES - _SUM.size]):
        raise TakeError(
            f"is a take of version {version}, but this program reads version {VERSION}",
            where=where,
            advice="open it with the program that recorded it, or a newer one",
        )
    if _head(memoryview(data), PREAMBLE_BYTES) is None and not data.startswith(_MAGIC):
        raise TakeError("is not a recorded take", where=where, advice="choose a .perftake file")
    return [Fault(0, PREAMBLE_BYTES, "the first bytes are damaged")]


def read_chunk(file: BinaryIO | FileIO, offset: int) -> Chunk | None:
    """Return the intact chunk at an offset in an open file, or None if there is none."""
    file.seek(offset)
    first = file.read(HEADER_BYTES)
    head = _head(memoryview(first), 0)
    if head is None:
        return None
    kind, sequence, size, checksum = head
    payload = file.read(size)
    return Chunk(kind, sequence, offset, payload) if zlib.crc32(payload) == checksum else None


def _head(view: memoryview, position: int) -> tuple[int, int, int, int] | None:
    """Return kind, sequence number, size and checksum of a chunk, or None if the header is damaged."""
    if position + HEADER_BYTES > len(view) or view[position : position + 4] != _CHUNK_MAGIC:
        return None
    (checksum,) = _SUM.unpack_from(view, position + _HEAD.size)
    if checksum != zlib.crc32(view[position : position + _HEAD.size]):
        return None
    _, kind, _, sequence, size, payload_sum = _HEAD.unpack_from(view, position)
    return kind, sequence, size, payload_sum


def _next_head(data: bytes, start: int) -> int:
    """Return the position of the next intact header, or the end of the file."""
    view = memoryview(data)
    found = data.find(_CHUNK_MAGIC, start)
    while found >= 0 and _head(view, found) is None:
        found = data.find(_CHUNK_MAGIC, found + 1)
    return found if found >= 0 else len(data)


def _skip(data: bytes, position: int, faults: list[Fault]) -> int:
    """Return the position of the next intact header; the skipped bytes become a fault."""
    stop = _next_head(data, position + 1)
    start = data[position : position + len(_CHUNK_MAGIC)]
    cut = stop == len(data) and stop - position < HEADER_BYTES and _CHUNK_MAGIC.startswith(start)
    what = "the file is cut off within the header of a chunk" if cut else "these bytes are damaged"
    faults.append(Fault(position, stop - position, what, cut=cut))
    return stop


def _gaps(chunks: Sequence[Chunk], faults: Sequence[Fault]) -> list[Fault]:
    """Return a fault for each gap in the sequence numbers that no damage explains."""
    result = []
    expected, stop = 0, PREAMBLE_BYTES
    for chunk in chunks:
        between = any(stop <= fault.offset < chunk.offset for fault in faults)
        if chunk.sequence != expected and not between:
            what = f"chunk {chunk.sequence} follows where chunk {expected} was expected"
            result.append(Fault(chunk.offset, 0, what))
        expected, stop = chunk.sequence + 1, chunk.offset + HEADER_BYTES + len(chunk.payload)
    return result


def _name(kind: int) -> str:
    return ChunkKind(kind).name.lower() if kind in ChunkKind._value2member_map_ else f"kind {kind}"
