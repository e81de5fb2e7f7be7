"""Wild points: stretches of a trajectory that fit neither the motion before nor the motion after."""

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, IntArray, Mask
from .trajectory_seams import MEDIAN_LENGTH, SeamScale, after, before, cost, medians


@dataclass(frozen=True)
class WildPointSettings:
    """Settings of `find_wild_points`; chosen like `SeamSettings`."""

    quantile: float = 0.3  # quantile of the distances of wild points that counts
    jump_m: float = 0.055  # smallest distance of wild points from the extrapolated motion
    jump_sigmas: float = 4.0  # smallest miss at their first and last seam, standard deviations
    longest_s: float = 0.5  # longest stretch of wild points
    evidence: float = 22.0  # evidence needed for wild points, nats
    each: float = 1.5  # additional evidence needed for each point, nats
    beside: int = 6  # number of seams on either side of wild points that show how sudden the motion is there
    independent: int = 16  # distance from which wild points do not affect each other's evidence, positions
    edge: float = 0.5  # smallest miss at either end, as a share of their distance; below it, they are a step
    bridge_sigmas: float = 3.0  # largest miss between the motion before and after wild points, standard deviations
    together: float = 0.3  # distance of other markers on the bone, share of the point's: the whole bone jumps
    sigmas: float = 4.0  # the same as `jump_m`, in standard deviations of the miss across the stretch


_S = WildPointSettings()
_BRIDGE = 3  # seam over wild points, among those of four positions before and four after


def find_wild_points(times_s: Array, points_m: Array, scale: SeamScale, nearest: Mask) -> Mask:
    """Return a mask (F, M) of positions that fit neither the motion before nor the motion after."""
    wild = np.zeros(points_m.shape[:2], dtype=bool)
    for marker, others in enumerate(nearest):
        beside = points_m[:, others]
        rows = np.flatnonzero(np.isfinite(points_m[:, marker, 0]))
        wild[_WildSearch(times_s, points_m[:, marker], beside, scale, marker).all(rows), marker] = True
    return wild


class _WildSearch:
    """Removes positions from a trajectory while this makes the rest more likely.

    Args:
        path: The trajectory (F, 3).
        beside: Trajectories (F, N, 3) of markers on the same bone.
    """

    def __init__(self, times_s: Array, path: Array, beside: Array, scale: SeamScale, marker: int) -> None:
        self._times_s, self._path, self._beside = times_s, path, beside
        self._scale, self._marker = scale, marker

    def all(self, rows: IntArray) -> IntArray:
        """Return the frames of wild points among those where the marker is visible."""
        kept = rows
        while len(kept) > 6 and (taken := self._best(kept)):
            kept = np.delete(kept, np.concatenate(taken))
        return np.setdiff1d(rows, kept)

    def _best(self, rows: IntArray) -> list[IntArray]:
        """Return the indices into rows of wild points, those with more evidence per point than any others near them."""
        times_s, path = self._times_s[rows], self._path[rows]
        misses = np.linalg.norm(before(times_s, path) - after(times_s, path), axis=1)
        torn = self._scale.torn(self._marker, times_s, misses, 0.5 * _S.jump_m, _S.jump_sigmas)
        ends = np.searchsorted(times_s[torn], times_s[torn] + _S.longest_s, side="right")
        pairs = [(start, stop) for i, start in enumerate(torn) for stop in torn[i + 1 : ends[i]]]
        starts, stops = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        gains = np.zeros(len(pairs))
        for count in np.unique(stops - starts):
            of = np.flatnonzero(stops - starts == count)
            gains[of] = self._gains(rows, starts[of] + 1, int(count), misses) / count
        order = np.argsort(-gains, kind="stable")[: np.count_nonzero(gains > 0.0)]
        first, last = starts[order] + 1, stops[order]
        is_near = [
            (first[:place] <= last[place] + _S.independent) & (last[:place] >= first[place] - _S.independent)
            for place in range(len(order))
        ]
        return [
            np.arange(start, stop + 1)
            for start, stop, better in zip(first, last, is_near, strict=True)
            if not better.any()
        ]

    def _gains(self, rows: IntArray, first: IntArray, count: int, misses: Array) -> Array:
        """Return the evidence (K,), nats, beyond what is needed, that the points from each first one on are wild."""
        gains = np.zeros(len(first))
        room = np.flatnonzero((first >= 2) & (first + count + 2 <= len(rows)))
        points, near = first[room, None] + np.arange(count), first[room, None] + np.r_[-4:0, count : count + 4]
        usual = self._usual(misses, first[room], count)
        left, elapsed_s = self._left(rows, near)
        marker_usual = float(self._scale.usual[self._marker])
        bridge = self._scale.over(self._marker, elapsed_s) * np.maximum(1.0, usual / marker_usual)
        away = _away(self._times_s, self._path[:, None], rows, points)[:, :, 0]
        least = np.quantile(np.linalg.norm(away, axis=-1), _S.quantile, axis=1)
        is_wild = least >= np.maximum(_S.jump_m, _S.sigmas * bridge)
        is_wild &= np.minimum(misses[points[:, 0] - 1], misses[points[:, -1]]) >= _S.edge * least
        # otherwise the trajectory continues elsewhere: a step
        is_wild &= left[:, _BRIDGE] <= np.maximum(_S.edge * least, _S.bridge_sigmas * bridge)
        sigmas = np.repeat(usual[:, None], left.shape[1], axis=1)
        sigmas[:, _BRIDGE] = bridge
        now = np.nansum(cost(_at(misses, first[room, None] + np.arange(-4, count + 4)) / usual[:, None]), axis=1)
        found = now - np.nansum(cost(left / sigmas), axis=1) - _S.evidence - _S.each * count
        is_wild &= found > 0.0
        is_wild[is_wild] = ~self._is_body(rows, points[is_wild], away[is_wild])
        gains[room[is_wild]] = found[is_wild]
        return gains

    def _left(self, rows: IntArray, near: IntArray) -> tuple[Array, Array]:
        """Return the misses (K, 7) at the seams of the positions near wild points, and the durations of these seams.

        Args:
            near: Indices (K, 8) into rows, four before and four after; misses beyond the ends are NaN.
        """
        inside = (near >= 0) & (near < len(rows))
        frames = rows[np.clip(near, 0, len(rows) - 1)]
        times_s, path = self._times_s[frames], np.where(inside[..., None], self._path[frames], np.nan)
        velocities = np.diff(path, axis=1) / np.diff(times_s, axis=1)[..., None]
        half_s = 0.5 * np.diff(times_s, axis=1)[..., None]
        left = np.full(half_s.shape[:2], np.nan)
        come = path[:, 1:-2] + half_s[:, 1:-1] * velocities[:, :-2]
        go = path[:, 2:-1] - half_s[:, 1:-1] * velocities[:, 2:]
        left[:, 1:-1] = np.linalg.norm(come - go, axis=-1)
        return left, 2.0 * half_s[:, _BRIDGE, 0]

    def _usual(self, misses: Array, first: IntArray, count: int) -> Array:
        """Return the standard deviations (K,) of misses next to points, without the seams that they touch."""
        beside = _at(misses, first[:, None] + np.r_[-2 - _S.beside : -2, count + 1 : count + 1 + _S.beside])
        usual = np.zeros(len(first))
        known = np.isfinite(beside).any(axis=1)
        usual[known] = medians(beside[known]) / MEDIAN_LENGTH
        return np.maximum(usual, float(self._scale.usual[self._marker]))

    def _is_body(self, rows: IntArray, points: IntArray, away: Array) -> Mask:
        """Return whether (K,) most markers on the same bone jump away from their trajectories, too."""
        others = np.linalg.norm(_away(self._times_s, self._beside, rows, points), axis=-1).max(axis=1)
        found = np.zeros(len(points), dtype=bool)
        known = np.isfinite(others).any(axis=1)
        furthest = np.linalg.norm(away[known], axis=-1).max(axis=1)
        found[known] = medians(others[known]) > _S.together * furthest
        return found


def _at(values: Array, indices: IntArray) -> Array:
    """Return values at indices, NaN beyond the ends."""
    inside = (indices >= 0) & (indices < len(values))
    return np.where(inside, values[np.clip(indices, 0, len(values) - 1)], np.nan)


def _away(times_s: Array, points_m: Array, rows: IntArray, points: IntArray) -> Array:
    """Return how far (K, n, M, 3) trajectories (F, M, 3) are from cubics through two positions before and two after.

    Args:
        rows: Frames with positions.
        points: Successive indices (K, n) into these.
    """
    beside = rows[points[:, :1] + np.array([-2, -1, points.shape[1], points.shape[1] + 1])]
    known_s, wanted_s = times_s[beside], times_s[rows[points]]
    weights = np.ones((*wanted_s.shape, 4))
    for i in range(4):
        for j in range(4):
            if i != j:
                share = (wanted_s - known_s[:, j, None]) / (known_s[:, i] - known_s[:, j])[:, None]
                weights[..., i] *= share
    return np.asarray(points_m[rows[points]] - np.einsum("gnk,gkmc->gnmc", weights, points_m[beside]))
