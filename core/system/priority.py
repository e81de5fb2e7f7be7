"""Priority of this process relative to others on the machine."""

import os
import sys

_NICE = 10  # out of 19; an otherwise idle CPU is still used fully
_BELOW_NORMAL = 0x4000  # BELOW_NORMAL_PRIORITY_CLASS


def step_back() -> None:
    """Lower the priority of this process until it ends."""
    if sys.platform == "win32":
        import ctypes

        kernel = ctypes.windll.kernel32
        kernel.SetPriorityClass(kernel.GetCurrentProcess(), _BELOW_NORMAL)
    else:
        os.nice(_NICE)
