"""What a reader may take and how it may end, measured in this process."""

import ctypes
import gc
import resource
import time
import traceback
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from perfanim.core.errors import MOST_TEXT, PerfanimError

from .doors import Door

_TIMES = 4  # memory by the bytes of an input
_MORE_BYTES = 4 << 30  # beyond the present use; then a reader gets MemoryError, before the machine suffers


class Outcome(NamedTuple):
    """How an input ended.

    Args:
        fault: Place or reason of a fault, "" for an input that was accepted or refused as it should be.
    """

    accepted: bool
    fault: str = ""


@contextmanager
def limited_memory() -> Generator[None]:
    """Let this process have no more than some memory beyond its present use."""
    usual, most = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (_memory("VmSize:") + _MORE_BYTES, most))
    gc.collect()
    gc.freeze()  # what others have made is not looked through before each input
    try:
        yield
    finally:
        gc.unfreeze()
        resource.setrlimit(resource.RLIMIT_AS, (usual, most))


def outcome_of(door: Door, data: bytes) -> Outcome:
    """Read an input and return how it ended."""
    # What is given back while the door reads would be taken off its memory: garbage of those before, free heap.
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins at the present use
    before = _memory("VmRSS:")
    begun_s = time.process_time()  # of the processor, so that a busy machine is not the reader's fault
    accepted, fault = False, ""
    try:
        door.read(data)
        accepted = True
    except PerfanimError as error:
        if len(str(error)) > MOST_TEXT or "\n" in str(error):
            fault = "a message too long, or of several lines"
    except SystemExit as stop:  # argparse
        fault = "" if stop.code in (0, 2) else f"exit status {stop.code}"
    except BaseException as error:
        fault = f"{type(error).__name__} in {_place(error)}"
    if not fault and time.process_time() - begun_s > door.longest_s:
        fault = f"more than {door.longest_s:g} s"
    if not fault and _memory("VmHWM:") - before > _TIMES * len(data) + door.slack_bytes:
        fault = f"more memory than {_TIMES} times the input and {door.slack_bytes >> 20} MB"
    return Outcome(accepted, fault)


def _memory(key: str) -> int:
    """Return bytes of /proc/self/status."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) << 10 for line in lines if line.startswith(key))


def _place(error: BaseException) -> str:
    """Return file and line of the deepest call of the project."""
    calls = [call for call in traceback.extract_tb(error.__traceback__) if "/core/" in call.filename]
    return f"{'/'.join(Path(calls[-1].filename).parts[-3:])}:{calls[-1].lineno}" if calls else "the test"
