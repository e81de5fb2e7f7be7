"""New notes at the end of a recorded take."""

import errno
import os
from io import FileIO
from pathlib import Path

from ...errors import TakeError
from ...system.files import writing
from ...system.lock import lock
from .chunks import ChunkKind, encode_chunk
from .footer import Footer, find_footer
from .take_setup import TakeNotes


def append_notes(path: Path | str, notes: TakeNotes) -> None:
    """Append notes that replace the current ones; TakeError if the take has no end mark or is being recorded."""
    with writing(path, "free some space, or check the folder", TakeError), Path(path).open("r+b", buffering=0) as file:
        if not lock(file.fileno()):
            raise TakeError("is being recorded", where=str(path), advice="wait for the end of the capture")
        footer = find_footer(file)
        if footer is None:
            raise TakeError("was cut off", where=str(path), advice="recover the take first")
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
