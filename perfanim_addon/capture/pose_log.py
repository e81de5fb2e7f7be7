"""Log of a capture's poses, kept mostly on disk."""

import tempfile
from array import array
from collections.abc import Sequence
from typing import IO, Any

from ...core.body.scene_pose import ScenePose
from ...core.formats.take_file.pose_codec import unpack_solved
from .tuning import TUNING


class PoseLog(Sequence[ScenePose]):
    """Poses of a capture, written to disk `in_memory` at a time; if the disk is full, they stay in memory."""

    def __init__(self, in_memory: int = TUNING.poses_in_memory) -> None:
        self._in_memory = in_memory
        self._file: IO[bytes] | None = None
        self._ends = array("q", [0])  # offsets in the file
        self._recent: list[bytes] = []  # not yet in the file
        self._newest: ScenePose | None = None

    def append(self, record: bytes, pose: ScenePose) -> None:
        """Add a pose and its record, made by `pack_solved`."""
        self._recent.append(record)
        self._newest = pose
        if len(self._recent) % self._in_memory == 0:
            self._write(b"".join(self._recent))

    def _write(self, data: bytes) -> None:
        try:
            self._file = self._file or tempfile.TemporaryFile(buffering=0)  # noqa: SIM115 - open as long as the log
            self._file.seek(self._ends[-1])
            if self._file.write(data) < len(data):
                return
        except OSError:
            return
        for record in self._recent:
            self._ends.append(self._ends[-1] + len(record))
        self._recent = []

    def __len__(self) -> int:
        return len(self._ends) - 1 + len(self._recent)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[row] for row in range(*index.indices(len(self)))]
        row, written = range(len(self))[index], len(self._ends) - 1
        if row == len(self) - 1:
            return self._newest
        if self._file is None or row >= written:
            return unpack_solved(self._recent[row - written]).pose
        self._file.seek(self._ends[row])
        return unpack_solved(self._file.read(self._ends[row + 1] - self._ends[row])).pose
