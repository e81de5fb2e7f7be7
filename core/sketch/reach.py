"""Largest distances between joints of a body."""

import numpy as np

from ..body.skeleton import Skeleton
from ..geometry.arrays import Array, Mask
from .key_interpolation import curve_positions


class Reach:
    """Brings targets of joints within each other's reach.

    Args:
        joints: Names (M) of the joints, the most binding first.
        straightest: Largest fraction of its bones' total length that a limb spans; limbs are never quite straight.
    """

    def __init__(self, skeleton: Skeleton, joints: tuple[str, ...], straightest: float = 0.998) -> None:
        self._joints = joints
        lengths = np.linalg.norm(skeleton.offsets_m, axis=1)
        indices = [skeleton.index(name) for name in joints]
        chains = np.where(skeleton.is_ancestor[indices], lengths, 0.0)
        shared = skeleton.is_ancestor[indices][:, None] & skeleton.is_ancestor[indices][None]
        total = chains.sum(axis=1)
        between = total[:, None] + total - 2.0 * np.sum(np.where(shared, lengths, 0.0), axis=2)
        parents = skeleton.parents[indices]
        rigid = (parents[:, None] == indices) | (parents == np.array(indices)[:, None])
        self._reach_m = np.where(rigid, 1.0, straightest) * between

    def between(self, joint: str, other: str) -> float:
        """Return the largest distance between two of the joints, metres."""
        return float(self._reach_m[self._joints.index(joint), self._joints.index(other)])

    def yielding(self, points_m: Array, keyed: Mask) -> Array:
        """Return controls (F, C, 3), each moved between its own keys so that the keys of the others stay within reach.

        Args:
            keyed: Mask (F, C) of the frames in which each control has a key.
        """
        result = points_m.copy()
        for joint in range(keyed.shape[1]):
            needed = np.zeros(points_m.shape[::2])
            for other in set(range(keyed.shape[1])) - {joint}:
                way = result[:, other] - result[:, joint]
                far = np.linalg.norm(way, axis=1)
                beyond = np.maximum(far - self._reach_m[joint, other], 0.0) * (keyed[:, other] & ~keyed[:, joint])
                needed += (beyond / np.maximum(far, 1e-9))[:, None] * way
            knots = np.flatnonzero(keyed[:, joint] | needed.any(axis=1))
            if needed.any():
                frames = np.arange(len(needed), dtype=np.float64)
                result[:, joint] += curve_positions(frames[knots], needed[knots], frames)
        return result

    def limited(self, points_m: Array) -> Array:
        """Return targets (F, M, 3) within reach; the later joint of a pair moves towards the earlier one."""
        result = points_m.copy()
        for later in range(1, points_m.shape[1]):
            for earlier in range(later):
                way = result[:, later] - result[:, earlier]
                far = np.linalg.norm(way, axis=1)
                share = np.minimum(1.0, self._reach_m[later, earlier] / np.maximum(far, 1e-9))
                result[:, later] = result[:, earlier] + share[:, None] * way
        return result
