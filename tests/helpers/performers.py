"""Two walkers side by side: the second is a little ahead in the same walk."""

import numpy as np

APART_M = 1.2
AHEAD = 9  # frames


def side_by_side(true_markers, apart_m=APART_M):
    """Markers (F, M, 3) of the walker on the left, as cameras before them see it, and of the one on the right."""
    aside = np.array([0.5 * apart_m, 0.0, 0.0])
    return true_markers[:-AHEAD] - aside, true_markers[AHEAD:] + aside
