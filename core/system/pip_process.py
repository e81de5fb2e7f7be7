"""Downloading packages with the user's own pip."""

import subprocess
import sys
from pathlib import Path

from ..errors import DownloadError

_FOR = ("--python-version", "3.11", "--platform", "manylinux_2_17_x86_64", "--platform", "manylinux2014_x86_64")
_LONGEST_S = 1800.0


def download_wheel(package: str, folder: Path) -> None:
    """Download a package's wheel for Linux into a folder, for files that are the same on all platforms.

    Args:
        package: Name and version, as pip takes them.
        folder: Existing folder.

    Raises:
        DownloadError: pip is missing or fails.
    """
    pip = [sys.executable, "-m", "pip", "download", "--no-deps", "--only-binary", ":all:", *_FOR]
    advice = f"check the connection, or bring a wheel of {package} from another computer"
    try:
        done = subprocess.run(
            [*pip, "--quiet", "--dest", str(folder), package],
            capture_output=True, text=True, check=False, timeout=_LONGEST_S,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as error:
        raise DownloadError(f"pip does not bring {package} ({error})", advice=advice) from error
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise DownloadError(f"pip does not bring {package} ({said})", advice=advice)
