"""Frames on disk while a database is built, so that memory does not grow."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import FloatArray
from ..system.files import writing

_CHUNK = 8192  # frames read at once


class FrameFile:
    """Float32 array (F, ...) that grows at its end and is read by slices of frames."""

    def __init__(self, path: Path, shape: tuple[int, ...]) -> None:
        self._path = path
        self._frame = shape
        self._count = int(np.prod(shape))
        self._frames = 0
        self._stream = path.open("wb")

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the whole array."""
        return (self._frames, *self._frame)

    def __len__(self) -> int:
        return self._frames

    def append(self, frames: NDArray[Any]) -> None:
        """Add frames (n, ...); FormatError when the disk is full."""
        with writing(self._path.parent.parent, "free some space"):
            self._stream.write(np.ascontiguousarray(frames, dtype=np.float32).data)
            self._stream.flush()
        self._frames += len(frames)

    def __getitem__(self, wanted: slice) -> FloatArray:
        """Read a slice with a positive step."""
        start, stop, step = wanted.indices(self._frames)
        parts = []
        rows = _CHUNK - _CHUNK % step or step
        for first in range(start, stop, rows):
            part = np.fromfile(
                self._path,
                dtype=np.float32,
                count=(min(first + rows, stop) - first) * self._count,
                offset=first * self._count * 4,
            )
            parts.append(part.reshape(-1, *self._frame)[::step])
        if len(parts) == 1:
            return np.asarray(parts[0])
        return np.concatenate(parts) if parts else np.empty((0, *self._frame), dtype=np.float32)

    def close(self) -> None:
        """Close the file; the owner of its folder removes it."""
        with suppress(OSError):  # on a full disk it tries once more to write
            self._stream.close()
