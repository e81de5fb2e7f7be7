"""Functions that show how far long work is."""

from collections.abc import Callable

Progress = Callable[[float, str], None]  # fraction done (0 to 1), activity


def no_progress(_fraction: float, _text: str) -> None:
    """Show nothing."""
