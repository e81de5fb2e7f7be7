"""Writing a complete take from frames in memory that were imported or solved again."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from ...markers.marker_frame import MarkerFrame
from ...markers.marker_frame_codec import pack_stamped
from ...system.files import atomic_path
from .chunks import ChunkKind, encode_chunk, join_records, preamble
from .footer import Footer, RecordingFacts, duration_s
from .pose_codec import TimedPose, pack_solved
from .take_setup import TakeNotes, TakeSetup


def write_whole_take(
    path: Path | str,
    setup: TakeSetup,
    notes: TakeNotes,
    frames: Sequence[tuple[float, MarkerFrame]],
    poses: Sequence[TimedPose],
    events: Sequence[bytes] = (),
) -> None:
    """Write a complete take, replacing an existing file; FormatError if `path` cannot be written.

    Args:
        frames: Stamps and frames, as in `TakeFile.stamped_frames`.
        events: Payloads of event chunks.
    """
    chunks = [(ChunkKind.SETUP, setup.to_json()), (ChunkKind.NOTES, notes.to_json())]
    chunks += _chunked(ChunkKind.FRAMES, [pack_stamped(stamp_s, frame) for stamp_s, frame in frames])
    chunks += _chunked(ChunkKind.POSES, [pack_solved(pose) for pose in poses])
    chunks += [(ChunkKind.EVENT, event) for event in events]
    chunks.append((ChunkKind.SETUP, setup.to_json()))  # repeated in case the first one is damaged
    write_chunks(path, chunks, take_facts([frame for _, frame in frames], len(poses)))


def take_facts(frames: Sequence[MarkerFrame], poses: int) -> RecordingFacts:
    """Return the facts for the end mark."""
    passed_s = duration_s(frames[0].time_s, frames[-1].time_s) if frames else 0.0
    return RecordingFacts(len(frames), poses, passed_s)


def write_chunks(path: Path | str, chunks: Iterable[tuple[int, bytes]], facts: RecordingFacts) -> None:
    """Write a complete take from chunks (kind and payload); FormatError if `path` cannot be written."""
    index: list[tuple[int, int]] = []
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(preamble())
        for kind, payload in chunks:
            index.append((kind, file.tell()))
            file.write(encode_chunk(kind, len(index) - 1, payload))
        index.append((ChunkKind.END, file.tell()))
        file.write(encode_chunk(ChunkKind.END, len(index) - 1, Footer(facts, tuple(index)).pack()))


def _chunked(kind: ChunkKind, records: Sequence[bytes], size: int = 64) -> list[tuple[ChunkKind, bytes]]:
    """Return chunks of `size` records: not larger, because one damaged byte destroys a whole chunk."""
    return [(kind, join_records(records[start : start + size])) for start in range(0, len(records), size)]
