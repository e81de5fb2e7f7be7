"""Numbers in motion files: parsing them, and finding jumps in angles."""

import io
import warnings
from contextlib import suppress

import numpy as np

from ...errors import FormatError, counted
from ...geometry.arrays import Array, Mask
from ...system.files import is_over_budget

_POSE_BYTES = 32  # bytes of one joint's rotation in memory


def parse_numbers(text: bytes) -> Array | None:
    """Return all numbers (N,) in a text, or None if it contains anything else."""
    table = parse_table(text)
    return None if table is None else table.ravel()


def parse_table(text: bytes) -> Array | None:
    """Return all numbers in a text, or None if it contains anything else.

    The result has the shape (lines, N) if all lines have the same number of values, else (N,).
    """
    if not text or text.isspace():
        return np.empty(0)
    with suppress(ValueError):  # fails if lines differ in length; `fromstring` does not, but takes a quarter longer
        return np.loadtxt(io.BytesIO(text), comments=None, ndmin=2)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # numpy 1 warns about other text, numpy 2 raises
        try:
            return np.fromstring(text, dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            return None


def angle_jumps(angles_deg: Array, least_deg: float = 150.0) -> Mask:
    """Return a mask (F,) of frames with an angle far from that of the previous frame.

    Args:
        angles_deg: Rotation channels (F, N).
        least_deg: Smallest jump; Euler angles of the same rotation differ by 180 or 360 degrees.
    """
    steps = np.abs(np.diff(angles_deg, axis=0))
    return np.concatenate(([False], np.any(steps > least_deg, axis=1)))


def check_pose_bytes(frames: int, joints: int, file_bytes: int, where: str) -> None:
    """Raise FormatError if joints without channels would make the poses far larger than the file."""
    if is_over_budget(frames * joints * _POSE_BYTES, file_bytes):
        raise FormatError(
            f"has {counted(frames, 'frame')} of {counted(joints, 'joint')}, far more than its size allows", where=where,
            advice="remove the joints without channels, or split the file",
        )  # fmt: skip
