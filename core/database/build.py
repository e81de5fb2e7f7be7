"""Building a motion database from motion files of any skeleton."""

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DatabaseError
from ..formats.archive import MotionFile, motion_files
from ..skeleton import Skeleton
from .graph import LARGE_DATABASE, GraphSettings
from .labels import behaviour_of, subject_of
from .reading import ReadClip, read_files
from .store import Clip, write_database

FloatArray = NDArray[np.float32]
ProgressFunction = Callable[[float, str], None]

_SAME_BONES_M = 2e-4  # offsets that differ by less are one body, written with other rounding
_SHORTEST_CLIP = 4  # frames; the query metric looks at accelerations


@dataclass
class _Collected:
    """What has been read so far."""

    clips: list[Clip] = field(default_factory=list)
    rotations: list[FloatArray] = field(default_factory=list)
    positions: list[FloatArray] = field(default_factory=list)
    skeletons: list[Skeleton] = field(default_factory=list)
    skipped: list[dict[str, str]] = field(default_factory=list)
    frames: int = 0

    def add(self, clip: ReadClip, file: MotionFile) -> None:
        stop = self.frames + len(clip.rotations)
        self.clips.append(
            Clip(
                name=clip.name,
                behaviour=behaviour_of(file.name, file.description),
                subject=subject_of(file.name),
                source_fps=clip.source_fps,
                start=self.frames,
                stop=stop,
                skeleton=self._skeleton_index(clip.skeleton),
            )
        )
        self.rotations.append(clip.rotations)
        self.positions.append(clip.root_positions_m)
        self.frames = stop

    def _skeleton_index(self, skeleton: Skeleton) -> int:
        for index, known in enumerate(self.skeletons):
            if np.allclose(known.offsets_m, skeleton.offsets_m, rtol=0.0, atol=_SAME_BONES_M):
                return index
        self.skeletons.append(skeleton)
        return len(self.skeletons) - 1


def build_database(
    sources: Sequence[Path | str],
    out: Path | str,
    fps: float = 60.0,
    exclude: Sequence[str] = (),
    workers: int = 1,
    progress: ProgressFunction | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> dict[str, Any]:
    """Read all motion of files, folders and archives into one database file.

    Every clip is mapped onto the product's joints, brought to `fps` on the shortest arcs, and keeps its subject's
    bone lengths. A file that cannot be read is skipped with the reason; frames with missing numbers are left out, and
    the clip goes on as another after them. A large database is stored with its neighbour graph.

    Args:
        sources: BVH and AMC files, folders and archives with such files and their ASF skeletons.
        out: database file; written only when all is read.
        exclude: globs on file names or stems to leave out.
        workers: processes that read (see `read_files`).
        progress: called with the fraction done and a text.
        cancelled: asked after every file; when true, nothing is written.

    Returns:
        frames, clips, seconds, bytes, fps, behaviours (name -> frames), skipped (list of file, reason).

    Raises:
        FormatError: a source is missing or a damaged archive.
        DatabaseError: nothing readable was found, or it was cancelled.
    """
    started = time.monotonic()
    collected = _Collected()
    with (
        motion_files(sources, exclude) as files,
        closing(read_files(files, fps, _SHORTEST_CLIP, workers)) as results,
    ):
        for done, file in enumerate(files):
            if cancelled is not None and cancelled():
                raise DatabaseError("was cancelled", where=str(out))
            if progress is not None:
                progress(done / len(files), f"reading {file.name}")
            result = next(results)
            collected.skipped += [{"file": file.name, "reason": reason} for reason in result.reasons]
            for clip in result.clips:
                collected.add(clip, file)
    if not collected.clips:
        reasons = "; ".join(f"{row['file']}: {row['reason']}" for row in collected.skipped[:3])
        raise DatabaseError(
            f"found no usable motion ({reasons or 'no .bvh or .amc files'})",
            where=", ".join(str(source) for source in sources),
            advice="give folders with BVH or ASF/AMC files",
        )
    if progress is not None:
        progress(1.0, "writing")
    rotations, positions = np.concatenate(collected.rotations), np.concatenate(collected.positions)
    collected.rotations.clear()
    graph = GraphSettings() if collected.frames >= LARGE_DATABASE else None
    write_database(out, fps, rotations, positions, collected.clips, collected.skeletons, graph)
    return _report(collected, Path(out), fps, started)


def _report(collected: _Collected, out: Path, fps: float, started: float) -> dict[str, Any]:
    behaviours: dict[str, int] = {}
    for clip in collected.clips:
        behaviours[clip.behaviour] = behaviours.get(clip.behaviour, 0) + clip.stop - clip.start
    return {
        "frames": collected.frames,
        "clips": len(collected.clips),
        "fps": fps,
        "skipped": collected.skipped,
        "seconds": round(time.monotonic() - started, 2),
        "bytes": out.stat().st_size,
        "behaviours": behaviours,
    }
