"""Euler angles over time without jumps between the two forms of a rotation."""

import numpy as np

from ...geometry.arrays import Array


def unwrap_euler(angles: Array) -> Array:
    """Return angles (F, 3), radians, each in the form nearest to the frame before.

    Three angles about three different axes turn as (a + pi, pi - b, c + pi) do.
    """
    other = np.stack((angles[:, 0] + np.pi, np.pi - angles[:, 1], angles[:, 2] + np.pi), axis=1)
    turns = ((form[1:] - angles[:-1] + np.pi) % (2.0 * np.pi) - np.pi for form in (angles, other))
    stay, change = (np.sum(np.abs(turn), axis=1) for turn in turns)
    changed = np.cumsum(change < stay) % 2 == 1  # from frame to frame both forms change alike
    changed = np.concatenate(([False], changed))
    return np.unwrap(np.where(changed[:, None], other, angles), axis=0)
