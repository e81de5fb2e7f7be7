"""Writing changed positions into marker files, leaving all other content as it was."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import FormatError
from ...geometry.arrays import Array, Mask
from ...markers.marker_take import MarkerTake
from ...system.files import atomic_path, read_bytes
from .c3d import Layout, layout_of
from .marker_files import check_ending, read_take, write_take
from .trc import is_rewritable, rewrite_trc


def rewrite_take(source: Path | str, take: MarkerTake, target: Path | str) -> list[str]:
    """Write a changed take; return notes about content that the new file lacks.

    In the file's own format everything else is kept byte for byte: analog samples, events, parameters, points without a
    name. New positions in a C3D file have no cameras and the residual 0, like interpolated points. TRC files with
    unusual separators, decimal commas or encodings are written from scratch.

    Args:
        take: Result of `read_take` with other positions.
        target: File to write; its extension determines the format.

    Raises:
        FormatError: The target cannot be written, or a position does not fit.
    """
    check_ending(target)
    kind = Path(source).suffix.lower()
    if Path(target).suffix.lower() != kind or kind not in (".c3d", ".trc"):
        write_take(take, target)
        return _lost(Path(source))
    data, before = read_bytes(source), read_take(source).positions_m
    if kind == ".trc" and not is_rewritable(data):
        write_take(take, target)
        return []
    changed = np.isfinite(take.positions_m).all(axis=-1) & ~(take.positions_m == before).all(axis=-1)
    if kind == ".c3d":
        content = _c3d(data, str(source), take.positions_m, changed, ~np.isfinite(before[..., 0]))
    else:
        content = rewrite_trc(data, str(source), take.positions_m, changed)
    with atomic_path(target) as temporary:
        temporary.write_bytes(content)
    return []


def _lost(source: Path) -> list[str]:
    """Return notes about content that only the file's own format can store."""
    if source.suffix.lower() == ".c3d":
        analog = layout_of(read_bytes(source), str(source)).analog_words > 0
        kept = ["analog samples"] * analog + ["events", "parameters", "residuals"]
        return [f"not written: {', '.join(kept)} of {source.name}; a .c3d keeps them"]
    if source.suffix.lower() == ".csv":
        return [f"not written: other columns of {source.name}"]
    return []


def _c3d(data: bytes, where: str, positions_m: Array, changed: Mask, new: Mask) -> bytes:
    """Return a C3D file's bytes with changed positions, with the `new` ones marked as interpolated."""
    layout = layout_of(data, where)
    result = bytearray(data)
    values = positions_m / layout.metres
    if layout.scale > 0.0:
        words = _words(result, layout, layout.order + "i2")
        values = np.rint(values / layout.scale)
        if np.any(np.abs(values[changed]) > 32767):
            advice = "write another format"
            raise FormatError("a position is too large for the file's integers", where=where, advice=advice)
    else:
        words = _words(result, layout, "<u4" if layout.is_dec else layout.order + "f4")
    stored = _to_dec(values) if layout.is_dec and layout.scale < 0.0 else values
    points = words[:, : 4 * layout.points].reshape(layout.frames, layout.points, 4)
    points[changed, :3] = stored[changed]
    points[changed & new, 3] = 0
    words[:, : 4 * layout.points] = points.reshape(layout.frames, -1)
    return bytes(result)


def _words(data: bytearray, layout: Layout, kind: str) -> NDArray[np.generic]:
    """Return a view (F, words per frame) of the frames in `data`."""
    count = layout.width * layout.frames
    return np.frombuffer(data, kind, count, layout.start).reshape(layout.frames, layout.width)


def _to_dec(values: Array) -> NDArray[np.uint32]:
    """Return numbers in the VAX F format as 32 bits, high half first."""
    bits = np.where(np.isfinite(values), 4.0 * values, 0.0).astype(np.float32).view(np.uint32)
    return (bits >> np.uint32(16)) | (bits << np.uint32(16))
