"""The kernel's library: where it is, which one is loaded, and whether it is used."""

import ctypes
import os
import platform
import struct
import sys
from collections.abc import Callable
from functools import update_wrapper
from pathlib import Path
from typing import Any, Generic, NamedTuple, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

VERSION = 6  # the same number stands in source/kernel.c
FOLDER = Path(__file__).parent / "libraries"
_CHOICE = "PERFANIM_KERNEL"  # environment variable: "off" for NumPy, or another folder of libraries
_SYSTEMS = {"linux": ("linux", "so"), "win32": ("windows", "dll"), "darwin": ("macos", "dylib")}
_MACHINES = {"x86_64": "x64", "amd64": "x64", "arm64": "arm64", "aarch64": "arm64"}

_VALUES: Any = ctypes.c_char * 0
_DOUBLE = struct.Struct("=d")

P = ParamSpec("P")
R = TypeVar("R")


class Loaded(NamedTuple):
    """The library, or None, and what `perfanim diagnose` tells about it."""

    library: ctypes.CDLL | None
    text: str
    suffix: str = ""  # of the names of the stages for this processor


def library_name(system: str, machine: str) -> str | None:
    """Return the file's name for a `sys.platform` and a `platform.machine`; None for one without a library."""
    known, suited = _SYSTEMS.get(system), _MACHINES.get(machine.lower())
    return f"perfanim_kernel-{known[0]}-{suited}.{known[1]}" if known and suited else None


def load(choice: str = "") -> Loaded:
    """Return the library for this computer if it is there, can be loaded and has this version.

    Args:
        choice: "off" for none, or another folder to find it in.
    """
    if choice == "off":
        return Loaded(None, f"not used, because {_CHOICE} is off")
    name = library_name(sys.platform, platform.machine())
    if name is None or not (path := (Path(choice) if choice else FOLDER) / name).is_file():
        return Loaded(None, f"not there for {sys.platform} on {platform.machine()}")
    try:
        library = ctypes.CDLL(str(path))
        version = library.pf_version()
    except (OSError, AttributeError) as error:
        return Loaded(None, f"cannot be loaded: {error}")
    if version != VERSION:
        return Loaded(None, f"not used, because it has version {version}, not {VERSION}")
    is_wide = bool(library.pf_is_wide())
    return Loaded(library, f"version {version}{', AVX2' if is_wide else ''}", "_avx2" if is_wide else "")


KERNEL = load(os.environ.get(_CHOICE, ""))


def function(name: str, arguments: str) -> Callable[..., Any]:
    """Return a function of the library for this processor; without a library, one that must not be called.

    Args:
        arguments: Kind of each argument: "p" for an address, "n" for a 64-bit integer, "f" and "d" for floats.
    """
    if KERNEL.library is None:
        return _missing
    found = KERNEL.library[f"pf_{name}{KERNEL.suffix}"]
    kinds: dict[str, Any] = {"p": ctypes.c_void_p, "n": ctypes.c_int64, "f": ctypes.c_float, "d": ctypes.c_double}
    found.argtypes = [kinds[kind] for kind in arguments]
    found.restype = ctypes.c_int64
    return found


def address(array: NDArray[Any]) -> Any:
    """Return where the values of a contiguous array lie, as an argument for a function of the library.

    `array.ctypes` and `array.__array_interface__` take 6 microseconds, a buffer 0.4, but only if it can be written to.

    Raises:
        ValueError: The array is not contiguous.
    """
    if array.flags.writeable:
        return _VALUES.from_buffer(array)
    if not array.flags.c_contiguous:
        raise ValueError("the kernel takes contiguous arrays")
    return array.ctypes.data


def contiguous(array: ArrayLike, kind: Any = np.float64) -> Any:
    """Return the address of an array, which is copied unless it is contiguous and of this type."""
    return address(np.ascontiguousarray(array, dtype=kind))


class Packed:
    """Values that a stage takes as one structure, see source/tables.h; it keeps their arrays alive.

    Args:
        values: The structure's fields in order: contiguous arrays, other structures, integers, floats, or None.

    Attributes:
        address: Where the structure lies.
    """

    def __init__(self, *values: "NDArray[Any] | Packed | float | None") -> None:
        self._kept = values
        self._fields = np.array([_field(value) for value in values], dtype=np.int64)
        self.address = _place(self._fields)


def _field(value: "NDArray[Any] | Packed | float | None") -> int:
    """Return the eight bytes of a field as an integer."""
    if isinstance(value, np.ndarray):
        return _place(value)
    if isinstance(value, Packed):
        return value.address
    if isinstance(value, float):
        return int.from_bytes(_DOUBLE.pack(value), sys.byteorder, signed=True)
    return int(value or 0)


def _place(array: NDArray[Any]) -> int:
    """Return where the values of a contiguous array lie, which the caller keeps alive."""
    if not array.flags.c_contiguous:
        raise ValueError("the kernel takes contiguous arrays")
    return ctypes.addressof(_VALUES.from_buffer(array)) if array.flags.writeable else int(array.ctypes.data)


def checked(status: int) -> None:
    """Raise the error that a function of the library returns.

    Raises:
        IndexError: An index is outside an array (1).
        LinAlgError: A matrix is not finite (2), or a covariance is not positive definite (3).
    """
    if status == 1:
        raise IndexError("an index is outside the arrays of the kernel")
    if status:
        raise np.linalg.LinAlgError(
            "a matrix is not finite" if status == 2 else "a covariance is not positive definite"
        )


def _missing(*_arguments: Any) -> Any:
    raise RuntimeError(f"the kernel is not loaded: {KERNEL.text}")


class Stage(Generic[P, R]):
    """A pure function with two bodies: NumPy, and compiled.

    Attributes:
        is_compiled: Whether the stages use their compiled bodies; the same for all, see `use_kernel`.
    """

    is_compiled = KERNEL.library is not None

    def __init__(self, numpy_body: Callable[P, R], compiled_body: Callable[P, R]) -> None:
        self.numpy_body, self.compiled_body = numpy_body, compiled_body
        update_wrapper(self, numpy_body)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Return the result of the chosen body."""
        return (self.compiled_body if Stage.is_compiled else self.numpy_body)(*args, **kwargs)


def stage(compiled_body: Callable[P, R]) -> Callable[[Callable[P, R]], Stage[P, R]]:
    """Return a decorator that gives a NumPy function its compiled body."""
    return lambda numpy_body: Stage(numpy_body, compiled_body)


def use_kernel(is_used: bool) -> bool:
    """Choose the bodies of all stages, for tests and measurements; return whether they are the compiled ones."""
    Stage.is_compiled = is_used and KERNEL.library is not None
    return Stage.is_compiled
