"""Downloading packages with the user's own pip."""

import ensurepip
import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

from ..errors import DownloadError

_FOR = ("--python-version", "3.11", "--platform", "manylinux_2_17_x86_64", "--platform", "manylinux2014_x86_64")
_OPTIONS = ("download", "--no-deps", "--only-binary", ":all:", *_FOR, "--no-cache-dir", "--quiet")
_LONGEST_S, _POLL_S = 1800.0, 0.2
_TEMPORARY = ("TMPDIR", "TEMP", "TMP")  # environment variables that name the folder for temporary files


def download_wheel(package: str, folder: Path, arrived: Callable[[int], None]) -> None:
    """Download a package's wheel for Linux into a folder, for files that are the same on all platforms.

    Args:
        package: Name and version, as pip takes them.
        folder: Existing folder, which also holds the temporary files of pip.
        arrived: Called several times a second with the number of bytes so far; if it raises, pip is ended.

    Raises:
        DownloadError: pip is missing or fails.
    """
    advice = f"check the connection, or bring a wheel of {package} from another computer"
    environment = {**os.environ, **dict.fromkeys(_TEMPORARY, str(folder))}
    command = [*pip_command(), *_OPTIONS, "--dest", str(folder), package]
    try:
        pip = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment
        )  # fmt: skip
    except OSError as error:
        raise DownloadError(f"pip does not start ({error})", advice=advice) from error
    with pip:
        try:
            said = _wait(pip, folder, arrived)
        except BaseException:
            pip.kill()
            raise
    if said is None:
        raise DownloadError(f"pip does not bring {package} within {_LONGEST_S / 60.0:.0f} minutes", advice=advice)
    if pip.returncode:
        reason = (said.strip().splitlines() or ["no reason given"])[-1]
        raise DownloadError(f"pip does not bring {package} ({reason})", advice=advice)


def _wait(pip: subprocess.Popen[str], folder: Path, arrived: Callable[[int], None]) -> str | None:
    """Return what pip prints until it ends; None if that takes too long, then it is ended."""
    limit_s = time.monotonic() + _LONGEST_S
    while time.monotonic() < limit_s:
        with suppress(subprocess.TimeoutExpired):
            return pip.communicate(timeout=_POLL_S)[1]
        arrived(_size(folder))
    pip.kill()
    return None


def _size(folder: Path) -> int:
    """Return the size of all files in a folder, bytes; files may disappear meanwhile."""
    size = 0
    for path in folder.rglob("*"):
        with suppress(OSError):
            size += path.stat().st_size
    return size


def pip_command() -> list[str]:
    """Return the command that runs pip; where it is not installed, as in Blender, the wheel that Python brings."""
    bundled = sorted(Path(ensurepip.__file__).parent.glob("_bundled/pip-*.whl"))
    if find_spec("pip") is None and bundled:
        return [sys.executable, str(bundled[-1] / "pip")]
    return [sys.executable, "-m", "pip"]
