"""The command line for Blender, in a Python of its own."""

import os
import signal
import sys
import threading
from collections.abc import Sequence


def run(arguments: Sequence[str]) -> int:
    """Run a command and return its exit status; end with standard input."""
    from .main import main  # settings of its libraries are made for a process, not for Blender

    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=_end_with_blender, daemon=True).start()
    return main(arguments)


def _end_with_blender() -> None:
    sys.stdin.read()
    os.kill(os.getpid(), signal.SIGTERM)
