"""Writing a take during a capture.

Two threads keep a slow or full disk from delaying the capture: one writes, one flushes to the disk. If the process is
killed, the operating system keeps the written bytes, and the checksum reveals a chunk that was cut off.
"""

import contextlib
import errno
import json
import os
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...errors import FormatError, PerfanimError, TakeError, counted
from ...markers.marker_frame import MarkerFrame
from ...markers.marker_frame_codec import pack_stamped, unpack_stamped
from ...system.files import atomic_path
from ...system.lock import lock
from .chunks import HEADER_BYTES, ChunkKind, encode_chunk, join_records, preamble, scan, split_records
from .footer import Footer, RecordingFacts, duration_s
from .take_reader import take_name, unused_path
from .take_setup import TakeNotes, TakeSetup


@dataclass(frozen=True)
class WriterSettings:
    """Timing of the writer's threads, and memory limit."""

    write_every_s: float = 0.1
    sync_every_s: float = 0.5
    retry_every_s: float = 1.0  # interval between attempts to write while the disk is full
    most_waiting: int = 256 << 20  # largest number of bytes kept in memory while the disk is full


SETTINGS = WriterSettings()


class TakeWriter:
    """A take that is being recorded.

    Args:
        path: New file, or with `resumed` a take without an end mark.
        notes: Notes of a new take; a resumed take keeps its own.
        report: Called from another thread with one line when writing fails, and with "" once it succeeds again.
        resumed: Continue the file; an incomplete chunk at its end is cut off.

    Raises:
        TakeError: The file exists, cannot be written or cannot be resumed.
    """

    def __init__(
        self,
        path: Path | str,
        setup: TakeSetup,
        notes: TakeNotes | None = None,
        report: Callable[[str], None] = lambda problem: None,
        *,
        resumed: bool = False,
    ) -> None:
        self.path = Path(path)
        self.frames = self.poses = 0
        self._report = report
        self._setup = setup
        self._whole = 0  # total size of complete chunks in the file
        self._index: list[tuple[int, int]] = []  # kind and offset, by sequence number
        self._frames_in: deque[bytes] = deque()
        self._poses_in: deque[bytes] = deque()
        self._events_in: deque[dict[str, Any]] = deque()
        self._first_frame = self._last_frame = b""
        self._waiting = bytearray()  # encoded, not yet written
        self._dropped = 0
        self._problem = ""
        self._closed = False
        self._ending = threading.Event()
        self._unsynced = threading.Event()
        if resumed:
            self._file = _open_locked(self.path, 0)
            self._resume()
        else:
            self._file = _open_locked(self.path, os.O_CREAT | os.O_EXCL)
            self._waiting += preamble()
            self._queue(ChunkKind.SETUP, setup.to_json())
            self._queue(ChunkKind.NOTES, (notes or TakeNotes()).to_json())
            self._write()
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._write_loop, self._sync_loop)]
        for thread in self._threads:
            thread.start()

    def _resume(self) -> None:
        """Read the index and counts of the file, and cut off an incomplete chunk."""
        try:
            chunks, faults = scan(self.path.read_bytes(), str(self.path))
            if not chunks or chunks[-1].kind == ChunkKind.END or not all(fault.cut for fault in faults):
                raise OSError(errno.EIO, "it is damaged or has ended")
            self._whole = chunks[-1].offset + HEADER_BYTES + len(chunks[-1].payload)
            os.ftruncate(self._file, self._whole)
            os.lseek(self._file, self._whole, os.SEEK_SET)
        except (OSError, TakeError) as error:
            os.close(self._file)
            advice = "recover it later: its content is kept"
            raise TakeError(f"cannot be resumed ({error})", where=str(self.path), advice=advice) from error
        self._index = [(chunk.kind, chunk.offset) for chunk in chunks]
        self._setup = TakeSetup.from_json(bytes(chunks[0].payload), str(self.path))
        records = [list(split_records(chunk.payload)) for chunk in chunks if chunk.kind == ChunkKind.FRAMES]
        self.frames = sum(map(len, records))
        self.poses = sum(1 for chunk in chunks if chunk.kind == ChunkKind.POSES for _ in split_records(chunk.payload))
        if records:
            self._first_frame, self._last_frame = records[0][0], records[-1][-1]

    @property
    def last_frame(self) -> tuple[float, MarkerFrame] | None:
        """Last written marker frame with its stamp; None before the first."""
        return unpack_stamped(self._last_frame) if self._last_frame else None

    def add_frame(self, record: bytes) -> None:
        """Write a marker frame from `marker_frame_codec.pack_stamped`."""
        self._frames_in.append(record)

    def add_pose(self, record: bytes) -> None:
        """Write a solved pose from `pose_codec.pack_solved`."""
        self._poses_in.append(record)

    def add_event(self, text: str, **facts: Any) -> None:
        """Write an event: a message for people, and machine-readable facts."""
        self._events_in.append({"text": text, **facts})

    def add_gap(self, text: str, after: int, seconds: float) -> None:
        """Write a gap, see `take_reader.Gap`."""
        self.add_event(text, gap={"after": after, "seconds": seconds})

    def close(self, orphaned: bool = False) -> None:
        """Write waiting data and the end mark; `orphaned` says that Blender has ended."""
        if self._closed:
            return
        self._ending.set()
        for thread in self._threads:
            thread.join()
        self._collect()
        self._report_dropped()
        self._queue(ChunkKind.SETUP, self._setup.to_json())  # repeated in case the first one is damaged
        facts = RecordingFacts(self.frames, self.poses, self._duration_s(), orphaned)
        at = self._whole + len(self._waiting)
        self._queue(ChunkKind.END, Footer(facts, (*self._index, (int(ChunkKind.END), at))).pack())
        self._write()
        with contextlib.suppress(OSError):
            os.fsync(self._file)
        self._closed = True
        if self._waiting:
            self._write_elsewhere()
        os.close(self._file)

    def _write_elsewhere(self) -> None:
        """Write the whole take to another disk and change `path`."""
        for folder in (Path.home(), Path(tempfile.gettempdir())):
            path = unused_path(folder, self.path.stem)
            with contextlib.suppress(OSError, FormatError), atomic_path(path) as temporary:
                temporary.write_bytes(self.path.read_bytes()[: self._whole] + self._waiting)
            if path.exists():
                self._report(
                    f"{self.path.name} did not fit on its disk: the whole take is in {path}; move it to your takes"
                )
                self.path = path
                return

    def _write_loop(self) -> None:
        while not self._ending.wait(SETTINGS.retry_every_s if self._problem else SETTINGS.write_every_s):
            try:
                self._collect()
                self._write()
            except Exception as error:  # a bug; later data may still be written
                self._problem = f"the take is not being written ({type(error).__name__}: {error}): report this"
                self._report(self._problem)

    def _sync_loop(self) -> None:
        while not self._ending.wait(SETTINGS.sync_every_s):
            if self._unsynced.is_set():
                self._unsynced.clear()
                with contextlib.suppress(OSError):  # writing reports it as well
                    os.fsync(self._file)

    def _collect(self) -> None:
        """Encode the waiting data as chunks."""
        frames = [self._frames_in.popleft() for _ in range(len(self._frames_in))]
        poses = [self._poses_in.popleft() for _ in range(len(self._poses_in))]
        if len(self._waiting) > SETTINGS.most_waiting:
            self._dropped += len(frames)
            return
        self._report_dropped()
        self.frames += len(frames)
        self.poses += len(poses)
        if frames:
            self._first_frame, self._last_frame = self._first_frame or frames[0], frames[-1]
            self._queue(ChunkKind.FRAMES, join_records(frames))
        if poses:
            self._queue(ChunkKind.POSES, join_records(poses))
        while self._events_in:
            self._event(**self._events_in.popleft())

    def _report_dropped(self) -> None:
        if self._dropped:
            self._event(f"{counted(self._dropped, 'frame')} could not be kept: the disk was full")
            self._dropped = 0

    def _event(self, text: str, **facts: Any) -> None:
        self._queue(ChunkKind.EVENT, json.dumps({"frames": self.frames, "text": text, **facts}).encode("utf-8"))

    def _queue(self, kind: ChunkKind, payload: bytes) -> None:
        sequence = len(self._index)
        self._index.append((kind, self._whole + len(self._waiting)))
        self._waiting += encode_chunk(kind, sequence, payload)

    def _duration_s(self) -> float:
        if not self._last_frame:
            return 0.0
        return duration_s(unpack_stamped(self._first_frame)[1].time_s, unpack_stamped(self._last_frame)[1].time_s)

    def _write(self) -> None:
        """Write the encoded chunks; keep them if that fails."""
        if not self._waiting:
            return
        try:
            written = 0
            while written < len(self._waiting):
                written += os.write(self._file, memoryview(self._waiting)[written:])
        except OSError as error:
            os.lseek(self._file, self._whole, os.SEEK_SET)
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._whole)
            if not self._problem:
                self._problem = f"the take is not being written ({error.strerror}): free some space on its disk"
                self._report(self._problem)
            return
        self._whole += len(self._waiting)
        self._waiting = bytearray()
        self._unsynced.set()
        if self._problem:
            self._problem = ""
            self._report("")


def record_frames(out: Path, setup: TakeSetup, frames: Iterable[MarkerFrame], *, keep_cut: bool = False) -> Path:
    """Write frames as they arrive to an unfinished take next to `out`; return its path.

    Args:
        keep_cut: Keep the take after an error, because cameras cannot repeat it.

    Raises:
        TakeError: The file cannot be written.
        FormatError: The disk is full.
    """
    problems: list[str] = []
    path = unused_path(out.parent, f"{take_name(out)} unfinished")
    writer = TakeWriter(path, setup, TakeNotes(take_name(out)), problems.append)
    try:
        for frame in frames:
            writer.add_frame(pack_stamped(time.perf_counter(), frame))
            if problems:
                break
        writer.close()
        if problems:
            raise FormatError(problems[0], where=str(out))
    except BaseException as error:
        writer.add_event(f"ended: {error}")
        writer.close()
        if not (keep_cut and writer.frames):
            path.unlink()
            writer.path.unlink(missing_ok=True)
        elif isinstance(error, PerfanimError):
            advice = f"the frames recorded before are in {writer.path}"
            raise type(error)(error.what, where=error.where, advice=advice) from error
        raise
    return path


def _open_locked(path: Path, flags: int) -> int:
    """Open a file, creating its folder, and return its handle, locked unless another process keeps the lock."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(path, os.O_RDWR | flags | getattr(os, "O_BINARY", 0), 0o666)
    except OSError as error:
        raise TakeError(
            f"cannot be recorded ({error.strerror})", where=str(path), advice="choose another name or folder"
        ) from error
    for _ in range(20):  # `is_locked` in another process holds the lock for a moment
        if lock(handle):
            break
        time.sleep(0.005)
    return handle
