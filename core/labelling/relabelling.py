"""Corrections of labels while a body is tracked: limbs lost or exchanged.

Labelling by the last synthesized pose keeps to what it believes: where a limb was lost for long, its pose is the
database's guess, and the marker that returns is far from it. Then a point stays without a name beside a marker without
a point, and the points are compared with poses of the database as if only the torso were known.
"""

from collections.abc import Mapping

import numpy as np

from ..geometry.arrays import Array, Mask
from .initial_labelling import InitialLabeller

_GAIN = 6.0  # of the logarithm of the likelihood, from which labels are better
_CONFIRMATIONS = 3  # looks that find the same
_REACH_M_S = 6.0  # as far as a limb moves between two looks, and
_REACH_M = 0.1  # this much besides
_PATIENCE_S = 0.25  # between two looks that confirm each other


class Relabeller:
    """Finds better labels of the limbs than those that follow from the last pose.

    Args:
        torso: (M,) which markers lie on the torso.
    """

    def __init__(self, start: InitialLabeller, torso: Mask) -> None:
        self._start = start
        self._torso = torso
        self.changed = False  # whether the last frame's labels were bettered
        self._suspected: Mapping[int, Array] = {}
        self._confirmed = 0
        self._time_s = -np.inf

    def relabel(self, time_s: float, markers_m: Array, unnamed_m: Array) -> Array | None:
        """Return the markers (M, 3) under better labels, once confirmed; else None.

        Args:
            markers_m: (M, 3) points as they are labelled, NaN where a marker has none.
            unnamed_m: (N, 3) points that are no marker's.
        """
        self.changed = False
        located = np.isfinite(markers_m[:, 0])
        if len(unnamed_m) == 0 or np.all(located[~self._torso]):
            return None
        points = np.concatenate((markers_m[located], unnamed_m))
        labels = np.concatenate((np.flatnonzero(located), np.full(len(unnamed_m), -1)))
        found = self._start.complete(points, labels)
        if found is None:
            return None
        result = np.full(markers_m.shape, np.nan)
        result[found.labels[found.labels >= 0]] = points[found.labels >= 0]
        changed = {
            int(marker): result[marker]
            for marker in np.flatnonzero(np.isfinite(result[:, 0]) | located)
            if not np.array_equal(result[marker], markers_m[marker], equal_nan=True)
        }
        if not changed or self._start.cost(markers_m, ghosts=len(unnamed_m)) - found.cost < _GAIN:
            return None
        self.changed = self._is_confirmed(time_s, changed)
        return result if self.changed else None

    def _is_confirmed(self, time_s: float, changed: Mapping[int, Array]) -> bool:
        """Count consecutive checks that change the same markers near the same places."""
        elapsed = time_s - self._time_s
        reach = _REACH_M + _REACH_M_S * elapsed
        common = changed.keys() & self._suspected.keys()
        same = 0.0 < elapsed < _PATIENCE_S and any(
            np.linalg.norm(changed[marker] - self._suspected[marker]) < reach for marker in common
        )
        self._confirmed = self._confirmed + 1 if same else 1
        self._suspected, self._time_s = changed, time_s
        return self._confirmed >= _CONFIRMATIONS
