"""Blocks of numbers in text files."""

import warnings

import numpy as np

from ...geometry.arrays import Array


def parse_numbers(text: bytes) -> Array | None:
    """Return all numbers of a text, or None when it holds anything else."""
    with warnings.catch_warnings():
        # numpy 1 warns about what it cannot read, numpy 2 raises
        warnings.simplefilter("error", DeprecationWarning)
        try:
            return np.fromstring(text, dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            return None
