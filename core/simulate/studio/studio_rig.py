"""Rig of simulated cameras."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...errors import SettingsError
from ...geometry.arrays import Array
from ...geometry.camera import Camera, CameraRig

IMAGE_SIZE = (640, 480)
FPS = 60.0

# webcams of the same make differ slightly: focal lengths, centre (pixels), k1, k2, p1, p2, k3
_LENSES: tuple[tuple[float, float, float, float, tuple[float, ...]], ...] = (
    (541.3, 540.6, 322.7, 236.9, (-0.118, 0.071, 0.0006, -0.0004, -0.012)),
    (537.8, 538.9, 316.1, 242.6, (-0.109, 0.058, -0.0005, 0.0007, -0.009)),
    (544.9, 543.7, 319.2, 240.8, (-0.124, 0.080, 0.0002, 0.0005, -0.015)),
    (539.5, 540.2, 324.3, 238.1, (-0.113, 0.064, -0.0003, -0.0006, -0.010)),
)


@dataclass(frozen=True)
class StudioPlacement:
    """Positions of the simulated cameras in the world, metres."""

    half_baseline_m: float = 0.9
    distance_m: float = 3.3
    height_m: float = 1.4
    rise_m: float = 0.3  # distance of each camera from `height_m`, below and above in turn
    target_m: tuple[float, float, float] = (0.0, 0.98, 0.0)


_PLACED = StudioPlacement()


def looking_at(position_m: ArrayLike, target_m: ArrayLike) -> Array:
    """Return camera-from-world (3, 3) of a level camera that looks at a target not directly below or above it."""
    position = np.asarray(position_m, dtype=np.float64)
    forward = np.asarray(target_m, dtype=np.float64) - position
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 1.0, 0.0))
    right = right / np.linalg.norm(right)
    return np.stack((right, np.cross(forward, right), forward))


def default_rig(cameras: int = 2) -> CameraRig:
    """Return the simulated rig: 640x480 pixels, cameras 1.8 m apart, 3.3 m from the performer and 1.4 m high.

    The performer stands at the world's origin on the floor y = 0 and faces +z, towards the cameras. Two cameras are
    named "left" and "right", as seen from behind them; more stand on a circle around the performer. Neighbours stand at
    different heights, because markers at the same height (both shoulders, both sides of the waist) lie on one epipolar
    line of level cameras and can be confused.

    Raises:
        SettingsError: There are fewer than one or more than eight cameras.
    """
    if not 1 <= cameras <= 8:
        raise SettingsError(f"there cannot be {cameras} simulated cameras", advice="give a number from 1 to 8")
    if cameras <= 2:
        half = float(np.sqrt(_PLACED.half_baseline_m**2 - _PLACED.rise_m**2))
        places = [
            (-half, _PLACED.height_m - _PLACED.rise_m, _PLACED.distance_m),
            (half, _PLACED.height_m + _PLACED.rise_m, _PLACED.distance_m),
        ][:cameras]
    else:
        reach = 1.1 * float(np.hypot(_PLACED.half_baseline_m, _PLACED.distance_m))
        angles = np.radians(np.linspace(-1.0, 1.0, cameras) * min(15.0 * (cameras - 1), 75.0))
        heights = [_PLACED.height_m + (_PLACED.rise_m if i % 2 else -_PLACED.rise_m) for i in range(cameras)]
        places = [
            (reach * float(np.sin(angle)), height, reach * float(np.cos(angle)))
            for angle, height in zip(angles, heights, strict=True)
        ]
    names = ["left", "right"] if cameras == 2 else [f"camera{i + 1}" for i in range(cameras)]
    lenses = [_LENSES[i % len(_LENSES)] for i in range(cameras)]
    made = tuple(_camera(*row) for row in zip(names, places, lenses, strict=True))
    return CameraRig(made, {"source": "simulated studio", "fps": FPS})


def _camera(
    name: str, place: tuple[float, float, float], lens: tuple[float, float, float, float, tuple[float, ...]]
) -> Camera:
    fx, fy, cx, cy, distortion = lens
    rotation = looking_at(place, _PLACED.target_m)
    return Camera(
        name=name,
        image_size=IMAGE_SIZE,
        matrix=np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]),
        distortion=np.array(distortion),
        rotation=rotation,
        translation_m=-rotation @ np.array(place),
    )
