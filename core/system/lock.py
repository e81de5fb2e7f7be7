"""Locks for files that are being written; the system releases them when the process ends."""

import os
import sys
from pathlib import Path

_FAR = 1 << 40  # offset beyond any take, because on Windows locked bytes cannot be read

if sys.platform == "win32":
    import msvcrt

    def lock(handle: int) -> bool:
        """Lock an open file until its handle is closed; return False if another process has locked it."""
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

    def lock(handle: int) -> bool:
        """Lock an open file until its handle is closed; return False if another process has locked it."""
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:  # the file system does not support locks
            return True
        return True


def is_locked(path: Path | str) -> bool:
    """Return whether another process has locked the file; False if it cannot be opened."""
    try:
        with Path(path).open("r+b") as file:
            return not lock(file.fileno())
    except OSError:
        return False
