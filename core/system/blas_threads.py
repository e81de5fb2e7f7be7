"""Number of threads used by NumPy's linear algebra."""

import ctypes
import os
from functools import cache
from pathlib import Path

import numpy as np

_CHOICES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")  # environment variables of OpenBLAS, read when it is loaded
_FOLDERS = ("{}.libs", "{}/.dylibs")  # library folders of wheels: Linux and Windows; macOS
# before and after the names of OpenBLAS's functions in wheels
_PREFIXES, _SUFFIXES = ("scipy_openblas", "openblas"), ("64_", "")


@cache
def use_one_blas_thread() -> int:
    """Let OpenBLAS use one thread in this process, unless the environment sets another number.

    The solver's matrices are small, so threads cost more than they gain, especially next to other processes.

    Returns:
        Number of libraries changed: 0 if the user has set a number, or if NumPy does not use OpenBLAS.
    """
    if any(name in os.environ for name in _CHOICES):
        return 0
    setters = [blas_function(path, "set_num_threads") for path in bundled_blas()]
    for setter in setters:
        if setter is not None:
            setter(1)
    return sum(setter is not None for setter in setters)


def bundled_blas() -> list[Path]:
    """Return the OpenBLAS libraries that come with NumPy."""
    package = Path(np.__path__[0])
    folders = [package.parent / name.format(package.name) for name in _FOLDERS]
    return sorted({path for folder in folders for path in folder.glob("*openblas*")})


def blas_function(path: Path, name: str) -> "ctypes._NamedFuncPointer | None":
    """Return a function of an OpenBLAS library; None if it cannot be found."""
    try:
        library = ctypes.CDLL(str(path))  # returns the library that is already loaded
    except OSError:
        return None
    names = (f"{prefix}_{name}{suffix}" for prefix in _PREFIXES for suffix in _SUFFIXES)
    return next((library[each] for each in names if hasattr(library, each)), None)
