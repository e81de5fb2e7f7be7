"""Left and right, which a body network exchanges in single pictures of single cameras.

For each group of points (arms, legs, head), every camera's picture may show left and right exchanged, and that of one
camera may be wrong: between both sides, some networks place limbs where no limb is. A hidden Markov model weighs these
hypotheses: rays of all cameras must meet, the points go on as they have moved, and exchanges are rarer than right
pictures. The past decides what rays cannot: if all cameras exchange the legs, the rays meet as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from ...body.body_parts import PARTS
from ...geometry.arrays import Array, IntArray
from ...geometry.camera import Camera
from ...geometry.triangulation import triangulate
from ...markers.exchanged_throughout import other_sides
from ...markers.marker_set import Marker

# parts of the body whose points are exchanged together
_GROUPS = (
    ("head",),
    ("left arm", "left hand", "right arm", "right hand"),
    ("left leg", "left foot", "right leg", "right foot"),
)


@dataclass(frozen=True)
class ExchangeSettings:
    """Settings of `SideExchanges`."""

    ray_m: float = 0.035  # error of points across the rays of a camera
    still_m: float = 0.04  # distance from where a point was expected that the network's errors explain
    speed_m_s: float = 1.0  # usual change of a limb's velocity
    gain: float = 0.5  # share of the difference from the last velocity by which a point's velocity follows
    rare: float = 1.0  # evidence against each exchanged picture, nats
    missed: float = 2.0  # mean distance of a camera's rays from the others', in units of `ray_m`, of a wrong picture
    memory_s: float = 0.5  # time without points after which the past no longer counts
    usual_m: float = 3.0  # assumed distance from a single camera


_S = ExchangeSettings()
_RIGHT, _EXCHANGED, _WRONG = range(3)  # what a camera's picture shows of a group of points


class SideExchanges:
    """Decides which pictures of C cameras show left and right exchanged, and which are wrong.

    Args:
        cameras: The cameras.
        markers: The K points that the network finds.
        judges: Whether pictures are found wrong, too; not for cameras whose calibration is still rough.
    """

    def __init__(self, cameras: Sequence[Camera], markers: Sequence[Marker], judges: bool = True) -> None:
        self._cameras, self._others = tuple(cameras), other_sides(markers)
        joints = [{joint for part in parts for joint in PARTS[part]} for parts in _GROUPS]
        paired = (self._others >= 0) & (self._others != np.arange(len(markers)))
        on_group = ([marker.joint in names for marker in markers] for names in joints)
        members = [np.flatnonzero(paired & np.array(own)) for own in on_group]
        self._groups = [_Group(self._cameras, own, self._others[own], judges) for own in members if len(own)]

    def step(self, time_s: float, normalised: Array) -> IntArray:
        """Return for each camera and point (C, K) the index of the network's point that is this point; -1 if none is.

        Args:
            time_s: Time of the pictures.
            normalised: Undistorted normalised coordinates (C, K, 2) of the network's points, NaN where not found.
        """
        return self._of_points([group.step(time_s, normalised)[0] for group in self._groups])

    def decide_all(self, times_s: Array, normalised: Array) -> IntArray:
        """Return as `step` the points (F, C, K) of all moments of a take, each decided with the moments after it, too.

        Args:
            times_s: Times (F,).
            normalised: Coordinates (F, C, K, 2).
        """
        paths = []
        for group in self._groups:
            steps = [group.step(time_s, row) for time_s, row in zip(times_s.tolist(), normalised, strict=True)]
            paths.append(group.trace([before for _, before in steps]))
        return np.array([self._of_points(choices) for choices in zip(*paths, strict=True)])

    def _of_points(self, choices: Sequence[IntArray]) -> IntArray:
        """Return the points (C, K) for what each camera's picture shows (C,) of each group."""
        of_point = np.tile(np.arange(len(self._others)), (len(self._cameras), 1))
        for group, shown in zip(self._groups, choices, strict=True):
            of_point[np.ix_(shown == _EXCHANGED, group.own)] = group.other
            of_point[np.ix_(shown == _WRONG, group.own)] = -1
        return of_point


class _Group:
    """Points that are exchanged together: `own`, and their counterparts `other`, (n,)."""

    def __init__(self, cameras: tuple[Camera, ...], own: IntArray, other: IntArray, judges: bool) -> None:
        self.own, self.other = own, other
        self._cameras = cameras
        kinds = (_RIGHT, _EXCHANGED, _WRONG) if judges and len(cameras) > 1 else (_RIGHT, _EXCHANGED)
        choices = np.array(list(product(kinds, repeat=len(cameras))))
        self._choices = choices[np.count_nonzero(choices == _WRONG, axis=1) <= 1]  # (H, C)
        self._costs = np.zeros(len(self._choices))
        self._points: Array | None = None  # (H, n, D) where each hypothesis has the points
        self._velocities = np.zeros(0)  # (H, n, D) how fast they move there
        self._time_s = 0.0

    def step(self, time_s: float, normalised: Array) -> tuple[IntArray, IntArray]:
        """Return what each camera's picture shows (C,), and each hypothesis' likeliest predecessor (H,)."""
        elapsed_s = time_s - self._time_s
        last = self._points if 0.0 < elapsed_s < _S.memory_s else None
        points, costs = self._seen(normalised[:, self.own], normalised[:, self.other], last)
        before = np.arange(len(costs))
        if not np.isfinite(points).any():
            return np.asarray(self._choices[np.argmin(self._costs)]), before
        if last is None:
            self._velocities = np.zeros_like(points)
        else:
            apart = np.linalg.norm(points[:, None] - (last + elapsed_s * self._velocities), axis=-1)  # (H, H before, n)
            shares = apart / np.hypot(_S.still_m, _S.speed_m_s * elapsed_s)
            costs_before = self._costs + 0.5 * np.nansum(np.log1p(shares**2), axis=-1)
            before = costs_before.argmin(axis=1)
            costs = costs + costs_before.min(axis=1)
            velocities, moved = self._velocities[before], np.nan_to_num((points - last[before]) / elapsed_s)
            self._velocities = velocities + _S.gain * (moved - velocities)
        self._points, self._time_s, self._costs = points, time_s, costs - costs.min()
        return np.asarray(self._choices[np.argmin(self._costs)]), before

    def _seen(self, own: Array, other: Array, last: Array | None) -> tuple[Array, Array]:
        """Return where each hypothesis has the points (H, n, D) now, and the evidence against it (H,).

        Args:
            own: Normalised coordinates (C, n, 2) of the points, NaN where not found.
            other: Those of their counterparts.
            last: Where each hypothesis had the points; None if nothing is known of the past.
        """
        wrong, exchanged = self._choices == _WRONG, self._choices == _EXCHANGED
        seen = np.where(exchanged[..., None, None], other, own)  # (H, C, n, 2)
        seen[wrong] = np.nan
        points, costs = self._located(seen)
        found = np.isfinite(own[..., 0])  # (C, n)
        costs = costs + _S.rare * np.count_nonzero(exchanged & found.any(axis=1), axis=1)
        costs += np.log1p(_S.missed**2) * wrong @ np.count_nonzero(found, axis=1)
        one_is_wrong = wrong.any(axis=1)
        if last is None:  # nothing tells which camera is wrong
            costs[one_is_wrong] = np.inf
        elif one_is_wrong.any():
            points[one_is_wrong] = self._kept(points, seen, last[np.argmin(self._costs)])[one_is_wrong]
        return points, costs

    def _kept(self, points: Array, seen: Array, last_m: Array) -> Array:
        """Return points (H, n, 3), unknown ones as near to the last ones (n, 3) as their rays (H, C, n, 2) allow."""
        nearest_m = np.broadcast_to(last_m, points.shape)
        for camera, rows in zip(self._cameras, np.swapaxes(seen, 0, 1), strict=True):
            rays = camera.rays(rows)
            along_m = np.sum(rays * (last_m - camera.centre_m), axis=-1, keepdims=True)
            nearest_m = np.where(np.isfinite(rays), camera.centre_m + along_m * rays, nearest_m)
        return np.where(np.isfinite(points), points, nearest_m)

    def trace(self, before: Sequence[IntArray]) -> IntArray:
        """Return what the pictures show (F, C) by the likeliest course (Viterbi 1967), given all predecessors."""
        chosen = [int(np.argmin(self._costs))]
        for predecessors in reversed(before[1:]):
            chosen.append(int(predecessors[chosen[-1]]))
        return self._choices[chosen[::-1]]

    def _located(self, seen: Array) -> tuple[Array, Array]:
        """Return points (H, n, D) from rays (H, C, n, 2), and costs (H,) of rays that do not meet.

        A single camera gives points in its image plane.
        """
        count, cameras, points = seen.shape[:3]
        if cameras == 1:
            return _S.usual_m * seen[:, 0], np.zeros(count)
        rays = np.swapaxes(seen, 1, 2).reshape(-1, cameras, 2)
        weights = np.isfinite(rays[..., 0]).astype(np.float64)
        several = np.flatnonzero(weights.sum(axis=1) >= 2)
        located, costs = np.full((len(rays), 3), np.nan), np.zeros(len(rays))
        if len(several):
            found, _, errors_px = triangulate(self._cameras, rays[several], weights[several], 1.0)
            depths_m = np.stack([camera.to_camera(found)[:, 2] for camera in self._cameras], axis=1)
            errors_m = errors_px * depths_m / np.array([camera.focal_px for camera in self._cameras])
            located[several] = found
            costs[several] = 0.5 * np.log1p((errors_m / _S.ray_m) ** 2).sum(axis=1)
        return located.reshape(count, points, 3), costs.reshape(count, points).sum(axis=1)
