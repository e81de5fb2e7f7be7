"""A machine with four times as much to do as it can."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

LOOPS = 4 * (os.cpu_count() or 1)


@contextmanager
def busy_machine(seconds: float) -> Iterator[None]:
    """Let every processor have four processes that never wait, for so long at most."""
    line = f"import time\nend = time.monotonic() + {seconds}\nwhile time.monotonic() < end: pass"
    loops = [subprocess.Popen([sys.executable, "-c", line]) for _ in range(LOOPS)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()
