"""Networks that find the points of a person in a picture, and their files."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import cv2
import numpy as np

from ...geometry.arrays import Array, Image
from .network_file import read_network

_SPATIAL = 3  # values of each point of the output in space: x, y, z
_INPUT_PX = 256  # side of the network's input
_POINTS, _VALUES = 39, 5  # points of the output, the body's 33 first, and x, y, z, visibility, presence of each
_BODY_POINTS, _CENTRE, _TOP = 33, 33, 34  # number of points of the body; points that give the next crop
_MARGIN = 2.5  # side of the next crop, in units of the distance between these two points


class Crop(NamedTuple):
    """Square part of a picture in which a person stands upright."""

    x_px: float  # centre
    y_px: float
    side_px: float
    turn_rad: float = 0.0  # clockwise turn of the person in the picture


@dataclass(frozen=True)
class FoundPerson:
    """What a network finds in a crop.

    Args:
        pixels: Points (K, 2) of the person in the picture, pixels.
        points_m: Points (K, 3) about the hips, x to the right, y down and z away from the camera, of a body of the size
            that the network assumes, metres. The depths are rough.
        visibilities: Probabilities (K,) that the points are not hidden.
        score: Probability that the crop shows a person.
        crop: Crop round the person, for the next picture.
    """

    pixels: Array
    points_m: Array
    visibilities: Array
    score: float
    crop: Crop


class BodyNetwork(Protocol):
    """Interface of body networks.

    Attributes:
        marker_set: Name of the marker set whose keypoints it finds, in this order.
    """

    marker_set: str

    def find(self, image: Image, crop: Crop) -> FoundPerson:
        """Return the person in a crop of a picture (H, W, 3), BGR, uint8."""


class BlazePose:
    """BlazePose GHUM, MediaPipe's network for the pose of one person (Bazarevsky et al. 2020), run by OpenCV.

    Raises:
        CaptureError: The file is missing, damaged or another network.
    """

    marker_set = "blazepose-33"

    def __init__(self, path: Path) -> None:
        self._network = cv2.dnn.readNetFromTFLite(np.frombuffer(read_network(path), dtype=np.uint8))
        self._outputs = self._network.getUnconnectedOutLayersNames()

    def find(self, image: Image, crop: Crop) -> FoundPerson:
        """Return the person in a crop of a picture (H, W, 3), BGR, uint8."""
        scale = crop.side_px / _INPUT_PX
        turn = scale * np.array(
            ((np.cos(crop.turn_rad), -np.sin(crop.turn_rad)), (np.sin(crop.turn_rad), np.cos(crop.turn_rad)))
        )
        corner = np.array((crop.x_px, crop.y_px)) - turn @ np.full(2, 0.5 * _INPUT_PX)
        to_picture = np.column_stack((turn, corner))
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        part = cv2.warpAffine(image, to_picture, (_INPUT_PX, _INPUT_PX), flags=flags)
        self._network.setInput(cv2.dnn.blobFromImage(part, 1.0 / 255.0, swapRB=True))
        found = self._network.forward(self._outputs)
        points = next(each for each in found if each.size == _POINTS * _VALUES).reshape(_POINTS, _VALUES)
        space = next(each for each in found if each.size == _POINTS * _SPATIAL).reshape(_POINTS, _SPATIAL)
        points_m = space[:_BODY_POINTS].astype(np.float64)
        points_m[:, :2] = points_m[:, :2] @ (turn / scale).T
        score = float(next(each for each in found if each.size == 1).item())
        pixels = points[:, :2].astype(np.float64) @ turn.T + corner
        upwards = pixels[_TOP] - pixels[_CENTRE]
        turned = float(np.arctan2(upwards[0], -upwards[1]))
        x, y = pixels[_CENTRE].tolist()
        next_crop = Crop(x, y, _MARGIN * float(np.hypot(*upwards)), turned)
        visibilities = 0.5 * (1.0 + np.tanh(0.5 * points[:_BODY_POINTS, 3].astype(np.float64)))  # from logits
        return FoundPerson(pixels[:_BODY_POINTS], points_m, visibilities, score, next_crop)
