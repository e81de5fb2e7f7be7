"""Reader for C3D marker takes from all processor types, with integer or real storage.

Format (c3d.org): a 512-byte header block, parameter blocks with groups and parameters, then frames of four words per
point (x, y, z, residual with camera mask) and analog samples, which are ignored.
"""

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import FormatError
from ...geometry.arrays import Array
from ...markers.marker_take import MarkerTake
from ...system.file_content import check_kind
from ...system.files import read_bytes, reading
from .reader_parts import make_take, metres_of

_BLOCK = 512
_KEY = 0x50
_INTEL, _DEC, _MIPS = 84, 85, 86

Parameters = dict[tuple[str, str], list[Any]]  # values by group and name


@dataclass(frozen=True)
class Layout:
    """Storage layout of the frames.

    Args:
        points: Points per frame, of four words each.
        analog_words: Words per frame after the points.
        frames: Frames that are stored completely.
        scale: Scale factor of integers; negative if the words are real numbers.
        start: First byte of the frames.
        order: Byte order for struct and NumPy.
        is_dec: Real numbers are in the VAX format.
        metres: Metres per length unit of the file.
    """

    points: int
    analog_words: int
    frames: int
    first_frame: int
    scale: float
    start: int
    fps: float
    order: str
    is_dec: bool
    metres: float

    @property
    def width(self) -> int:
        """Words per frame."""
        return 4 * self.points + self.analog_words


def read_c3d(path: Path | str) -> MarkerTake:
    """Return the take of a C3D file in metres; a negative residual means missing.

    Points without a label are called "unnamed". If the header declares more frames than are stored, the complete ones
    are read.

    Raises:
        FormatError: The file is not C3D, is damaged, or has no points.
    """
    with reading(path):
        return _C3dParser(read_bytes(path), str(path)).read()


def layout_of(data: bytes, where: str) -> Layout:
    """Return the storage of the frames in a C3D file; errors are those of `read_c3d`."""
    with reading(where):
        reader = _C3dParser(data, where)
        return reader.layout(reader.parameters())


class _C3dParser:
    def __init__(self, data: bytes, where: str) -> None:
        check_kind(data, where, "C3D file")
        if len(data) < 2 * _BLOCK or data[1] != _KEY:
            is_cut = data[1:2] == bytes([_KEY])
            what = "is cut off within its header" if is_cut else "is not a C3D file"
            raise FormatError(what if data else "is empty", where=where, advice="export it again")
        self.data = data
        self.where = where
        self.parameter_start = (data[0] - 1) * _BLOCK
        start = self.parameter_start
        self.processor = data[start + 3] if 0 <= start < len(data) - 4 else 0
        if self.processor not in (_INTEL, _DEC, _MIPS):
            raise FormatError("has no readable parameter section", where=where, advice="export it again")
        self.order = ">" if self.processor == _MIPS else "<"

    def read(self) -> MarkerTake:
        parameters = self.parameters()
        layout = self.layout(parameters)
        words = self._frames(layout)
        points = words[:, : 4 * layout.points].reshape(layout.frames, layout.points, 4)
        positions = points[..., :3] * layout.metres
        if layout.scale > 0.0:
            positions = positions * layout.scale
        # the fourth word has the camera mask in its high byte, the residual in the low one; -1 is a missing point
        positions = np.where(points[..., 3:] < 0.0, np.nan, positions)
        numbers = layout.first_frame + np.arange(layout.frames, dtype=np.float64)
        times = (numbers - layout.first_frame) / layout.fps
        names = self._names(parameters, layout.points)
        declared = self._declared(parameters)
        return make_take(self.where, layout.fps, names, positions, numbers, times, declared)

    def _declared(self, parameters: Parameters) -> int:
        """Return the declared frame count, which is stored in parameters if it does not fit the header."""
        frames = max(self._word(5) - self._word(4) + 1, 0)
        if frames < 0xFFFF:
            return frames
        first, last = (_long(parameters, ("TRIAL", f"ACTUAL_{end}_FIELD")) for end in ("START", "END"))
        return (last - first + 1 if last >= first > 0 else 0) or _long(parameters, ("POINT", "LONG_FRAMES"))

    def _names(self, parameters: Parameters, count: int) -> list[str]:
        labels: list[str] = []
        for suffix in ("", "2", "3", "4"):  # a parameter holds at most 255 labels
            labels += [str(label) for label in parameters.get(("POINT", "LABELS" + suffix), [])]
        return [*labels[:count], *["unnamed"] * (count - len(labels))]

    def _real(self, raw: bytes) -> float:
        if self.processor == _DEC:
            return float(_from_dec(np.frombuffer(raw, dtype="<u2"))[0])
        value: float = struct.unpack(self.order + "f", raw)[0]
        return value

    def _word(self, index: int) -> int:
        """Return a 16-bit word of the header, counted from 1."""
        value: int = struct.unpack_from(self.order + "H", self.data, 2 * (index - 1))[0]
        return value

    def layout(self, parameters: Parameters) -> Layout:
        points = int(_point(parameters, "USED", self._word(2))) & 0xFFFF
        if points == 0:
            raise FormatError("has no points", where=self.where, advice="export it with markers")
        scale = self._real(self.data[12:16])  # takes precedence over the parameter SCALE
        if not np.isfinite(scale) or scale == 0.0:
            scale = float(_point(parameters, "SCALE", -1.0))
        fps = float(_point(parameters, "RATE", 0.0))
        if not (np.isfinite(fps) and fps > 0.0):
            fps = self._real(self.data[20:24])
        if not (np.isfinite(fps) and fps > 0.0):
            raise FormatError("states no frame rate", where=self.where, advice="export it with the frame rate")
        block = int(_point(parameters, "DATA_START", 0)) & 0xFFFF or self._word(9)
        if not 0 < (block - 1) * _BLOCK < len(self.data):
            block = self._word(9)
        start = (block - 1) * _BLOCK
        analog = self._word(3)
        size = (4 * points + analog) * (4 if scale < 0.0 else 2)
        frames = self._frame_count(parameters, max(len(self.data) - start, 0) // size)
        if start <= 0 or frames == 0:
            raise FormatError("stores no frames", where=self.where, advice="export it again")
        unit = str(_point(parameters, "UNITS", "mm") or "mm")
        metres = metres_of(unit, self.where)
        is_dec = self.processor == _DEC
        return Layout(points, analog, frames, self._word(4), scale, start, fps, self.order, is_dec, metres)

    def _frame_count(self, parameters: Parameters, stored: int) -> int:
        declared = max(self._word(5) - self._word(4) + 1, 0)
        long_count = int(_point(parameters, "FRAMES", 0)) & 0xFFFF
        # 65535 means that the count does not fit; the file's size then decides
        if max(declared, long_count) >= 0xFFFF or declared == 0:
            return stored
        return min(declared, stored)

    def _frames(self, layout: Layout) -> Array:
        width = layout.width
        count = width * layout.frames
        if layout.scale > 0.0:
            return np.frombuffer(self.data, self.order + "i2", count, layout.start).reshape(-1, width).astype(float)
        if self.processor == _DEC:
            raw = np.frombuffer(self.data, "<u2", 2 * count, layout.start)
            return _from_dec(raw).reshape(-1, width)
        reals = np.frombuffer(self.data, self.order + "f4", count, layout.start)
        with np.errstate(invalid="ignore"):  # damaged files contain signalling NaNs
            return reals.reshape(-1, width).astype(np.float64)

    def parameters(self) -> Parameters:
        groups: dict[int, str] = {}
        found: list[tuple[int, str, list[Any]]] = []
        at = self.parameter_start + 4
        while at + 4 <= len(self.data):
            length, group = struct.unpack_from("bb", self.data, at)
            length = abs(length)  # a negative length marks a locked item
            if length == 0 or group == 0:
                break
            name = self.data[at + 2 : at + 2 + length].decode("latin-1").strip().upper()
            link = at + 2 + length
            offset = struct.unpack_from(self.order + "h", self.data, link)[0]
            if group < 0:
                groups[-group] = name
            else:
                found.append((group, name, self._values(link + 2)))
            if offset <= 0:
                break
            at = link + offset
        return {(groups.get(group, ""), name): values for group, name, values in found}

    def _values(self, at: int) -> list[Any]:
        kind, dimensions = struct.unpack_from("bB", self.data, at)
        shape = list(self.data[at + 2 : at + 2 + dimensions])
        at += 2 + dimensions
        count = math.prod(shape)
        raw = self.data[at : at + count * abs(kind)]
        if len(raw) < count * abs(kind) or kind not in (-1, 1, 2, 4):
            return []
        if kind == -1:
            width = shape[0] if shape else 1
            texts = (raw[i : i + width] for i in range(0, len(raw), width)) if width else iter(())
            return [text.decode("utf-8", errors="replace").strip(" \x00") for text in texts]
        if kind == 4:
            return [self._real(raw[i : i + 4]) for i in range(0, len(raw), 4)]
        return [int(value) for value in np.frombuffer(raw, self.order + ("i1" if kind == 1 else "i2"))]


def _point(parameters: Parameters, name: str, default: Any) -> Any:
    """Return the first value of a parameter of the group POINT."""
    return next(iter(parameters.get(("POINT", name), ())), default)


def _long(parameters: Parameters, name: tuple[str, str]) -> int:
    """Return a parameter stored as two 16-bit words, low word first, or as one real number; 0 if it is missing."""
    values = parameters.get(name, [])
    if len(values) == 2 and all(isinstance(value, int) for value in values):
        return (values[0] & 0xFFFF) | (values[1] & 0xFFFF) << 16
    is_number = len(values) == 1 and not isinstance(values[0], str)
    return int(values[0]) if is_number and 0 < values[0] < 1e9 else 0


def _from_dec(words: NDArray[np.uint16]) -> Array:
    """Return the values of VAX F-floating numbers, two 16-bit words each."""
    pairs = words.reshape(-1, 2).astype(np.uint32)
    bits = (pairs[:, 0] << np.uint32(16)) | pairs[:, 1]
    # the same bits read as IEEE have an exponent that is too large by two
    values = bits.astype(np.uint32).view(np.float32).astype(np.float64) / 4.0
    return np.where((bits >> np.uint32(23)) & np.uint32(0xFF) == 0, 0.0, values)
