"""Facts for a report on an installation, using only the standard library."""

import importlib
import importlib.metadata
import importlib.util
import platform
import sys
from pathlib import Path

from ...core import __version__
from ...core.system.libraries import LIBRARIES

problem = ""  # reason why the add-on is only partly registered
tested: list[str] = []  # lines of the self-test


def library_facts(module: str, load: bool = False) -> str:
    """Return a library's version and folder, or the error; `load` also imports it."""
    spec = importlib.util.find_spec(module)
    if spec is None:
        return f"{module} missing"
    if load:
        try:
            importlib.import_module(module)
        except Exception as error:  # a broken library may raise any exception
            return f"{module} cannot be loaded: {type(error).__name__}: {error}"
    try:
        version = importlib.metadata.version(LIBRARIES[module])
    except importlib.metadata.PackageNotFoundError:
        version = "of unknown version"
    folders = list(spec.submodule_search_locations or [])
    return f"{module} {version} in {Path(folders[0]).parent}" if folders else f"{module} {version}"


def lines(blender_version: str, load: bool = False) -> list[str]:
    """Return the facts, one per line; `load` also imports the libraries."""
    facts = [
        f"Perfanim {__version__}, Blender {blender_version}, Python {platform.python_version()}",
        platform.platform(),
        f"Python program: {sys.executable}",
        *[library_facts(module, load) for module in LIBRARIES],
    ]
    return [*facts, *([f"Problem: {problem}"] if problem else []), *tested]
