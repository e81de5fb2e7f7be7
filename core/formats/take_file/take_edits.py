"""Changes to recorded takes: new notes, and recovery of damaged takes."""

import errno
import json
import os
from io import FileIO
from pathlib import Path

from ...errors import TakeError
from ...system.files import writing
from ...system.lock import is_locked, lock
from ...system.outputs import check_no_input
from .chunks import ChunkKind, encode_chunk
from .footer import Footer, find_footer
from .take_reader import TakeFile
from .take_setup import TakeNotes
from .whole_take import take_facts, write_chunks


def append_notes(path: Path | str, notes: TakeNotes) -> None:
    """Append notes that replace the current ones; TakeError if the take has no end mark or is being recorded."""
    with writing(path, "free some space, or check the folder", TakeError), Path(path).open("r+b", buffering=0) as file:
        if not lock(file.fileno()):
            raise TakeError("is being recorded", where=str(path), advice="wait for the end of the capture")
        footer = find_footer(file)
        if footer is None:
            raise TakeError("has no end mark", where=str(path), advice="recover it first")
        _append(file, footer, notes)


def _append(file: FileIO, footer: Footer, notes: TakeNotes) -> None:
    """Append notes and a new end mark; if either fails, append neither."""
    start, sequence = file.seek(0, os.SEEK_END), len(footer.index)
    data = encode_chunk(ChunkKind.NOTES, sequence, notes.to_json())
    index = (*footer.index, (int(ChunkKind.NOTES), start), (int(ChunkKind.END), start + len(data)))
    data += encode_chunk(ChunkKind.END, sequence + 1, Footer(footer.facts, index).pack())
    try:
        if file.write(data) != len(data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.fsync(file.fileno())
    except OSError:
        file.truncate(start)
        raise


def recover(take: TakeFile, path: Path | str) -> None:
    """Write the intact part of a take as a complete take.

    Raises:
        TakeError: The take is being recorded, or its set-up is lost.
        FormatError: `path` cannot be written, or is the take's own file.
    """
    path = Path(path)
    check_no_input(path, [take.path])
    if is_locked(take.path):
        raise TakeError("is being recorded", where=str(take.path), advice="wait for the end of the capture")
    _ = take.setup  # raises TakeError if it is lost
    frames = take.frames
    event = json.dumps({"frames": len(frames), "text": "recovered: " + ("; ".join(map(str, take.faults)) or "cut off")})
    kept = [(chunk.kind, bytes(chunk.payload)) for chunk in take.chunks if chunk.kind != ChunkKind.END]
    kept.append((ChunkKind.EVENT, event.encode("utf-8")))
    write_chunks(path, kept, take_facts(frames, len(take.poses)))
