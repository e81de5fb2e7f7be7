"""Footer of a complete take: facts, and the index of its chunks."""

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from io import FileIO
from typing import Any, BinaryIO

from ...errors import TakeError
from .chunks import HEADER_BYTES, ChunkKind, read_chunk

_MAGIC = b"PFTAKEND"
_FACTS = struct.Struct("<I")  # bytes of the facts, which follow as JSON
_ROW = struct.Struct("<HHIQ")  # kind, 0, sequence number, offset
_TRAILER = struct.Struct("<Q8s")  # offset of the END chunk, magic


@dataclass(frozen=True)
class Footer:
    """Content of the END chunk.

    Args:
        facts: "frames", "poses", "duration_s" of the recording; "orphaned", whether the recording outlived Blender.
        index: kind and offset of every chunk, the END chunk's last, by sequence number.
    """

    facts: Mapping[str, Any]
    index: tuple[tuple[int, int], ...]

    def pack(self) -> bytes:
        """Return the payload of the END chunk."""
        text = json.dumps(dict(self.facts)).encode("utf-8")
        rows = b"".join(_ROW.pack(kind, 0, sequence, offset) for sequence, (kind, offset) in enumerate(self.index))
        return _FACTS.pack(len(text)) + text + rows + _TRAILER.pack(self.index[-1][1], _MAGIC)

    @staticmethod
    def unpack(payload: memoryview | bytes) -> "Footer":
        """Return the footer of `pack`; TakeError for other bytes."""
        try:
            (size,) = _FACTS.unpack_from(payload)
            start, stop = _FACTS.size + size, len(payload) - _TRAILER.size
            facts = json.loads(bytes(payload[_FACTS.size : start]))
            rows = tuple((kind, offset) for kind, _, _, offset in _ROW.iter_unpack(payload[start:stop]))
            return Footer(dict(facts), rows)
        except (struct.error, ValueError, TypeError) as error:
            raise TakeError(f"has an end mark that is not understood ({error})") from error


def find_footer(file: BinaryIO | FileIO) -> Footer | None:
    """Return the footer of an open file, None where the take was cut off."""
    size = file.seek(0, 2)
    if size < _TRAILER.size + HEADER_BYTES:
        return None
    file.seek(size - _TRAILER.size)
    offset, magic = _TRAILER.unpack(file.read())
    if magic != _MAGIC or offset > size - HEADER_BYTES:
        return None
    chunk = read_chunk(file, offset)
    return Footer.unpack(chunk.payload) if chunk is not None and chunk.kind == ChunkKind.END else None
