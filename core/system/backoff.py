"""Waiting times between attempts, doubled after each attempt."""

import math


class Backoff:
    """Waiting time until the next attempt.

    Args:
        first_s: Wait before the first attempt, counted from the reset or from the first query after it.
        longest_s: Longest wait.
    """

    def __init__(self, first_s: float, longest_s: float = math.inf) -> None:
        self._first_s, self._longest_s = first_s, longest_s
        self.reset()

    def reset(self, now_s: float | None = None) -> None:
        """Restart with the first wait, which begins at `now_s`, or at the next query if that is None."""
        self._since_s, self._wait_s = now_s, self._first_s

    def is_due(self, now_s: float) -> bool:
        """Return whether the wait is over."""
        if self._since_s is None:
            self._since_s = now_s
        return now_s - self._since_s >= self._wait_s

    def attempt(self, now_s: float) -> None:
        """Start the next wait, which is twice as long."""
        self._since_s, self._wait_s = now_s, min(2.0 * self._wait_s, self._longest_s)
