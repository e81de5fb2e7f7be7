"""Reading many motion files as clips at one rate, in one or several processes.

Other processes run `serve`: they receive each file as a line of JSON and answer with a JSON header and arrays.
"""

import json
import queue
import re
import sys
from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..body.motion import resampled
from ..body.motion_cleaning import Defect, clean_motion
from ..body.skeleton import Skeleton
from ..errors import DatabaseError, PerfanimError, counted
from ..formats.motion.motion_sources import MotionFile
from ..formats.motion.read_motion import read_motion_parts
from ..geometry import rotations as rot
from ..geometry.arrays import FloatArray
from ..system.json_process import JsonProcess
from .skeleton_facts import skeleton_facts, skeleton_from_facts

_LEAST_FRAMES = 4  # fewest frames of a clip, because the search uses accelerations


@dataclass(frozen=True)
class ReadClip:
    """Consecutive frames of a file, at the database's rate.

    Args:
        first_frame: First frame in the file, counted from 0.
        rotations, root_positions_m: Local rotations (F, J, 4) and positions (F, 3).
    """

    name: str
    first_frame: int
    source_fps: float
    skeleton: Skeleton
    rotations: FloatArray
    root_positions_m: FloatArray


@dataclass(frozen=True)
class ReadFile:
    """Clips and defects of a file, or the reason why it cannot be read.

    Args:
        defects: Rows with the frames ("12" or "12-15", counted from 1; "" for the whole file), the defect and what was
            done about it.
        reason: Reason why the file cannot be read; "" if it was read.
        line: Line of the file that caused the failure, 0 if unknown.
    """

    clips: tuple[ReadClip, ...]
    defects: tuple[dict[str, str], ...]
    reason: str
    line: int


def read_files(
    files: Sequence[MotionFile], fps: float, workers: int, ahead: int = 8
) -> Generator[ReadFile, None, None]:
    """Yield the result for each file, in order.

    Args:
        workers: Number of processes; with 1, this process reads all files. Blender's executable ignores the number and
            reads them itself, because it cannot start Python processes.
        ahead: Files per process that may be read in advance.

    Raises:
        DatabaseError: A reading process died.
    """
    tasks = [(str(file.path), str(file.skeleton or ""), file.stem, fps) for file in files]
    if workers < 2 or len(files) < 2 or not Path(sys.executable).name.lower().startswith("python"):
        for task in tasks:
            yield read_file(*task)
        return
    readers = [_ReaderProcess() for _ in range(min(workers, len(files)))]
    free: queue.SimpleQueue[_ReaderProcess] = queue.SimpleQueue()
    for reader in readers:
        free.put(reader)

    def read(task: Sequence[Any]) -> ReadFile:
        reader = free.get()
        try:
            return reader.read(task)
        finally:
            free.put(reader)

    # one thread per process, so that no process waits while another one reads a long file
    pool = ThreadPoolExecutor(len(readers))
    pending: deque[Future[ReadFile]] = deque()
    try:
        for task in tasks:
            pending.append(pool.submit(read, task))
            if len(pending) > ahead * len(readers):
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    finally:
        for reader in readers:
            reader.kill()
        pool.shutdown(cancel_futures=True)
        for reader in readers:
            reader.close()


class _ReaderProcess:
    _skeleton: Skeleton  # skeleton of the last clip

    def __init__(self) -> None:
        self._process = JsonProcess(serve)
        self.kill, self.close = self._process.kill, self._process.close

    def read(self, task: Sequence[Any]) -> ReadFile:
        try:
            return self._read(task)
        except BrokenPipeError:
            advice = "build the database with one process"
            raise DatabaseError("a process that was reading motion files died", advice=advice) from None

    def _read(self, task: Sequence[Any]) -> ReadFile:
        header = json.loads(self._process.ask(json.dumps(task)))
        clips = []
        for row in header["clips"]:
            if row["skeleton"] is not None:
                self._skeleton = skeleton_from_facts(row["skeleton"])
            frames, joints = row["frames"], len(self._skeleton)
            rotations = np.frombuffer(self._process.read(frames * joints * 16), np.float32).reshape(frames, joints, 4)
            positions = np.frombuffer(self._process.read(frames * 12), np.float32).reshape(frames, 3)
            clips.append(
                ReadClip(row["name"], row["first_frame"], row["source_fps"], self._skeleton, rotations, positions)
            )
        return ReadFile(tuple(clips), tuple(header["defects"]), header["reason"], header["line"])


def read_file(path: str, skeleton: str, name: str, fps: float) -> ReadFile:
    """Return the clips of one file, or the reason why it cannot be read."""
    try:
        read = read_motion_parts(Path(path), Path(skeleton) if skeleton else None, name=name)
    except PerfanimError as error:
        line = re.search(r", line (\d+)$", error.where) if error.where.startswith(path) else None
        reason = str(error).removeprefix(f"{error.where}: ") if error.where.startswith(path) else str(error)
        # files from an archive have meaningless names on disk
        for known, text in ((path, name), (skeleton, "the skeleton file")):
            reason = reason.replace(known, text) if known else reason
        return ReadFile((), (), reason, int(line[1]) if line else 0)
    clips, rows = [], [_row(defect, 0) for defect in read.defects]
    for part in read.parts:
        cleaned = clean_motion(part.motion, part.angle_jumps)
        rows += [_row(defect, part.first_frame) for defect in cleaned.defects]
        for start, sound in cleaned.parts:
            motion = resampled(sound, fps)
            first = part.first_frame + start
            if motion.frames < _LEAST_FRAMES:
                frames = _frames(first + 1, first + sound.frames)
                count = counted(motion.frames, "frame")
                kind = f"only {count} at {fps:g} Hz, but at least {_LEAST_FRAMES} are needed"
                rows.append({"frames": frames, "defect": kind, "done": "left out"})
                continue
            rotations = np.ascontiguousarray(rot.continuous(motion.rotations), dtype=np.float32)
            positions = np.ascontiguousarray(motion.root_positions_m, dtype=np.float32)
            clips.append(ReadClip(name, first, sound.fps, sound.skeleton, rotations, positions))
    return ReadFile(tuple(clips), tuple(rows), "", 0)


def _row(defect: Defect, before: int) -> dict[str, str]:
    frames = _frames(before + defect.first, before + defect.last) if defect.first else ""
    return {"frames": frames, "defect": defect.kind, "done": defect.done}


def _frames(first: int, last: int) -> str:
    return str(first) if first == last else f"{first}-{last}"


def serve() -> None:
    """Read the files named on standard input and write the results to standard output."""
    sent: Skeleton | None = None
    for line in sys.stdin:
        sent = _send(read_file(*json.loads(line)), sent, sys.stdout.buffer)


def _send(result: ReadFile, sent: Skeleton | None, stream: IO[bytes]) -> Skeleton | None:
    """Write a result for `_ReaderProcess`, omitting a skeleton that was just sent; return the last skeleton."""
    rows: list[dict[str, Any]] = []
    for clip in result.clips:
        facts = {"name": clip.name, "first_frame": clip.first_frame, "source_fps": clip.source_fps}
        skeleton = None if clip.skeleton is sent else skeleton_facts(clip.skeleton)
        rows.append(facts | {"frames": len(clip.rotations), "skeleton": skeleton})
        sent = clip.skeleton
    header = {"clips": rows, "defects": result.defects, "reason": result.reason, "line": result.line}
    stream.write(json.dumps(header).encode() + b"\n")
    for clip in result.clips:
        stream.write(clip.rotations.data)
        stream.write(clip.root_positions_m.data)
    stream.flush()
    return sent
