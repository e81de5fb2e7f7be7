"""Disk storage for frames while a database is built, so that memory use does not grow."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import FloatArray
from ..system.files import writing


class FrameFile:
    """Float32 array (F, ...) on disk; frames are appended to it and read in slices."""

    def __init__(self, path: Path, shape: tuple[int, ...]) -> None:
        self._path = path
        self._shape = shape
        self._size = int(np.prod(shape))
        self._frames = 0
        self._stream = path.open("wb")

    def __len__(self) -> int:
        return self._frames

    def append(self, frames: NDArray[Any]) -> None:
        """Add frames (n, ...); FormatError if the disk is full."""
        with writing(self._path.parent.parent, "free some space"):
            self._stream.write(np.ascontiguousarray(frames, dtype=np.float32).data)
            self._stream.flush()
        self._frames += len(frames)

    def __getitem__(self, wanted: slice) -> FloatArray:
        """Read a slice with a positive step, in pieces of about 8192 frames."""
        start, stop, step = wanted.indices(self._frames)
        parts = [np.empty((0, *self._shape), dtype=np.float32)]
        piece = -(-8192 // step) * step
        for first in range(start, stop, piece):
            count = min(piece, stop - first) * self._size
            part = np.fromfile(self._path, dtype=np.float32, count=count, offset=first * self._size * 4)
            parts.append(part.reshape(-1, *self._shape)[::step])
        return np.concatenate(parts) if len(parts) > 2 else parts[-1]

    def close(self) -> None:
        """Close the file; the owner of its folder removes it."""
        with suppress(OSError):  # on a full disk, closing tries to write once more
            self._stream.close()
