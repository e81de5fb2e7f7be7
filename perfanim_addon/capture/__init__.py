"""Live capture: from the worker's poses to bones and actions."""
