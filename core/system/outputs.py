"""Outputs of commands: checks that they differ from the inputs, and locks against other writers."""

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import FormatError
from .lock import lock

LOCK_ENDING = ".lock"
_CLAIMED = "PERFANIM_OUTPUT"  # environment variable: output locked by this process or by the one that started it
_TRIES = 100  # attempts to lock a file that others keep removing


def check_no_input(out: Path | str, inputs: Iterable[Path | str]) -> None:
    """Raise FormatError if an output is the same file as one of the inputs."""
    for path in inputs:
        with suppress(OSError, ValueError):  # does not exist, or is not a valid file name
            if os.path.samefile(out, path):  # noqa: PTH121 - pathlib's raises for NUL
                raise FormatError(
                    "is an input and would be overwritten", where=str(path), advice="give the output another name"
                )


@contextmanager
def writer_lock(target: Path) -> Iterator[None]:
    """Keep other programs from writing a file, using a lock file `.NAME.lock` next to it.

    Without write access there is no lock; writing the file then reports the reason.

    Raises:
        FormatError: Another program is writing to it.
    """
    path = target.parent / f".{target.name}{LOCK_ENDING}"
    try:
        handle = _locked(path)
    except OSError:
        yield
        return
    if handle is None:
        raise FormatError(
            "is being written by another program", where=str(target), advice="wait for it, or choose another name"
        )
    try:
        yield
    finally:
        if sys.platform == "win32":  # an open file cannot be removed on Windows
            os.close(handle)
            with suppress(OSError):
                path.unlink()
        else:  # removed while locked: another writer that has opened the file checks whether it still exists
            with suppress(OSError):
                path.unlink()
            os.close(handle)


def _locked(path: Path) -> int | None:
    """Return the handle of a lock file, or None if another program holds it."""
    for _ in range(_TRIES):
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        if not lock(handle):
            os.close(handle)
            return None
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(handle), path.stat()):
                return handle
        os.close(handle)  # the earlier writer has removed this file
    return None


@contextmanager
def claimed(target: Path | str) -> Iterator[None]:
    """Lock an output while a command and its processes compute and write the file.

    Raises:
        FormatError: Another program is writing to it.
    """
    real = os.path.realpath(target)
    with writer_lock(Path(real)):
        os.environ[_CLAIMED] = real
        try:
            yield
        finally:
            del os.environ[_CLAIMED]


def is_claimed(target: Path) -> bool:
    """Return whether the command that this process works for has locked an output."""
    return os.environ.get(_CLAIMED) == os.path.realpath(target)
