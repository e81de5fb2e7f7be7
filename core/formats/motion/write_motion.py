"""A motion as a file for other programs; the file name's ending chooses the kind."""

from pathlib import Path

from ...body.motion import Motion, resampled
from ...errors import FormatError
from ...retarget.joint_naming import OWN, rename_joints
from .angles_csv import write_angles_csv
from .bvh import write_bvh
from .vrma import write_vrma

BVH, ANGLES, VRMA = ".bvh", ".angles.csv", ".vrma"
MOTION_ENDINGS = (BVH, ANGLES, VRMA)


def is_motion(path: Path | str) -> bool:
    """Return whether a file name is that of a motion that can be written."""
    return Path(path).name.lower().endswith(MOTION_ENDINGS)


def write_motion(
    motion: Motion, path: Path | str, units: str = "m", naming: str = OWN, rate: float | None = None
) -> Motion:
    """Write a motion of the standard skeleton; return it as written.

    Args:
        path: ends in one of `MOTION_ENDINGS`.
        units: of the lengths in a BVH file; the others are in metres.
        naming: of `formats.naming.NAMINGS`, what joints are called in BVH and CSV; VRM animations have their own names.
        rate: frames per second, None for the motion's own.

    Raises:
        FormatError: another ending, or the file cannot be written. SettingsError: there is no such naming.
    """
    name = Path(path).name.lower()
    written = motion if rate is None else resampled(motion, rate)
    if name.endswith(BVH):
        write_bvh(rename_joints(written, naming), path, units)
    elif name.endswith(ANGLES):
        write_angles_csv(rename_joints(written, naming), path)
    elif name.endswith(VRMA):
        write_vrma(written, path)
    else:
        raise FormatError("is no motion file", where=str(path), advice=f"use {', '.join(MOTION_ENDINGS)}")
    return written
