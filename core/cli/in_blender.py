"""Entry point of the command line when Blender starts it in a separate Python process."""

import os
import signal
import sys
import threading
from collections.abc import Sequence


def run(arguments: Sequence[str]) -> int:
    """Run a command and return its exit status; exit if standard input closes because Blender has ended."""
    from .main import main  # not at the top: it sets environment variables for the whole process

    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=_end_with_blender, daemon=True).start()
    return main(arguments)


def _end_with_blender() -> None:
    sys.stdin.read()
    os.kill(os.getpid(), signal.SIGTERM)
