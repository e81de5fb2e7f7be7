"""Functions that report the progress of long work."""

from collections.abc import Callable

Progress = Callable[[float, str], None]  # fraction done (0 to 1), activity


def no_progress(_fraction: float, _text: str) -> None:
    """Report nothing."""
