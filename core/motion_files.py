"""Motion files of any supported format, brought onto the product's joints."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from .errors import FormatError
from .formats.amc import read_amc
from .formats.archive import skeleton_name
from .formats.asf import read_asf
from .formats.bvh import read_bvh
from .formats.source_motion import SourceMotion, frame_range, source_of_motion
from .mapping import map_motion
from .motion import Motion
from .product_skeleton import JOINT_NAMES
from .skeleton import Skeleton


def read_motion(path: Path | str, skeleton: Path | str | None = None) -> Motion:
    """Return the motion of a BVH or AMC file on the product's joints with the file's bone lengths.

    Args:
        path: .bvh or .amc file.
        skeleton: ASF file of an AMC file; without it, one beside it with a fitting name is taken.

    Raises:
        FormatError: unreadable, of another kind, or frames lack numbers.
        SkeletonError: its joints cannot be told.
    """
    parts, notes = read_motion_parts(Path(path), None if skeleton is None else Path(skeleton))
    gaps = [note for note in notes if "not finite" in note]
    if gaps:
        raise FormatError(gaps[0], where=str(path), advice="repair the file, or cut these frames out")
    return parts[0]


def read_motion_parts(path: Path, skeleton: Path | None = None, name: str = "") -> tuple[list[Motion], list[str]]:
    """Return the motion of a file in unbroken parts, and notes on what was left out or tolerated.

    Raises:
        FormatError, SkeletonError: as `read_motion`, but frames that lack numbers only split the motion.
    """
    suffix = path.suffix.lower()
    if suffix == ".amc":
        return [_read_amc(path, skeleton, name or path.stem)], []
    if suffix != ".bvh":
        raise FormatError("is not a motion file", where=str(path), advice="give a .bvh or .amc file")
    source = read_bvh(path, unit="auto")
    source = replace(source, name=name or source.name)
    notes = list(source.notes)
    finite = source.finite_frames
    if np.all(finite):
        return [map_motion(source)], notes
    if not np.any(finite):
        raise FormatError("has no frame whose numbers are all finite", where=str(path))
    bad = np.flatnonzero(~finite)
    notes.append(f"{len(bad)} frames with numbers that are not finite left out, the first is frame {bad[0]}")
    return [map_motion(part) for part in _finite_parts(source)], notes


def _finite_parts(source: SourceMotion) -> list[SourceMotion]:
    finite = np.concatenate(([False], source.finite_frames, [False]))
    edges = np.flatnonzero(finite[1:] != finite[:-1])
    parts = []
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        parts.append(frame_range(source, start, stop, f"{source.name} from {start}"))
    return parts


def _read_amc(path: Path, skeleton: Path | None, name: str) -> Motion:
    if skeleton is None:
        beside = [str(p) for p in path.parent.glob("*") if p.suffix.lower() == ".asf"]
        found = skeleton_name(str(path), beside)
        if found is None:
            raise FormatError(
                "has no skeleton: no .asf file beside it fits", where=str(path), advice="give --skeleton FILE.asf"
            )
        skeleton = Path(found)
    motion = replace(read_amc(path, skeleton), name=name)
    if motion.skeleton.names == JOINT_NAMES:
        return motion
    return map_motion(source_of_motion(motion, str(path)))


def read_skeleton(path: Path | str) -> Skeleton:
    """Return the product's joints with the bone lengths of an ASF or BVH file.

    Raises:
        FormatError, SkeletonError: as `read_motion`.
    """
    if Path(path).suffix.lower() != ".asf":
        return read_motion(path).skeleton
    skeleton = read_asf(path)
    if skeleton.names == JOINT_NAMES:
        return skeleton
    rest = np.zeros((1, len(skeleton), 4))
    rest[..., 0] = 1.0
    still = Motion(Path(path).stem, 1.0, skeleton, rest, np.zeros((1, 3)))
    return map_motion(source_of_motion(still, str(path))).skeleton
