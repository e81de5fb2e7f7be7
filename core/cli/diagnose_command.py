"""`perfanim diagnose`: list the installed versions and the cameras found."""

import argparse
import importlib
import importlib.metadata
import platform
import sys
from typing import Any

from ..kernel.library import KERNEL
from ..system.libraries import LIBRARIES
from ..system.progress import Progress
from .options import add_command


def add_parser(subparsers: Any) -> None:
    add_command(subparsers, "diagnose", _run, "installed versions and the cameras found")


def _run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    progress(0.0, "loading the libraries")
    libraries = {name: library_facts(name) for name in LIBRARIES}
    progress(0.5, "looking for cameras")
    return {
        "python": f"{platform.python_version()} ({sys.executable})",
        "platform": platform.platform(),
        "libraries": libraries,
        "kernel": KERNEL.text,
        "cameras": _cameras(),
    }


def library_facts(name: str) -> str:
    """Return a library's version, or why it cannot be loaded."""
    try:
        library = importlib.import_module(name)
    except Exception as error:  # broken libraries may raise any exception
        return f"cannot be loaded: {type(error).__name__}: {error}"
    if hasattr(library, "__version__"):
        return str(library.__version__)
    try:
        return importlib.metadata.version(LIBRARIES[name])
    except importlib.metadata.PackageNotFoundError:
        return "unknown version"


def _cameras() -> list[dict[str, Any]]:
    try:
        from ..vision.sources.camera_source import find_cameras
    except ImportError:  # the report on libraries says why
        return []
    return [{"device": camera.device, "size": camera.size} for camera in find_cameras()]
