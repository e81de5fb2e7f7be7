"""Recovery of damaged recorded takes."""

import json
from pathlib import Path

from ...errors import TakeError
from ...system.lock import is_locked
from ...system.outputs import check_no_input
from .chunks import ChunkKind
from .take_reader import TakeFile
from .whole_take import take_facts, write_chunks


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
