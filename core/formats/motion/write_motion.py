"""Writing motion files for other programs; the file's extension determines the format."""

from pathlib import Path

from ...body.motion import Motion, resampled
from ...errors import FormatError
from ...retarget.displayed_joint_names import OWN, rename_joints
from .angles_csv import write_angles_csv
from .bvh import write_bvh
from .vrma import write_vrma

BVH, ANGLES, VRMA = ".bvh", ".angles.csv", ".vrma"
MOTION_ENDINGS = (BVH, ANGLES, VRMA)


def is_motion(path: Path | str) -> bool:
    """Return whether a file name has the extension of a motion format."""
    return Path(path).name.lower().endswith(MOTION_ENDINGS)


def write_motion(
    motion: Motion, path: Path | str, units: str = "m", naming: str = OWN, rate: float | None = None
) -> Motion:
    """Write a motion of the standard skeleton; return it as written.

    Args:
        path: File with one of the extensions `MOTION_ENDINGS`.
        units: Unit of length in a BVH file, one of `bvh.UNITS`; the other formats use metres.
        naming: Key of `displayed_joint_names.NAMINGS`: joint names in BVH and CSV. VRM has its own names.
        rate: Frames per second; None for the motion's own rate.

    Raises:
        FormatError: The extension is unknown, or the file cannot be written.
        SettingsError: The naming is unknown.
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
        raise FormatError(
            "does not have the extension of a motion file",
            where=str(path),
            advice=f"use one of {', '.join(MOTION_ENDINGS)}",
        )
    return written
