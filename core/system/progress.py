"""Type of the functions that show how far long work is."""

from collections.abc import Callable

Progress = Callable[[float, str], None]  # fraction done (0 to 1), activity
