"""The world's floor, origin and axes from the board lying on the floor."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera import Camera, CameraRig
from ..errors import CalibrationError

Array = NDArray[np.float64]

_FLATNESS_M = 0.01  # corners further off their plane than this are no corners of a flat board


def rig_on_floor(rig: CameraRig, floor_points_m: ArrayLike, behind_m: float = 0.0) -> CameraRig:
    """Return the rig in a world whose floor is y = 0.

    z points from the middle of the floor points to between the cameras, x to the performer's left as they face the
    cameras, y up. The origin lies `behind_m` behind that middle as the cameras see it, where the performer stands.

    Args:
        rig: cameras in any world.
        floor_points_m: (N, 3) points of the floor in that world, N >= 3, not on a line.
        behind_m: from the middle of the points to the origin, away from the cameras.

    Raises:
        CalibrationError: the points are no plane, or the cameras look at it from straight above.
    """
    points = np.asarray(floor_points_m, dtype=np.float64)
    if len(points) < 3:
        raise CalibrationError("three points are needed to find the floor", advice="lay the board on the floor")
    middle = points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(points - middle)
    if sizes[2] / np.sqrt(len(points)) > _FLATNESS_M or sizes[1] < 1e-3 * sizes[0]:
        raise CalibrationError("the points of the floor do not lie in one plane", advice="lay the board flat again")
    centre = np.mean([camera.centre_m for camera in rig.cameras], axis=0)
    up = axes[2] if axes[2] @ (centre - middle) > 0 else -axes[2]  # the cameras are above the floor
    forward = (centre - middle) - up * (up @ (centre - middle))
    if np.linalg.norm(forward) < 0.05:
        raise CalibrationError("the cameras look straight down on the board", advice="lay the board where you stand")
    forward /= np.linalg.norm(forward)
    new_from_old = np.stack((np.cross(up, forward), up, forward))
    origin = middle - behind_m * forward
    cameras = tuple(_moved(camera, new_from_old, origin) for camera in rig.cameras)
    return CameraRig(cameras, dict(rig.metadata) | {"floor": "y = 0"})


def _moved(camera: Camera, new_from_old: Array, origin: Array) -> Camera:
    """Return the camera in the world p_new = new_from_old (p_old - origin)."""
    rotation = camera.rotation @ new_from_old.T
    translation = camera.translation_m + camera.rotation @ origin
    return Camera(camera.name, camera.image_size, camera.matrix, camera.distortion, rotation, translation)
