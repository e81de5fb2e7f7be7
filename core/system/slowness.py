"""Slowness of a process on a machine that has more to do than processors."""

import math

BUSY = 2.5  # slowness that people should know of
_MEMORY_S = 0.5  # of work
_LEAST_S = 0.05  # of work, until it counts
_MOST = 50.0


class Slowness:
    """By how many times work takes longer than alone: time over processor time.

    Beside four others on each processor it is about 5, on every system, and in containers with a share of a processor.

    Attributes:
        beside: slowness of another process, which counts as well.
    """

    def __init__(self) -> None:
        self.beside = 1.0
        self._work_s = self._processor_s = 0.0

    def add(self, work_s: float, processor_s: float) -> None:
        """Add work without waiting: its time, and its thread's time on a processor."""
        kept = math.exp(-work_s / _MEMORY_S)
        self._work_s = kept * self._work_s + work_s
        self._processor_s = kept * self._processor_s + processor_s

    @property
    def factor(self) -> float:
        """By how many times work takes longer than alone, at least 1."""
        known = self._work_s > _LEAST_S
        own = self._work_s / max(self._processor_s, self._work_s / _MOST) if known else 1.0
        return max(own, self.beside, 1.0)
