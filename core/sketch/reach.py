"""How far joints of a body can be from each other."""

import numpy as np

from ..body.skeleton import Skeleton
from ..geometry.arrays import Array

_STRAIGHTEST = 0.985  # of the bones end to end: no limb is quite straight


class Reach:
    """Brings targets of joints within each other's reach.

    Args:
        joints: names (M), those that bind most first.
    """

    def __init__(self, skeleton: Skeleton, joints: tuple[str, ...]) -> None:
        lengths = np.linalg.norm(skeleton.offsets_m, axis=1)
        indices = [skeleton.index(name) for name in joints]
        chains = np.where(skeleton.is_ancestor[indices], lengths, 0.0)
        shared = skeleton.is_ancestor[indices][:, None] & skeleton.is_ancestor[indices][None]
        total = chains.sum(axis=1)
        between = total[:, None] + total - 2.0 * np.sum(np.where(shared, lengths, 0.0), axis=2)
        parents = skeleton.parents[indices]
        rigid = (parents[:, None] == indices) | (parents == np.array(indices)[:, None])
        self._reach_m = np.where(rigid, 1.0, _STRAIGHTEST) * between

    def limited(self, points_m: Array) -> Array:
        """Return targets (F, M, 3) within reach.

        The later joint of a pair is drawn towards the earlier one.
        """
        result = points_m.copy()
        for later in range(1, points_m.shape[1]):
            for earlier in range(later):
                way = result[:, later] - result[:, earlier]
                far = np.linalg.norm(way, axis=1)
                share = np.minimum(1.0, self._reach_m[later, earlier] / np.maximum(far, 1e-9))
                result[:, later] = result[:, earlier] + share[:, None] * way
        return result
