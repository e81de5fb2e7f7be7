"""Building a motion database from motion files of any skeleton."""

import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..body.mirroring import mirrored_behaviour, mirrored_points, mirrored_rotations, mirrored_skeleton
from ..body.skeleton import Skeleton
from ..body.standard_skeleton import JOINT_NAMES
from ..errors import DatabaseError
from ..formats.motion.motion_sources import MotionFile, motion_files
from ..geometry.arrays import FloatArray
from ..system.files import remove_left_behind, writing
from ..system.progress import Progress, no_progress
from .clip_reader import ReadClip, read_files
from .culling import clips_after_culling, near_duplicates
from .file_selection import behaviour_of, select_files, subject_of
from .frame_file import FrameFile
from .header_facts import Clip
from .reference_poses import reference_pose_report, relative_poses
from .store import Database, same_bones, save_database

_READ, _CULLED = 0.6, 0.7  # progress once all files are read, and once near-duplicates are culled


@dataclass
class _Collected:
    """Clips and frames read so far."""

    rotations: FrameFile
    mirror: bool
    clips: list[Clip] = field(default_factory=list)
    root_rotations: list[FloatArray] = field(default_factory=list)
    root_positions_m: list[FloatArray] = field(default_factory=list)
    skeletons: list[Skeleton] = field(default_factory=list)
    skipped: list[dict[str, Any]] = field(default_factory=list)
    defects: list[dict[str, str]] = field(default_factory=list)

    def add(self, read: ReadClip, file: MotionFile) -> None:
        clip = Clip(
            name=read.name,
            behaviour=behaviour_of(file.name, file.description),
            subject=subject_of(file.name),
            source_fps=read.source_fps,
            start=len(self.rotations),
            stop=len(self.rotations) + len(read.rotations),
            skeleton=self._skeleton_index(read.skeleton),
            first_frame=read.first_frame,
        )
        self._append(clip, read.rotations, read.root_positions_m)
        if self.mirror:
            image = replace(
                clip,
                behaviour=mirrored_behaviour(clip.behaviour),
                start=clip.stop,
                stop=clip.stop + len(read.rotations),
                skeleton=self._skeleton_index(mirrored_skeleton(read.skeleton)),
                mirrored=True,
            )
            self._append(image, mirrored_rotations(read.rotations), mirrored_points(read.root_positions_m))

    def _append(self, clip: Clip, rotations: FloatArray, root_positions_m: FloatArray) -> None:
        self.clips.append(clip)
        self.rotations.append(rotations)
        self.root_rotations.append(rotations[:, 0].copy())
        self.root_positions_m.append(root_positions_m)

    def _skeleton_index(self, skeleton: Skeleton) -> int:
        for index, known in enumerate(self.skeletons):
            if same_bones(known.offsets_m, skeleton.offsets_m):
                return index
        self.skeletons.append(skeleton)
        return len(self.skeletons) - 1


@dataclass(frozen=True)
class BuildSettings:
    """Options for building a database.

    Args:
        fps: Frame rate of the database.
        include, exclude: Globs of files to read or to leave out, see `select_files`.
        mirror: Add the mirror image of each clip.
        cull_deg: Distance below which passages count as near-duplicates and are left out, see `culling`; 0 keeps all.
        workers: Number of reading processes, see `read_files`; None for one per core if there is enough to read.
    """

    fps: float = 60.0
    include: Sequence[str] = ()
    exclude: Sequence[str] = ()
    mirror: bool = False
    cull_deg: float = 0.0
    workers: int | None = None


def build_database(
    sources: Sequence[Path | str],
    out: Path | str,
    settings: BuildSettings | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Read all motion from files, folders and archives into one database file.

    Every clip is mapped onto the standard skeleton with its subject's bone lengths, cleaned (`body.motion_cleaning`)
    and resampled. A file that cannot be read is skipped, and the reason is reported. Frames are collected in a file
    next to `out`, so that only the poses are held in memory (336 bytes per frame).

    Args:
        sources: BVH and AMC files, folders and archives with such files and their ASF skeletons.
        out: Database file; written once all motion has been read.

    Returns:
        frames, clips, seconds, bytes, fps, behaviours (name -> frames), zeros (subject -> joint -> degrees between its
        reference pose and the common one), skipped (list of file, line, reason), defects (list of file, frames,
        defect, done; those kept unchanged come last), mirrored_clips, culled_frames, peak_memory_mb of this process and
        peak_reader_memory_mb of the largest reading process, None where unknown.

    Raises:
        FormatError: A source is missing or is a damaged archive, or `out` cannot be written.
        DatabaseError: Nothing readable was found.
    """
    started = time.monotonic()
    settings, out = settings or BuildSettings(), Path(out)
    step = progress or no_progress
    with _folder_beside(out) as folder, closing(FrameFile(folder / "rotations", (len(JOINT_NAMES), 4))) as rotations:
        collected = _Collected(rotations, settings.mirror)
        with motion_files(sources) as found:
            files = select_files(found, settings.include, settings.exclude)
            _read(files, collected, settings, step)
        if not collected.clips:
            raise _nothing_usable(sources, collected)
        step(_READ, "computing poses")
        database = _join_clips(collected, out, settings.fps)
    if settings.cull_deg > 0.0:
        step(_READ, "looking for near-duplicates")
        database = _drop_duplicates(database, settings.cull_deg)
    step(_CULLED, "grouping similar frames and writing")
    save_database(database)
    return _report(database, collected, started)


def _join_clips(collected: _Collected, out: Path, fps: float) -> Database:
    """Return the collected clips as a database in memory."""
    mean_rotations, references, poses = relative_poses(collected.rotations, collected.clips)
    return Database(
        out,
        fps,
        clips=tuple(collected.clips),
        skeletons=tuple(collected.skeletons),
        mean_rotations=mean_rotations,
        poses=poses,
        root_rotations=np.concatenate(collected.root_rotations),
        root_positions_m=np.concatenate(collected.root_positions_m),
        reference_poses=references,
    )


def _drop_duplicates(database: Database, cull_deg: float) -> Database:
    """Return the database without near-duplicates."""
    poses = database.poses.reshape(database.frames, -1)
    culled = near_duplicates(poses, database.clips, database.fps, cull_deg)
    return replace(
        database,
        clips=tuple(clips_after_culling(database.clips, culled, database.fps)),
        poses=database.poses[~culled],
        root_rotations=database.root_rotations[~culled],
        root_positions_m=database.root_positions_m[~culled],
        culled_frames=int(culled.sum()),
    )


def _report(database: Database, collected: _Collected, started: float) -> dict[str, Any]:
    memory_mb, reader_memory_mb = _peak_memory_mb()
    return {
        "frames": database.frames,
        "clips": len(database.clips),
        "fps": database.fps,
        "seconds": round(time.monotonic() - started, 2),
        "bytes": database.path.stat().st_size,
        "behaviours": database.behaviours,
        "mirrored_clips": sum(clip.mirrored for clip in database.clips),
        "culled_frames": database.culled_frames,
        "zeros": reference_pose_report(database),
        "peak_memory_mb": memory_mb,
        "peak_reader_memory_mb": reader_memory_mb,
        "skipped": collected.skipped,
        "defects": sorted(collected.defects, key=lambda row: row["done"] == "kept"),
    }


@contextmanager
def _folder_beside(out: Path) -> Iterator[Path]:
    """Yield a temporary folder on the same disk as the database."""
    place = next(folder for folder in out.absolute().parents if folder.exists())
    with writing(out):
        remove_left_behind(place, f".{out.stem}.")
        folder = tempfile.TemporaryDirectory(prefix=f".{out.stem}.", dir=place)
    with folder as name:
        yield Path(name)


def _read(files: Sequence[MotionFile], collected: _Collected, settings: BuildSettings, step: Progress) -> None:
    workers = settings.workers
    if workers is None:  # reading 8 MiB takes as long as starting the processes
        enough = sum(file.path.stat().st_size for file in files) > 8 << 20
        workers = (os.cpu_count() or 1) if enough else 1
    with closing(read_files(files, settings.fps, workers)) as results:
        for done, file in enumerate(files):
            step(_READ * done / len(files), f"reading {file.name}")
            result = next(results)
            if result.reason:
                collected.skipped.append({"file": file.name, "line": result.line or None, "reason": result.reason})
            collected.defects += [{"file": file.name} | row for row in result.defects]
            for clip in result.clips:
                collected.add(clip, file)


def _nothing_usable(sources: Sequence[Path | str], collected: _Collected) -> DatabaseError:
    left_out = [(row["file"], row["defect"]) for row in collected.defects if row["done"] == "left out"]
    places = [f"{row['file']}, line {row['line']}" if row["line"] else row["file"] for row in collected.skipped]
    rows = [(place, row["reason"]) for place, row in zip(places, collected.skipped, strict=True)] + left_out
    reasons = "; ".join(f"{file}: {reason}" for file, reason in rows[:3])
    return DatabaseError(
        f"found no usable motion ({reasons or 'no .bvh or .amc files'})",
        where=", ".join(str(source) for source in sources),
        advice="give folders with BVH or ASF/AMC files",
    )


def _peak_memory_mb() -> tuple[float | None, float | None]:
    """Return the peak memory, MB, of this process and of its largest child process."""
    try:
        import resource
    except ImportError:  # Windows
        return None, None
    unit = 1.0 if os.uname().sysname == "Darwin" else 1024.0  # bytes per unit of ru_maxrss
    own, children = (resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return round(own * unit / 1e6, 1), round(children * unit / 1e6, 1)
