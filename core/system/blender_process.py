"""Functions of the add-on, run in a separate process by Blender's Python module or a Blender executable."""

import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

from ..errors import CharacterError
from . import helper_process
from .files import is_file

BLENDER_VARIABLE = "PERFANIM_BLENDER"  # environment variable: executable to use if none is given


def run_in_blender(entry: str, arguments: Sequence[str], blender: str | None = None) -> dict[str, Any]:
    """Run a function of the add-on and return its report.

    Args:
        entry: Module and function, such as "perfanim.perfanim_addon.export.retarget_file:main".
        arguments: Command-line arguments of the function.
        blender: Blender executable; None for the one that the environment variable names, or else Blender's Python
            module (bpy).

    Raises:
        CharacterError: The function failed; the message is the one that it printed.
    """
    done = subprocess.run(_command(blender, entry, arguments), capture_output=True, text=True, check=False)
    prefix = f"{entry.partition(':')[0].rpartition('.')[2]}: "
    if done.returncode != 0:
        lines = [line for line in done.stderr.splitlines() if line.strip()] or ["Blender ended without a message"]
        said = next((line for line in lines if line.startswith(prefix)), lines[-1])
        raise CharacterError(said.removeprefix(prefix))
    # Blender prints lines of its own as well
    report: dict[str, Any] = json.loads([line for line in done.stdout.splitlines() if line.startswith("{")][-1])
    return report


def check_blender(blender: str | None) -> None:
    """Raise CharacterError if the named Blender is missing, or bpy if none is named."""
    blender = _chosen(blender)
    if blender is None and importlib.util.find_spec("bpy") is None:
        advice = "install bpy with pip for this Python, or name a Blender executable"
        raise CharacterError("Blender's Python module (bpy) is not installed", advice=advice)
    if blender is not None and not is_file(blender):
        raise CharacterError("is not an executable", where=blender, advice="give the path of the Blender executable")


def _chosen(blender: str | None) -> str | None:
    return blender or os.environ.get(BLENDER_VARIABLE) or None


def _command(blender: str | None, entry: str, arguments: Sequence[str]) -> list[str]:
    blender = _chosen(blender)
    if blender is None:
        package = __name__.partition(".core.")[0]
        return [sys.executable, "-m", entry.partition(":")[0].replace("perfanim", package, 1), *arguments]
    order = helper_process.run_request(entry, arguments)
    options = ("--background", "--factory-startup", "--disable-autoexec", "--python-exit-code", "1")
    return [blender, *options, "--python", helper_process.SCRIPT, "--", order]
