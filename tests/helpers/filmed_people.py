"""A performer's keypoints as a body network would find them in the pictures of cameras."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from perfanim.core.body.motion import Motion
from perfanim.core.geometry.arrays import Array, Image
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.markers.exchanged_throughout import other_sides
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.vision.people.body_network import Crop, FoundPerson
from perfanim.core.vision.sources.image_set import ImageSet

POINTS = load_marker_set("blazepose-33")
OTHERS = other_sides(POINTS.markers)
NOWHERE = np.zeros((len(POINTS), 3))


@dataclass
class FakeNetwork:
    """Finds the points of `pixels` whose picture it is given: a picture's first bytes are its number.

    A crop shows the person if it contains the middle of the points and is neither too large nor too small.
    """

    pixels: dict[int, Array]  # (K, 2) by the number of the picture
    points_m: dict[int, Array] = field(default_factory=dict)  # (K, 3) in the camera's axes
    marker_set: str = POINTS.name
    score: float = 0.9  # of the person
    calls: int = 0

    def find(self, image: Image, crop: Crop) -> FoundPerson:
        self.calls += 1
        number = int.from_bytes(image[0, 0].tobytes(), "little")
        pixels = self.pixels.get(number)
        if pixels is None:
            return FoundPerson(np.zeros((len(POINTS), 2)), NOWHERE, np.ones(len(POINTS)), 0.0, crop)
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        x, y = 0.5 * (low + high)
        side = 1.3 * float((high - low).max())
        shows = max(abs(crop.x_px - x), abs(crop.y_px - y)) < 0.3 * side and 0.5 < crop.side_px / side < 3.0
        points_m = self.points_m.get(number, NOWHERE)
        return FoundPerson(pixels, points_m, np.ones(len(POINTS)), self.score if shows else 0.1, Crop(x, y, side))


def picture(number: int, width: int = 640, height: int = 480) -> Image:
    """Return a picture that `FakeNetwork` knows by its number."""
    image = np.zeros((height, width, 3), dtype=np.uint8)
    image[0, 0] = np.frombuffer(number.to_bytes(3, "little"), dtype=np.uint8)
    return image


def moments(rig: CameraRig, count: int, fps: float = 30.0) -> list[ImageSet]:
    """Return image sets of these cameras; picture n of camera c has the number 10 n + c."""
    sizes = [camera.image_size for camera in rig.cameras]
    return [
        ImageSet(n, (n / fps,) * len(sizes), tuple(picture(10 * n + c, *size) for c, size in enumerate(sizes)))
        for n in range(count)
    ]


def keypoints(motion: Motion) -> Array:
    """Return the true keypoints (F, K, 3) of a motion."""
    return simulate_markers(motion, POINTS)[0].positions_m


def networks(rig: CameraRig, points_m: Array, noise_px: float = 0.0, seed: int = 0) -> list[FakeNetwork]:
    """Return a network for each camera that finds the points (F, K, 3) of each picture, with noise."""
    random = np.random.default_rng(seed)
    return [
        FakeNetwork({
            10 * n + c: camera.project(row) + random.normal(0.0, noise_px, (len(row), 2)) if noise_px
            else camera.project(row) for n, row in enumerate(points_m)
        }, {10 * n + c: camera.to_camera(row) for n, row in enumerate(points_m)})
        for c, camera in enumerate(rig.cameras)
    ]  # fmt: skip


def write_film(path: Path, numbers: Sequence[int], fps: float = 30.0, size: tuple[int, int] = (640, 480)) -> Path:
    """Write a video, without loss, of the pictures with these numbers."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"FFV1"), fps, size)
    for number in numbers:
        writer.write(picture(number, *size))
    writer.release()
    return path


def one_network(rig: CameraRig, points_m: Array) -> FakeNetwork:
    """Return a network that finds the points (F, K, 3) in the pictures of all cameras (see `moments`)."""
    both = FakeNetwork({})
    for each in networks(rig, points_m):
        both.pixels |= each.pixels
        both.points_m |= each.points_m
    return both
