"""Reading and writing of arrays in .npz files; declared sizes are checked before memory is allocated.

NumPy's reader trusts declared sizes, and its writer leaves a broken file behind when the disk is full.
"""

import re
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError, PerfanimError
from ..system.file_content import check_kind
from ..system.files import atomic_path, is_over_budget, open_foreign, read_bytes, reading

_ENTRY = b"PK\x01\x02"  # signature of each member in the directory of a zip archive
_HEADER = re.compile(
    rb"\x93NUMPY(?:\x01\x00..|[\x02\x03]\x00....)\{'descr': '([<>|][biufU?]\d{1,6})', 'fortran_order': (False|True), "
    rb"'shape': \(((?:\d{1,15}, ?)*\d{0,15})\), \} *\n",
    re.DOTALL,
)


def read_arrays(
    path: Path | str, kind: type[PerfanimError] = FormatError, what: str = "is damaged"
) -> dict[str, NDArray[Any]]:
    """Return the arrays of a .npz file by name.

    Raises:
        PerfanimError: Of the class `kind`: the file is not an .npz file, is damaged, or declares far more than it
            contains.
    """
    with open_foreign(path, kind) as file, reading(path, kind, what=what):
        check_kind(file.read(4096), str(path), "NumPy file", kind, "archive (zip)")
        size = file.seek(0, 2)
        excess = kind("declares far more data than it holds", where=str(path), advice="export it again")

        def check_count(members: int) -> None:
            if members > 200:
                raise excess

        with open_zip(file, check_count) as archive:
            members = archive.infolist()
            if is_over_budget(sum(member.file_size for member in members), size):
                raise excess
            if any(member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for member in members):
                raise ValueError("compressed by an unknown method")
            return {member.filename.removesuffix(".npy"): _array(archive.read(member)) for member in members}


def read_array(path: Path | str) -> NDArray[Any]:
    """Return the array of a .npy file; FormatError if it is not one, or is damaged."""
    where = str(path)
    data = read_bytes(path)
    check_kind(data[:4096], where, "NumPy array")
    with reading(where, FormatError, what="is damaged"):
        return _array(data)


def open_zip(file: BinaryIO, check_count: Callable[[int], None]) -> zipfile.ZipFile:
    """Open a zip archive, counting its members before Python allocates memory for each.

    Args:
        check_count: Called with the number of members so far; raises its own error for too many.
    """
    counted = _CountedList(file, check_count)
    archive = zipfile.ZipFile(cast(BinaryIO, counted))
    counted.is_listed = True
    return archive


class _CountedList:
    """File that counts an archive's members while zipfile reads their directory; the number declared may be wrong."""

    def __init__(self, file: BinaryIO, check_count: Callable[[int], None]) -> None:
        self.is_listed = False
        self._file = file
        self._check_count = check_count

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def read(self, size: int = -1) -> bytes:
        """Read from the file; zipfile passes a size only when it reads the directory."""
        if size > 0 and not self.is_listed:
            self._count(size)
        return self._file.read(size)

    def _count(self, size: int) -> None:
        start, count, rest = self._file.tell(), 0, b""
        while size > 0 and (piece := self._file.read(min(size, 1 << 16))):
            size -= len(piece)
            count += (rest + piece).count(_ENTRY)
            self._check_count(count)
            rest = (rest + piece)[1 - len(_ENTRY) :]
        self._file.seek(start)


def write_arrays(path: Path | str, arrays: Mapping[str, Any], packed: bool = True) -> None:
    """Write arrays to an .npz file by name; equal arrays give identical bytes."""
    with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, array in arrays.items():
            member = zipfile.ZipInfo(f"{name}.npy")
            member.compress_type = zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED
            with archive.open(member, "w", force_zip64=True) as stream:
                np.save(stream, array, allow_pickle=False)


def _array(data: bytes) -> NDArray[Any]:
    header = _HEADER.match(data)
    if header is None:
        raise ValueError("an array of unknown type")
    dtype, shape = np.dtype(header[1].decode()), tuple(int(size) for size in header[3].split(b",") if size.strip())
    # `reshape` refuses a shape that does not fit the bytes
    flat = np.frombuffer(data, dtype, offset=header.end()).copy()
    return flat.reshape(shape, order="F" if header[2] == b"True" else "C")
