"""This package's folder among the user's."""

import os
import sys
from pathlib import Path


def cache_folder() -> Path:
    """Return this package's folder among the system's cache folders; it may not exist yet."""
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "perfanim"
