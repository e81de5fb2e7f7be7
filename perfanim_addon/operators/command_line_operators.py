"""Command line of Blender: `blender --background --command perfanim ...`.

Commands run in a separate process, as the worker does, because Blender has already loaded NumPy's libraries, set up
for its own use.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy

from ..preferences import preferences

NAME = "perfanim"

_handles: list[Any] = []


def run(arguments: Sequence[str]) -> int:
    """Run `perfanim` with arguments and return its exit status."""
    from ...core.cli import in_blender
    from ...core.system import helper_process
    from ...core.system.blender_process import BLENDER_VARIABLE
    from ...core.worker.child_process import library_paths

    python = preferences.worker_python(bpy.context) or sys.executable
    # retargeting runs in another process of this Blender, unless Blender is a Python module ("" as its path)
    environment = {BLENDER_VARIABLE: bpy.app.binary_path, **os.environ}
    order = helper_process.run_request(in_blender.run, list(arguments), paths=library_paths())
    with subprocess.Popen(helper_process.command(python), stdin=subprocess.PIPE, env=environment) as process:
        if process.stdin is not None:
            process.stdin.write(order.encode() + b"\n")
            process.stdin.flush()  # stays open: the process ends when its input is closed
        while True:
            try:
                status = process.wait()
            except KeyboardInterrupt:  # the process receives the interrupt as well, and cleans up
                continue
            return status if status >= 0 else 128 - status


def _command(arguments: list[str]) -> int:
    status = run(arguments)
    # discard Blender's own buffered lines, which would follow the command's
    with Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
    return status


def register() -> None:
    """Register the command."""
    _handles.append(bpy.utils.register_cli_command(NAME, _command))


def unregister() -> None:
    """Undo `register`."""
    while _handles:
        bpy.utils.unregister_cli_command(_handles.pop())
