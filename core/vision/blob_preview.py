"""Preview of detected blobs and marker labels during a capture."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array, Image, Mask
from ..geometry.camera import CameraRig
from ..markers.marker_frame import MarkerFrame
from .detection.blob_detector import ignored_radius_px

Colour = tuple[int, int, int]

_POINT: Colour = (80, 255, 80)  # BGR, as all in `draw_blobs`
_SINGLE: Colour = (60, 170, 255)
_OTHER: Colour = (80, 80, 255)
_LINE: Colour = (40, 110, 165)
_TEXT: Colour = (255, 255, 255)
_HIDDEN: Colour = (150, 150, 150)
_IGNORED: Colour = (200, 200, 200)
_MARGIN_PX = 3.0
_LINE_M = np.geomspace(0.5, 12.0, 24)  # distances from the other camera that a line is drawn through: lenses bend it


def draw_blobs(
    frame: MarkerFrame, thresholds: Sequence[float], rig: CameraRig, camera: int, picture: Image, image_width: int
) -> None:
    """Ring detected blobs in a camera's reduced picture (BGR), in place.

    Green: seen by another camera as well; orange: by this one alone; red: taken for no marker. Where a marker must be
    that another camera sees alone, a line is drawn (its epipolar line). Ignored places have a cross.
    """
    write_line(picture, f"threshold {thresholds[camera]:.0f}")
    cross_out(rig.cameras[camera].ignored_px.tolist(), picture, image_width)
    scale = picture.shape[1] / image_width
    for other, seen in zip(frame.single_cameras.tolist(), frame.single_points, strict=True):
        if other != camera:
            source = rig.cameras[other]
            along = source.centre_m + _LINE_M[:, None] * source.rays(seen)
            line = _in_picture(rig.cameras[camera].project(along), scale, picture)
            cv2.polylines(picture, [line], False, _LINE, 1, cv2.LINE_AA)
    in_space = set(frame.point_blobs[:, camera].tolist())
    alone = set(frame.single_blobs[frame.single_cameras == camera].tolist())
    for index, (x, y, radius) in enumerate(frame.detected[camera][:, :3].tolist()):
        colour = _POINT if index in in_space else _SINGLE if index in alone else _OTHER
        cv2.circle(
            picture, reduced((x, y), picture, image_width), round(radius * scale + _MARGIN_PX), colour, 1, cv2.LINE_AA
        )


def cross_out(places: Sequence[Sequence[float]], picture: Image, image_width: int) -> None:
    """Draw a cross on each ignored place of a camera's reduced picture."""
    side = round(2.0 * ignored_radius_px(image_width) * picture.shape[1] / image_width) + 4
    for place in places:
        centre = reduced(place, picture, image_width)
        cv2.drawMarker(picture, centre, _IGNORED, cv2.MARKER_TILTED_CROSS, side, 1, cv2.LINE_AA)


def reduced(place: Sequence[float], picture: Image, image_width: int) -> tuple[int, int]:
    """Return the pixel of a reduced picture that shows a place of its image."""
    scale = picture.shape[1] / image_width
    return round((place[0] + 0.5) * scale - 0.5), round((place[1] + 0.5) * scale - 0.5)


def write_line(picture: Image, text: str) -> None:
    """Write a text into the lower left corner of a camera's reduced picture."""
    place = (6, picture.shape[0] - 8)
    cv2.putText(picture, text, place, cv2.FONT_HERSHEY_PLAIN, 0.9, _TEXT, 1, cv2.LINE_AA)


def draw_labels(names: Sequence[str], markers_m: Array, seen: Mask, rig: CameraRig, pictures: Image) -> Image:
    """Return the cameras' reduced pictures with the markers' names.

    Args:
        markers_m: (M, 3) of the body that is followed.
        seen: (M,) which were labelled; the names of the others are grey.
    """
    result = pictures.copy()
    width = result.shape[1] // len(rig)
    for number, camera in enumerate(rig.cameras):
        picture = result[:, number * width : (number + 1) * width]
        own = np.ascontiguousarray(picture)
        scale = width / camera.image_size[0]
        for name, pixel, is_seen in zip(names, camera.project(markers_m), seen.tolist(), strict=True):
            if np.all(np.isfinite(pixel)) and np.all((pixel >= 0.0) & (pixel < camera.image_size)):
                place = (round(pixel[0] * scale) + 5, round(pixel[1] * scale) - 4)
                colour = _TEXT if is_seen else _HIDDEN
                cv2.putText(own, name, place, cv2.FONT_HERSHEY_PLAIN, 0.6, colour, 1, cv2.LINE_AA)
        picture[:] = own
    return result


def _in_picture(pixels: Array, scale: float, picture: Image) -> NDArray[np.int32]:
    """Return visible points (N, 2) of a line for drawing."""
    reach = 4.0 * max(picture.shape)
    points = (pixels + 0.5) * scale - 0.5
    near = np.all(np.isfinite(points), axis=1) & np.all(np.abs(points) < reach, axis=1)
    return np.rint(points[near]).astype(np.int32).reshape(-1, 1, 2)
