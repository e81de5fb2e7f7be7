"""What the cameras see of the markers, to be shown during a capture."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ..marker_frame import MarkerFrame

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

_POINT: Colour = (80, 255, 80)  # BGR, as all here
_SINGLE: Colour = (60, 170, 255)
_OTHER: Colour = (80, 80, 255)
_TEXT: Colour = (255, 255, 255)
_MARGIN_PX = 3.0


def draw_blobs(frame: MarkerFrame, thresholds: Sequence[float], camera: int, picture: Image, image_width: int) -> None:
    """Ring what was detected in a camera's image in the reduced picture of it (BGR), in place; tell its threshold.

    Green: seen by another camera as well; orange: by this one alone; red: taken for no marker.
    """
    place = (6, picture.shape[0] - 8)
    cv2.putText(
        picture, f"threshold {thresholds[camera]:.0f}", place, cv2.FONT_HERSHEY_PLAIN, 0.9, _TEXT, 1, cv2.LINE_AA
    )
    scale = picture.shape[1] / image_width
    in_space = set(frame.point_blobs[:, camera].tolist())
    alone = set(frame.single_blobs[frame.single_cameras == camera].tolist())
    for index, (x, y, radius) in enumerate(frame.detected[camera][:, :3].tolist()):
        colour = _POINT if index in in_space else _SINGLE if index in alone else _OTHER
        centre = (round((x + 0.5) * scale - 0.5), round((y + 0.5) * scale - 0.5))
        cv2.circle(picture, centre, round(radius * scale + _MARGIN_PX), colour, 1, cv2.LINE_AA)
