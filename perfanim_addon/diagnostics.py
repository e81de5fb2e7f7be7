"""What a report about a broken installation needs; nothing but the standard library."""

import importlib.metadata
import importlib.util
import platform
import sys

LIBRARIES = {
    "numpy": "numpy",
    "scipy": "scipy",
    "cv2": "opencv-contrib-python-headless",
}

problem = ""  # why the add-on is only partly registered; "" when all is well


def library_version(module: str) -> str:
    """Return a library's version, or "missing"."""
    if importlib.util.find_spec(module) is None:
        return "missing"
    try:
        return importlib.metadata.version(LIBRARIES[module])
    except importlib.metadata.PackageNotFoundError:
        return "present"


def lines(blender_version: str) -> list[str]:
    """Return the facts, one a line."""
    facts = [
        f"Blender {blender_version}, Python {platform.python_version()}, {platform.platform()}",
        f"Worker's Python: {sys.executable}",
        *[f"{module} {library_version(module)}" for module in LIBRARIES],
    ]
    return [*facts, f"Problem: {problem}"] if problem else facts
