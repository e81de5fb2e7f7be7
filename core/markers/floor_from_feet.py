"""Estimation of the floor from planted feet, for captures without a board on the floor."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..body.body_parts import FOOT_JOINTS
from ..body.calibration_poses import standing
from ..body.skeleton import Skeleton, forward_kinematics
from ..body.standard_skeleton import default_skeleton
from ..body.window_filters import smallest
from ..errors import TakeError
from ..geometry import rotations as rot
from ..geometry.arrays import Array, evenly
from ..geometry.camera import CameraRig
from ..geometry.rigid_transform import mean_vertical, transform
from .filtering import smooth_take
from .marker_set import MarkerSet
from .marker_take import MarkerTake
from .steady_take import frame_times


@dataclass(frozen=True)
class FloorSettings:
    """Settings of `floor_points`."""

    sole_m: float = 0.02  # height of a standing foot's lowest joint above the floor
    smoothing_hz: float = 5.0  # cut-off of the trajectories
    still_m_s: float = 0.25  # speed below which a marker on a foot may be at rest
    low_m: float = 0.04  # height above a marker's lowest position within a second below which it may be at rest
    fewest_s: float = 0.5  # shortest time at rest, summed over the markers, that determines the floor
    lean_rad: float = math.radians(3.0)  # standard deviation of the lean of a performer's mean vertical
    height_sigma_m: float = 0.01  # standard deviation of a resting marker's height
    frames_per_stand: float = 10.0  # number of successive frames with nearly the same error
    trimmed: float = 3.0  # deviation from the plane, in median deviations, above which a point is an outlier
    trim_rounds: int = 5
    fewest: int = 4  # fewest markers in a frame that determine the vertical
    upright_samples: int = 60  # number of frames used to find the vertical


_S = FloorSettings()


def floor_points(take: MarkerTake, marker_set: MarkerSet, pose: Callable[[Skeleton], Array] = standing) -> Array:
    """Return four points (4, 3) of the floor, around the area where the performer moved.

    Markers on planted feet are as high above the floor as on a standing person. A plane is fitted to the points below
    them. Its prior is the performer's mean vertical, which matters if the feet were planted nearly on a line.

    Args:
        take: Labelled take in any world, in which the performer stands or walks.
        marker_set: Marker set with usual offsets and markers on the feet.
        pose: Returns the rotations (J, 4) of the performer's average pose, which is upright.

    Raises:
        TakeError: There are no markers on the feet, or no foot stays planted long enough.
        MarkerSetError: The set lacks offsets.
    """
    skeleton = default_skeleton()
    upright = _upright_rotation(take, marker_set, skeleton, pose(skeleton))
    calm = smooth_take(take, min(_S.smoothing_hz, 0.2 * take.fps))
    stands = _stance_points(calm, marker_set, skeleton, upright)
    if len(stands) < _S.fewest_s * take.fps:
        raise TakeError(
            "no foot stays planted long enough to find the floor", where=take.name, advice="lay the board on the floor"
        )
    return _plane(stands, upright)


def to_rig_world(take: MarkerTake, old: CameraRig, new: CameraRig) -> MarkerTake:
    """Return a take in the world of a new rig with the same cameras."""
    before, after = old.cameras[0], new.cameras[0]
    rotation = after.rotation.T @ before.rotation
    translation = after.rotation.T @ (before.translation_m - after.translation_m)
    single = replace(take.single, rig=new) if take.single is not None else None
    return replace(take, positions_m=transform(rotation, translation, take.positions_m), single=single)


def _upright_rotation(take: MarkerTake, marker_set: MarkerSet, skeleton: Skeleton, pose: Array) -> Array:
    """Return the world-from-level rotation (3, 3), level according to the body's mean vertical."""
    template = marker_set.positions_on(skeleton, pose)
    frames = evenly(take.frames, _S.upright_samples)
    up = mean_vertical(template, take.positions_m[frames][:, _columns(take, marker_set)], _S.fewest)
    if np.linalg.norm(up) < 1e-6:
        raise TakeError(
            "too few markers are seen at once to find the floor",
            where=take.name,
            advice="record with more markers in view, or lay the board on the floor",
        )
    return rot.to_matrix(rot.between([0.0, 1.0, 0.0], up))


def _columns(take: MarkerTake, marker_set: MarkerSet) -> list[int]:
    missing = [name for name in marker_set.names if name not in take.names]
    if missing:
        raise TakeError(
            "has no marker " + ", ".join(missing), where=take.name, advice="choose the marker set that was worn"
        )
    return [take.names.index(name) for name in marker_set.names]


def _stance_points(take: MarkerTake, marker_set: MarkerSet, skeleton: Skeleton, upright: Array) -> Array:
    """Return points (N, 3) of the floor in the level frame, below the markers of planted feet."""
    columns, radius = _columns(take, marker_set), round(take.fps)
    heights, times_s = usual_heights(marker_set, skeleton), frame_times(take)
    found = []
    for marker, item in enumerate(marker_set.markers):
        if item.joint not in FOOT_JOINTS:
            continue
        path = take.positions_m[:, columns[marker]] @ upright
        speed = np.linalg.norm(np.gradient(path, times_s, axis=0), axis=1) if len(path) > 1 else np.zeros(1)
        height = np.where(np.isfinite(path[:, 1]), path[:, 1], np.inf)
        low = height < smallest(height, radius) + _S.low_m  # false where the marker is hidden
        resting = (speed < _S.still_m_s) & low
        found.append(path[resting] - [0.0, heights[marker], 0.0])
    if not found:
        raise TakeError(
            f"the marker set {marker_set.name} has no marker on the feet", advice="lay the board on the floor"
        )
    return np.concatenate(found)


def usual_heights(marker_set: MarkerSet, skeleton: Skeleton) -> Array:
    """Return the heights (M,) of the markers above the floor on a standing person."""
    positions, _ = forward_kinematics(skeleton, standing(skeleton), np.zeros(3))
    markers = marker_set.positions_on(skeleton, standing(skeleton))
    floor = min(positions[skeleton.index(name), 1] for name in FOOT_JOINTS) - _S.sole_m
    return np.asarray(markers[:, 1] - floor)


def _plane(stands: Array, upright: Array) -> Array:
    """Return four points (4, 3), in world axes, of the plane fitted to points (N, 3) in the level frame."""
    kept = np.ones(len(stands), dtype=bool)
    for _ in range(_S.trim_rounds):
        middle = stands[kept].mean(axis=0)
        rows = np.column_stack((stands[:, 0] - middle[0], stands[:, 2] - middle[2], np.ones(len(stands))))
        weight = 1.0 / (_S.height_sigma_m**2 * _S.frames_per_stand)
        normal = weight * rows[kept].T @ rows[kept] + np.diag([_S.lean_rad**-2, _S.lean_rad**-2, 0.0])
        plane = np.linalg.solve(normal, weight * rows[kept].T @ stands[kept, 1])
        error = np.abs(stands[:, 1] - rows @ plane)
        kept = error <= _S.trimmed * max(float(np.median(error)), 1e-4)
    corners = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    height = corners @ plane[:2] + plane[2]
    level = np.column_stack((middle[0] + corners[:, 0], height, middle[2] + corners[:, 1]))
    return np.asarray(level @ upright.T)
