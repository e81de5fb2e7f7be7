"""Whether somebody writes a file: a lock of the operating system's, which goes with its process however that ends."""

import os
import sys
from pathlib import Path

_FAR = 1 << 40  # beyond any take: on Windows nobody else may read locked bytes

if sys.platform == "win32":
    import msvcrt

    def _locked(handle: int) -> bool:
        os.lseek(handle, _FAR, os.SEEK_SET)
        try:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        finally:
            os.lseek(handle, 0, os.SEEK_SET)
        return True

else:
    import fcntl

    def _locked(handle: int) -> bool:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:  # a file system without locks: nobody can tell
            return True
        return True


def lock(handle: int) -> bool:
    """Lock an open file for this process until the handle is closed; False when another holds it."""
    return _locked(handle)


def is_locked(path: Path | str) -> bool:
    """Return whether another holds the file; False as well when it cannot be opened."""
    try:
        with Path(path).open("r+b") as file:
            return not _locked(file.fileno())
    except OSError:
        return False
