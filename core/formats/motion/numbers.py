"""Blocks of numbers in text files."""

import warnings

import numpy as np

from ...errors import FormatError
from ...geometry.arrays import Array
from ...system.files import SLACK_BYTES

_POSE_BYTES = 32  # of a joint in a frame
_MOST_TIMES = 4  # the poses' bytes by the file's


def parse_numbers(text: bytes) -> Array | None:
    """Return all numbers of a text, or None when it holds anything else."""
    with warnings.catch_warnings():
        # numpy 1 warns about what it cannot read, numpy 2 raises
        warnings.simplefilter("error", DeprecationWarning)
        try:
            return np.fromstring(text, dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            return None


def check_pose_bytes(frames: int, joints: int, file_bytes: int, where: str) -> None:
    """Raise FormatError if joints without numbers make poses huge by the file."""
    if frames * joints * _POSE_BYTES > _MOST_TIMES * file_bytes + SLACK_BYTES:
        raise FormatError(
            f"has {frames} frames of {joints} joints, far more than its bytes", where=where,
            advice="leave out the joints without numbers, or cut it into parts",
        )  # fmt: skip
