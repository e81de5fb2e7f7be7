"""Downloading packages with the user's own pip."""

import ensurepip
import subprocess
import sys
from importlib.util import find_spec
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
    options = ("download", "--no-deps", "--only-binary", ":all:", *_FOR)
    advice = f"check the connection, or bring a wheel of {package} from another computer"
    try:
        done = subprocess.run(
            [*pip_command(), *options, "--quiet", "--dest", str(folder), package],
            capture_output=True, text=True, check=False, timeout=_LONGEST_S,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as error:
        raise DownloadError(f"pip does not bring {package} ({error})", advice=advice) from error
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise DownloadError(f"pip does not bring {package} ({said})", advice=advice)


def pip_command() -> list[str]:
    """Return the command that runs pip; where it is not installed, as in Blender, the wheel that Python brings."""
    bundled = sorted(Path(ensurepip.__file__).parent.glob("_bundled/pip-*.whl"))
    if find_spec("pip") is None and bundled:
        return [sys.executable, str(bundled[-1] / "pip")]
    return [sys.executable, "-m", "pip"]
