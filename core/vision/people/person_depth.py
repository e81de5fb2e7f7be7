"""Depth of a person whom a single camera sees.

The network also gives the points in space, about the hips and with rough depths. Placed on the rays, they show how far
away a person of average size is: its errors are about 3 %. If the floor is known, the size is that of a person whose
lower foot stands on it (the mean over a second, so that a jump hardly counts).
"""

import math
from dataclasses import dataclass

import numpy as np

from ...body.body_parts import FOOT_JOINTS
from ...body.standard_skeleton import default_skeleton
from ...geometry.arrays import Array, IntArray
from ...geometry.camera import Camera
from ...markers.floor_from_feet import usual_heights
from ...markers.marker_set import MarkerSet
from .body_network import FoundPerson


@dataclass(frozen=True)
class DepthSettings:
    """Settings of `PersonDepth`."""

    at_joint_m: float = 0.02  # largest usual offset of a point that stands for its joint
    size_s: float = 1.0  # time constant of the size that the floor shows
    most_change: float = 0.05  # largest logarithm of a change of size that counts in one picture


_S = DepthSettings()


class AveragePerson:
    """Distances of the points of a person of average size.

    Args:
        points: The network's K points.
    """

    def __init__(self, points: MarkerSet) -> None:
        skeleton = default_skeleton()
        at = {
            marker.joint: index
            for index, marker in enumerate(points.markers)
            if marker.offset_m is not None and np.linalg.norm(marker.offset_m) < _S.at_joint_m
        }
        bones = [
            (at[parent], at[joint], float(np.linalg.norm(skeleton.offsets_m[skeleton.index(joint)])))
            for joint in at
            if (parent := skeleton.names[skeleton.parents[skeleton.index(joint)]]) in at
        ]
        self._ends = np.array([bone[:2] for bone in bones], dtype=np.int64)
        self._bones_m = sum(bone[2] for bone in bones)

    def depths_m(self, camera: Camera, person: FoundPerson) -> Array:
        """Return the points' distances (K,) along the camera's axis."""
        rays, points_m = camera.undistort(person.pixels), person.points_m
        # x + t_x = u (z + t_z), and the same for y
        rows = np.zeros((len(rays), 2, 3))
        rows[:, 0, 0] = rows[:, 1, 1] = 1.0
        rows[:, :, 2] = -rays
        wanted = rays * points_m[:, 2:] - points_m[:, :2]
        shift_m = np.linalg.lstsq(rows.reshape(-1, 3), wanted.ravel(), rcond=None)[0]
        ends_m = points_m[self._ends]
        network_m = float(np.linalg.norm(ends_m[:, 1] - ends_m[:, 0], axis=1).sum())
        return np.asarray((points_m[:, 2] + shift_m[2]) * self._bones_m / max(network_m, 1e-9))


class PersonDepth:
    """Places the points of a single camera's person on their rays.

    Args:
        points: The network's K points.
        floor_m: Height of the floor in the camera's world; None if unknown.
    """

    def __init__(self, camera: Camera, points: MarkerSet, floor_m: float | None) -> None:
        self._camera, self._floor_m = camera, floor_m
        self._feet = np.array([marker.joint in FOOT_JOINTS for marker in points.markers])
        self._heights_m = usual_heights(points, default_skeleton())
        self._size: float | None = None  # logarithm of the size that the floor shows, relative to the average
        self._time_s = 0.0

    def place(self, time_s: float, labels: IntArray, rays: Array, depths_m: Array) -> Array:
        """Return the points (N, 3) in the world.

        Args:
            labels: The points, indices (N,) in the network's order.
            rays: Their undistorted normalised coordinates (N, 2).
            depths_m: Their distances (N,) along the camera's axis for a person of average size.
        """
        local = np.column_stack((rays, np.ones(len(rays)))) * depths_m[:, None]
        from_camera_m = local @ self._camera.rotation
        feet = self._feet[labels]
        if self._floor_m is not None and feet.any():
            above_m = float(self._camera.centre_m[1]) - self._floor_m
            lowest_m = float((from_camera_m[:, 1] - self._heights_m[labels])[feet].min())
            if above_m > 0.0 > lowest_m:
                self._average(time_s, math.log(above_m / -lowest_m))
        return np.asarray(self._camera.centre_m + math.exp(self._size or 0.0) * from_camera_m)

    def _average(self, time_s: float, size: float) -> None:
        if self._size is None:
            self._size = size
        share = -math.expm1(-abs(time_s - self._time_s) / _S.size_s)
        self._size += share * min(max(size - self._size, -_S.most_change), _S.most_change)
        self._time_s = time_s
