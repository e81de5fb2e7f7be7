"""Arrays in .npz files: each header is checked before any memory is taken.

NumPy's own reader evaluates headers and trusts the sizes that they declare. On a full disk its writer leaves a file
that closes itself some time later, with a traceback.
"""

import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError, PerfanimError
from ..system.files import SLACK_BYTES, atomic_path, open_foreign, reading

_MOST_MEMBERS = 200
_MOST_TIMES = 4  # the arrays' bytes by the file's
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
        PerfanimError: of `kind`, with `what`: it is none, damaged, or declares far more than it holds.
    """
    with open_foreign(path, kind) as file, reading(path, kind, what=what):
        most = _MOST_TIMES * file.seek(0, 2) + SLACK_BYTES
        with zipfile.ZipFile(file) as archive:
            members = archive.infolist()
            if len(members) > _MOST_MEMBERS or sum(member.file_size for member in members) > most:
                raise kind("declares far more than it holds", where=str(path), advice="export it again")
            if any(member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for member in members):
                raise ValueError("packed in an unknown way")
            return {member.filename.removesuffix(".npy"): _array(archive.read(member)) for member in members}


def write_arrays(path: Path | str, arrays: Mapping[str, Any], packed: bool = True) -> None:
    """Write arrays by name; the same ones give the same bytes.

    Raises:
        FormatError: the file cannot be written.
    """
    with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, array in arrays.items():
            member = zipfile.ZipInfo(f"{name}.npy")
            member.compress_type = zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED
            with archive.open(member, "w", force_zip64=True) as stream:
                np.save(stream, array, allow_pickle=False)


def _array(data: bytes) -> NDArray[Any]:
    header = _HEADER.match(data)
    if header is None:
        raise ValueError("an array of an unknown type")
    dtype, shape = np.dtype(header[1].decode()), tuple(int(size) for size in header[3].split(b",") if size.strip())
    # `reshape` refuses a shape that does not fit the bytes
    flat = np.frombuffer(data, dtype, offset=header.end()).copy()
    return flat.reshape(shape, order="F" if header[2] == b"True" else "C")
