"""Reading many motion files, in this process or in several, into clips at the database's rate.

Other processes run this file as a script: they have no package, so they make the one they belong to importable by its
place (in Blender it is called bl_ext.<repository>.perfanim, which only Blender can import). They get their files as one
line of JSON and answer each with a JSON header and arrays, never pickles.
"""

import importlib
import importlib.util
import json
import struct
import subprocess
import sys
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..formats.archive import MotionFile
    from ..skeleton import Skeleton

_LENGTH = struct.Struct("<I")
_ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class ReadClip:
    """One unbroken part of a file: rotations (F, J, 4) and root positions (F, 3), float32, at the database's rate."""

    name: str
    source_fps: float
    skeleton: "Skeleton"
    rotations: "NDArray[np.float32]"
    root_positions_m: "NDArray[np.float32]"


@dataclass(frozen=True)
class ReadFile:
    """What reading one file gave: its clips, and the reasons why it or parts of it were left out."""

    clips: tuple[ReadClip, ...]
    reasons: tuple[str, ...]


def read_files(
    files: "Sequence[MotionFile]", fps: float, shortest: int, workers: int
) -> Generator[ReadFile, None, None]:
    """Yield what each file gives, in order.

    Args:
        fps: rate of the clips.
        shortest: frames below which a clip is left out.
        workers: processes; 1 reads here, as does a Python that cannot start another one (Blender's own binary).

    Raises:
        DatabaseError: a reading process died.
    """
    if workers < 2 or len(files) < 2 or not Path(sys.executable).name.lower().startswith("python"):
        for file in files:
            yield read_file(str(file.path), str(file.skeleton or ""), file.stem, fps, shortest)
        return
    processes = [_start(files[i::workers], fps, shortest) for i in range(min(workers, len(files)))]
    try:
        for i in range(len(files)):
            yield _receive(processes[i % len(processes)])
    finally:
        for process in processes:
            process.kill()
            process.communicate()


def read_file(path: str, skeleton: str, name: str, fps: float, shortest: int) -> ReadFile:
    """Return the clips of one file; a file that cannot be read gives none and the reason."""
    from .. import rotations as rot
    from ..errors import PerfanimError
    from ..motion import resampled
    from ..motion_files import read_motion_parts

    try:
        parts, notes = read_motion_parts(Path(path), Path(skeleton) if skeleton else None, name=name)
    except PerfanimError as error:
        return ReadFile((), (str(error).removeprefix(f"{path}: ").replace(path, Path(path).name),))
    clips, reasons = [], list(notes)
    for part in parts:
        motion = resampled(part, fps)
        if motion.frames < shortest:
            reasons.append(f"{part.name} has only {motion.frames} frames at {fps:g} frames per second")
            continue
        rotations = rot.continuous(motion.rotations).astype(np.float32)
        positions = motion.root_positions_m.astype(np.float32)
        clips.append(ReadClip(part.name, part.fps, part.skeleton, rotations, positions))
    return ReadFile(tuple(clips), tuple(reasons))


def _start(files: "Sequence[MotionFile]", fps: float, shortest: int) -> "subprocess.Popen[bytes]":
    tasks = [[str(file.path), str(file.skeleton or ""), file.stem, fps, shortest] for file in files]
    process = subprocess.Popen(
        [sys.executable, str(Path(__file__).resolve())], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert process.stdin is not None  # noqa: S101  # it was asked for
    order = {"root": str(_ROOT), "paths": sys.path, "tasks": tasks}
    process.stdin.write(json.dumps(order).encode() + b"\n")
    process.stdin.close()
    process.stdin = None
    return process


def _receive(process: "subprocess.Popen[bytes]") -> ReadFile:
    from ..skeleton import Skeleton

    assert process.stdout is not None  # noqa: S101  # it was asked for
    (length,) = _LENGTH.unpack(_exactly(process.stdout, _LENGTH.size))
    header = json.loads(_exactly(process.stdout, length))
    clips = []
    for row in header["clips"]:
        skeleton = Skeleton(
            tuple(row["names"]), np.array(row["parents"]), np.array(row["offsets_m"]), np.array(row["tips_m"]),
            np.array(row["angle_axes"]), tuple(row["angle_orders"]),
        )  # fmt: skip
        frames, joints = row["frames"], len(skeleton)
        rotations = np.frombuffer(_exactly(process.stdout, frames * joints * 16), np.float32)
        positions = np.frombuffer(_exactly(process.stdout, frames * 12), np.float32)
        clips.append(
            ReadClip(
                row["name"], row["source_fps"], skeleton, rotations.reshape(frames, joints, 4), positions.reshape(-1, 3)
            )
        )
    return ReadFile(tuple(clips), tuple(header["reasons"]))


def _exactly(stream: IO[bytes], count: int) -> bytes:
    from ..errors import DatabaseError

    data = stream.read(count)
    if len(data) != count:
        raise DatabaseError("a process that reads motion files died", advice="build with --workers 1")
    return data


def _send(stream: IO[bytes], result: Any) -> None:
    rows = [
        {
            "name": clip.name,
            "source_fps": clip.source_fps,
            "frames": len(clip.rotations),
            "names": clip.skeleton.names,
            "parents": clip.skeleton.parents.tolist(),
            "offsets_m": clip.skeleton.offsets_m.tolist(),
            "tips_m": clip.skeleton.tips_m.tolist(),
            "angle_axes": clip.skeleton.angle_axes.tolist(),
            "angle_orders": clip.skeleton.angle_orders,
        }
        for clip in result.clips
    ]
    header = json.dumps({"clips": rows, "reasons": result.reasons}).encode()
    stream.write(_LENGTH.pack(len(header)) + header)
    for clip in result.clips:
        stream.write(clip.rotations.tobytes())
        stream.write(clip.root_positions_m.tobytes())
    stream.flush()


def _serve() -> None:
    """Read the files that standard input names and send what they give to standard output."""
    order = json.loads(sys.stdin.readline())
    sys.path.extend(path for path in order["paths"] if path not in sys.path)
    root = order["root"]
    spec = importlib.util.spec_from_file_location("perfanim", f"{root}/__init__.py", submodule_search_locations=[root])
    if spec is None or spec.loader is None:
        raise SystemExit(f"no extension in {root}")
    package = importlib.util.module_from_spec(spec)
    sys.modules["perfanim"] = package
    spec.loader.exec_module(package)
    reading = importlib.import_module("perfanim.core.database.reading")
    for task in order["tasks"]:
        _send(sys.stdout.buffer, reading.read_file(*task))


if __name__ == "__main__":
    _serve()
