"""Frames on disk while a database is built."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.database.frame_file import FrameFile
from perfanim.core.errors import FormatError

FULL = Path("/dev/full")  # takes nothing, as a full disk


def test_frames_are_read_as_they_were_added(tmp_path: Path) -> None:
    frames = np.arange(60, dtype=np.float32).reshape(10, 3, 2)
    with closing(FrameFile(tmp_path / "frames", (3, 2))) as file:
        file.append(frames[:4])
        np.testing.assert_array_equal(file[:], frames[:4])
        file.append(frames[4:])
        assert len(file) == 10
        np.testing.assert_array_equal(file[1:10:3], frames[1:10:3])


@pytest.mark.skipif(not FULL.exists(), reason="a device of Linux")
@pytest.mark.parametrize("count", [1, 100_000])
def test_a_full_disk_is_one_error_also_when_the_file_is_closed(count: int) -> None:
    """Closing writes the rest of the buffer, and fails once more."""
    with (
        pytest.raises(FormatError, match=r"No space left on device.*free some space"),
        closing(FrameFile(FULL, (1,))) as file,
    ):
        file.append(np.zeros((count, 1)))
