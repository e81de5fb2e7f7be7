"""Priority of this process among the others of the machine."""

import os
import sys

_NICE = 10  # of 19: an otherwise idle processor is still used fully
_BELOW_NORMAL = 0x4000  # BELOW_NORMAL_PRIORITY_CLASS


def step_back() -> None:
    """Let other processes go first, until this one ends."""
    if sys.platform == "win32":
        import ctypes

        kernel = ctypes.windll.kernel32
        kernel.SetPriorityClass(kernel.GetCurrentProcess(), _BELOW_NORMAL)
    else:
        os.nice(_NICE)
