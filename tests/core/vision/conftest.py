"""A rig and simple pictures with known truth."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import WORLD_FROM_CAMERA, Camera, CameraRig

Array = NDArray[np.float64]
SIZE = (640, 480)
OVERSAMPLING = 8


def _camera(name: str, x_m: float, toe_in: float, distortion: Sequence[float]) -> Camera:
    turn = rot.to_matrix(rot.from_rotation_vector(np.array([0.01, toe_in, 0.005])))
    rotation = turn @ WORLD_FROM_CAMERA
    matrix = np.array([[620.0, 0.0, 322.0], [0.0, 618.0, 236.0], [0.0, 0.0, 1.0]])
    centre = np.array([x_m, 0.01 * x_m, 0.0])
    return Camera(name, SIZE, matrix, np.array(distortion), rotation, -rotation @ centre)


@pytest.fixture
def rig() -> CameraRig:
    """Two toed-in cameras, 1 m apart; the first is not at the world's origin nor level."""
    left = _camera("left", -0.5, -0.12, [-0.12, 0.05, 0.001, -0.0005, 0.0])
    right = _camera("right", 0.5, 0.15, [-0.09, 0.02, -0.001, 0.001, 0.0])
    return CameraRig((left, right))


def _disc(image: Array, centre: Array, radius: float, level: Array) -> None:
    height, width = image.shape[:2]
    left, right = max(0, int(centre[0] - radius - 3)), min(width, int(centre[0] + radius + 4))
    top, bottom = max(0, int(centre[1] - radius - 3)), min(height, int(centre[1] + radius + 4))
    if left >= right or top >= bottom:
        return
    offsets = (np.arange(OVERSAMPLING) + 0.5) / OVERSAMPLING - 0.5
    xs = (np.arange(left, right)[:, None] + offsets).ravel() - centre[0]
    ys = (np.arange(top, bottom)[:, None] + offsets).ravel() - centre[1]
    inside = (xs[None] ** 2 + ys[:, None] ** 2 <= radius**2).astype(np.float64)
    cover = inside.reshape(bottom - top, OVERSAMPLING, right - left, OVERSAMPLING).mean(axis=(1, 3))[..., None]
    image[top:bottom, left:right] = image[top:bottom, left:right] * (1.0 - cover) + cover * level


@pytest.fixture
def draw() -> Callable[..., NDArray[np.uint8]]:
    """Draw discs: draw(centres (n, 2), radius, level=200, noise=2, background=20, seed=0) -> image."""

    def picture(
        centres: Array,
        radius: float,
        level: float | Array = 200.0,
        noise: float = 2.0,
        background: float | Array = 20.0,
        seed: int = 0,
    ) -> NDArray[np.uint8]:
        image = np.zeros((SIZE[1], SIZE[0], 3)) + background
        for centre in centres:
            _disc(image, centre, radius, np.broadcast_to(np.asarray(level, dtype=np.float64), (3,)))
        noisy = image + np.random.default_rng(seed).normal(0.0, noise, image.shape)
        return np.clip(np.round(noisy), 0, 255).astype(np.uint8)

    return picture
