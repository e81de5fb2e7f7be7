"""Slowness of a process on a machine that is busy with other work."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class SlownessSettings:
    """Settings for measuring a process's slowness."""

    busy: float = 2.5  # slowness above which the user is told
    memory_s: float = 0.5  # duration of work over which earlier measurements are forgotten
    least_s: float = 0.05  # duration of work before the measurement counts
    most: float = 50.0  # largest slowness


SLOWNESS = SlownessSettings()


class Slowness:
    """Duration of work relative to an idle machine: wall time divided by CPU time.

    With four other processes on each core it is about 5, on every system and in containers.

    Attributes:
        beside: Slowness of another process; `factor` is the larger of the two.
    """

    def __init__(self) -> None:
        self.beside = 1.0
        self._work_s = self._processor_s = 0.0

    def add(self, work_s: float, processor_s: float) -> None:
        """Add work without waiting times: its duration and the CPU time of its thread."""
        kept = math.exp(-work_s / SLOWNESS.memory_s)
        self._work_s = kept * self._work_s + work_s
        self._processor_s = kept * self._processor_s + processor_s

    @property
    def factor(self) -> float:
        """Duration of work relative to an idle machine, at least 1."""
        known = self._work_s > SLOWNESS.least_s
        own = self._work_s / max(self._processor_s, self._work_s / SLOWNESS.most) if known else 1.0
        return max(own, self.beside, 1.0)
