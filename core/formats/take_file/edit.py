"""What is done with a take after its recording: its notes changed, a cut or damaged one written anew."""

import errno
import json
import os
from io import FileIO
from pathlib import Path

from ...errors import TakeError
from .chunks import ChunkKind, encode_chunk
from .footer import Footer, find_footer
from .lock import is_locked, lock
from .reading import TakeFile
from .setup import TakeNotes
from .whole import take_facts, write_chunks


def append_notes(path: Path | str, notes: TakeNotes) -> None:
    """Change what is said about a take; nothing that is in the file is touched.

    Raises:
        TakeError: it has no end mark, is being written, or cannot be.
    """
    try:
        with Path(path).open("r+b", buffering=0) as file:
            if not lock(file.fileno()):
                raise TakeError("is being recorded", where=str(path), advice="wait for the end of the capture")
            footer = find_footer(file)
            if footer is None:
                raise TakeError("has no end mark", where=str(path), advice="recover it first")
            _append(file, footer, notes)
    except OSError as error:
        raise TakeError(
            f"cannot be written ({error.strerror})", where=str(path), advice="free some space, or check the folder"
        ) from error


def _append(file: FileIO, footer: Footer, notes: TakeNotes) -> None:
    """Write notes and another end mark behind the last one, both or neither."""
    start, sequence = file.seek(0, os.SEEK_END), len(footer.index)
    said = encode_chunk(ChunkKind.NOTES, sequence, notes.to_json())
    index = (*footer.index, (int(ChunkKind.NOTES), start), (int(ChunkKind.END), start + len(said)))
    said += encode_chunk(ChunkKind.END, sequence + 1, Footer(footer.facts, index).pack())
    try:
        if file.write(said) != len(said):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.fsync(file.fileno())
    except OSError:
        file.truncate(start)
        raise


def recover(take: TakeFile, path: Path | str) -> None:
    """Write all that is intact of a take as a whole take.

    Raises:
        TakeError: it is being recorded, `path` is its own file, or its calibration and subject are lost.
        FormatError: `path` cannot be written.
    """
    path = Path(path)
    if path.exists() and path.samefile(take.path):
        raise TakeError("would be overwritten", where=str(path), advice="give another name: what is cut off is kept")
    if is_locked(take.path):
        raise TakeError("is being recorded", where=str(take.path), advice="wait for the end of the capture")
    _ = take.setup
    frames = take.frames
    told = json.dumps({"frames": len(frames), "text": "recovered: " + ("; ".join(map(str, take.faults)) or "cut off")})
    kept = [(chunk.kind, bytes(chunk.payload)) for chunk in take.chunks if chunk.kind != ChunkKind.END]
    kept.append((ChunkKind.EVENT, told.encode("utf-8")))
    write_chunks(path, kept, take_facts(frames, len(take.poses)))
