"""Footer of a complete take: facts about the recording, and the index of its chunks."""

import json
import math
import struct
from dataclasses import dataclass
from io import FileIO
from typing import Annotated, BinaryIO

from ...errors import TakeError
from ...system.files import reading
from ...system.schema import About, Schema, table_of
from .chunks import HEADER_BYTES, ChunkKind, read_chunk
from .take_setup import json_object

_MAGIC = b"PFTAKEND"
_FACTS = struct.Struct("<I")  # size of the JSON facts that follow
_ROW = struct.Struct("<HHIQ")  # kind, 0, sequence number, offset
_TRAILER = struct.Struct("<Q8s")  # offset of the END chunk, magic
_LONGEST_S = 1e15


@dataclass(frozen=True)
class RecordingFacts:
    """Facts about a recording."""

    frames: Annotated[int, About("marker frames", "", 0, 1e15)] = 0
    poses: Annotated[int, About("solved poses", "", 0, 1e15)] = 0
    duration_s: Annotated[float, About("between first and last frame", "s", -_LONGEST_S, _LONGEST_S)] = 0.0
    orphaned: Annotated[bool, About("whether the recording outlived Blender")] = False


_SCHEMA = Schema(
    RecordingFacts,
    "End mark of a take",
    "Facts of the recording, written with its last chunk.",
    TakeError,
    "check the file",
)


@dataclass(frozen=True)
class Footer:
    """Contents of the END chunk.

    Args:
        index: Kind and offset of every chunk by sequence number, including the END chunk.
    """

    facts: RecordingFacts
    index: tuple[tuple[int, int], ...]

    def pack(self) -> bytes:
        """Return the payload of the END chunk."""
        text = json.dumps(table_of(self.facts)).encode("utf-8")
        rows = b"".join(_ROW.pack(kind, 0, sequence, offset) for sequence, (kind, offset) in enumerate(self.index))
        return _FACTS.pack(len(text)) + text + rows + _TRAILER.pack(self.index[-1][1], _MAGIC)

    @staticmethod
    def unpack(payload: memoryview | bytes, where: str) -> "Footer":
        """Return the footer from the bytes of `pack`; TakeError if they are invalid."""
        with reading(where, TakeError, what="has an unreadable end mark"):
            (size,) = _FACTS.unpack_from(payload)
            start, stop = _FACTS.size + size, len(payload) - _TRAILER.size
            facts = json_object(bytes(payload[_FACTS.size : start]), f"{where}, end mark")
            rows = tuple((kind, offset) for kind, _, _, offset in _ROW.iter_unpack(payload[start:stop]))
        return Footer(_SCHEMA.read(facts, f"{where}, end mark"), rows)


def duration_s(first_s: float, last_s: float) -> float:
    """Return the duration between two times, or 0 if they are damaged."""
    passed_s = last_s - first_s
    return passed_s if math.isfinite(passed_s) and abs(passed_s) <= _LONGEST_S else 0.0


def find_footer(file: BinaryIO | FileIO) -> Footer | None:
    """Return the footer of an open file, or None if it was cut off or damaged."""
    size = file.seek(0, 2)
    if size < _TRAILER.size + HEADER_BYTES:
        return None
    file.seek(size - _TRAILER.size)
    offset, magic = _TRAILER.unpack(file.read())
    if magic != _MAGIC or offset > size - HEADER_BYTES:
        return None
    chunk = read_chunk(file, offset)
    if chunk is None or chunk.kind != ChunkKind.END:
        return None
    try:
        return Footer.unpack(chunk.payload, "")
    except TakeError:  # a reader of the whole file reports the damage
        return None
