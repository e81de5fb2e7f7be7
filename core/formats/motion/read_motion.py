"""Reading motion files in any supported format, as motion of the standard skeleton."""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from ...body.motion import Motion
from ...body.motion_cleaning import Defect
from ...body.posture import turned_upright
from ...body.skeleton import Skeleton
from ...body.source_motion import frame_range, source_of_motion
from ...body.standard_skeleton import JOINT_NAMES
from ...errors import FormatError
from ...geometry import rotations as rot
from ...geometry.arrays import Mask, runs
from ...retarget.to_standard_skeleton import to_standard_skeleton
from ...system.files import is_file, is_folder, read_bytes
from .amc import CMU_FPS, amc_motion, parse_amc_values
from .asf import AsfFile, read_asf
from .bvh import read_bvh
from .motion_sources import SkeletonNames, is_archive

_NOT_FINITE = "numbers that are not finite"
_UPSIDE_DOWN = Defect("the body is upside down in all frames", 0, 0, "turned over")


def read_motion(path: Path | str, skeleton: Path | str | None = None) -> Motion:
    """Return the motion of a BVH or AMC file on the standard skeleton.

    Args:
        skeleton: ASF file for an AMC file; by default one next to it with a matching name.

    Raises:
        FormatError: The file is unreadable or of the wrong kind, or holds numbers that are not finite.
        SkeletonError: The file's joints cannot be recognised.
    """
    read = read_motion_parts(Path(path), None if skeleton is None else Path(skeleton))
    gaps = [defect for defect in read.defects if defect.kind == _NOT_FINITE]
    if gaps:
        raise FormatError(
            f"has numbers that are not finite, first in frame {gaps[0].first}",
            where=str(path),
            advice="repair the file, or cut these frames out",
        )
    notes = tuple(f"{Path(path).name} {defect.kind}" for defect in read.defects)
    return replace(read.parts[0].motion, notes=notes)


@dataclass(frozen=True)
class MotionPart:
    """Consecutive frames of a file.

    Args:
        motion: Motion on the standard skeleton with the file's bone lengths.
        first_frame: First frame in the file, counted from 0.
        angle_jumps: Frames (F,) with an angle in the file that is far from that of the previous frame.
    """

    motion: Motion
    first_frame: int
    angle_jumps: Mask


@dataclass(frozen=True)
class MotionParts:
    """Motion of a file, and the defects that were tolerated or cut out."""

    parts: tuple[MotionPart, ...]
    defects: tuple[Defect, ...]


def read_motion_parts(path: Path, skeleton: Path | None = None, name: str = "") -> MotionParts:
    """Return the motion of a file in parts without gaps, with y up; other errors are those of `read_motion`."""
    read = _read_parts(path, skeleton, name)
    turned = [turned_upright(part.motion) for part in read.parts]
    if not all(turned):  # all parts of a file share one world
        return read
    parts = tuple(
        replace(part, motion=motion) for part, motion in zip(read.parts, turned, strict=True) if motion is not None
    )
    return MotionParts(parts, (*read.defects, _UPSIDE_DOWN))


def _read_parts(path: Path, skeleton: Path | None, name: str) -> MotionParts:
    suffix = path.suffix.lower()
    if suffix == ".amc":
        return _read_amc(path, skeleton, name or path.stem)
    if is_archive(path.name):
        raise FormatError("is an archive inside an archive", where=str(path), advice="unpack it, and give its files")
    if suffix != ".bvh":
        raise FormatError("is not a motion file", where=str(path), advice="give a .bvh or .amc file")
    source = read_bvh(path, unit="auto")
    source = replace(source, name=name or source.name)
    defects = [Defect(note, 0, 0, "all frames present are used") for note in source.notes]
    ranges, gaps = _finite_ranges(source.finite_frames, str(path))
    parts = []
    for start, stop in ranges:
        part = source if stop - start == source.frames else frame_range(source, start, stop)
        parts.append(MotionPart(to_standard_skeleton(part), start, part.angle_jumps))
    return MotionParts(tuple(parts), (*defects, *gaps))


def _finite_ranges(finite: Mask, where: str) -> tuple[list[tuple[int, int]], list[Defect]]:
    """Return the ranges of frames with finite numbers only, and the gaps between them."""
    ranges = runs(finite)
    if not ranges:
        raise FormatError("has no frame with finite numbers only", where=where, advice="export it again")
    bounds = [0, *(bound for pair in ranges for bound in pair), len(finite)]
    gaps = [
        Defect(_NOT_FINITE, start + 1, stop, "cut out")
        for start, stop in zip(bounds[::2], bounds[1::2], strict=True)
        if start < stop
    ]
    return ranges, gaps


def _read_amc(path: Path, skeleton: Path | None, name: str) -> MotionParts:
    if skeleton is None:
        changed = path.parent.stat().st_mtime_ns if is_folder(path.parent) else 0
        found = _skeletons_beside(path.parent, changed).of(path.as_posix())
        if found is None:
            raise FormatError(
                "has no skeleton: no .asf file beside it matches", where=str(path), advice="put its .asf file beside it"
            )
        skeleton = Path(found)
    asf = _asf_file(skeleton, skeleton.stat().st_mtime_ns if is_file(skeleton) else 0)
    table = parse_amc_values(read_bytes(path), str(path), asf)
    ranges, gaps = _finite_ranges(np.all(np.isfinite(table.values), axis=1), str(path))
    jumps = table.angle_jumps
    parts = []
    for start, stop in ranges:
        motion = amc_motion(replace(table, values=table.values[start:stop]), asf, CMU_FPS, name)
        if motion.skeleton.names != JOINT_NAMES:
            motion = to_standard_skeleton(source_of_motion(motion, str(path)))
        parts.append(MotionPart(motion, start, jumps[start:stop]))
    return MotionParts(tuple(parts), tuple(gaps))


@lru_cache(maxsize=8)
def _skeletons_beside(folder: Path, changed: int) -> SkeletonNames:
    """Return the skeleton files of a folder, cached until its modification time changes."""
    return SkeletonNames(path.as_posix() for path in folder.glob("*") if path.suffix.lower() == ".asf")


@lru_cache(maxsize=8)
def _asf_file(path: Path, changed: int) -> AsfFile:
    """Return a skeleton file, cached until its modification time changes."""
    return read_asf(path)


def read_skeleton(path: Path | str) -> Skeleton:
    """Return the standard skeleton with the bone lengths of an ASF or BVH file; errors are those of `read_motion`."""
    if Path(path).suffix.lower() != ".asf":
        return read_motion(path).skeleton
    skeleton = read_asf(path).skeleton
    if skeleton.names == JOINT_NAMES:
        return skeleton
    still = Motion(Path(path).stem, 1.0, skeleton, rot.identity((1, len(skeleton))), np.zeros((1, 3)))
    return to_standard_skeleton(source_of_motion(still, str(path))).skeleton
