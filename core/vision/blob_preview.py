"""Preview of detected blobs and marker labels during a capture."""

from collections.abc import Sequence

import cv2
import numpy as np

from ..geometry.arrays import Array, Image, Mask
from ..geometry.camera import CameraRig
from ..markers.marker_frame import MarkerFrame
from .detection.blob_detector import ignored_radius_px

# colours are BGR
_GREEN, _ORANGE, _RED, _BROWN = (80, 255, 80), (60, 170, 255), (80, 80, 255), (40, 110, 165)
_WHITE, _LIGHT, _GREY = (255, 255, 255), (200, 200, 200), (150, 150, 150)


def draw_blobs(
    frame: MarkerFrame, thresholds: Sequence[float], rig: CameraRig, camera: int, picture: Image, image_width: int
) -> None:
    """Draw rings around detected blobs in a camera's reduced picture (BGR), in place.

    A ring is green if another camera sees the blob, too, orange if only this one sees it, and red if the blob is
    rejected as a marker. A blob that only another camera sees is shown as its epipolar line, an ignored position as a
    cross.
    """
    write_line(picture, f"threshold {thresholds[camera]:.0f}")
    cross_out(rig.cameras[camera].ignored_px.tolist(), picture, image_width)
    scale = picture.shape[1] / image_width
    depths_m = np.geomspace(0.5, 12.0, 24)[:, None]  # many, because lens distortion bends the line
    for other, seen in zip(frame.single_cameras.tolist(), frame.single_points, strict=True):
        if other != camera:
            source = rig.cameras[other]
            line = rig.cameras[camera].project(source.centre_m + depths_m * source.rays(seen))
            points = (line + 0.5) * scale - 0.5
            near = np.all(np.abs(points) < 4.0 * max(picture.shape), axis=1)  # false for NaN
            drawn = np.rint(points[near]).astype(np.int32).reshape(-1, 1, 2)
            cv2.polylines(picture, [drawn], False, _BROWN, 1, cv2.LINE_AA)
    in_space = set(frame.point_blobs[:, camera].tolist())
    alone = set(frame.single_blobs[frame.single_cameras == camera].tolist())
    for index, (x, y, radius) in enumerate(frame.detected[camera][:, :3].tolist()):
        colour = _GREEN if index in in_space else _ORANGE if index in alone else _RED
        centre = reduced((x, y), picture, image_width)
        cv2.circle(picture, centre, round(radius * scale + 3.0), colour, 1, cv2.LINE_AA)


def cross_out(places: Sequence[Sequence[float]], picture: Image, image_width: int) -> None:
    """Draw a cross on each ignored position in a camera's reduced picture."""
    side = round(2.0 * ignored_radius_px(image_width) * picture.shape[1] / image_width) + 4
    for place in places:
        centre = reduced(place, picture, image_width)
        cv2.drawMarker(picture, centre, _LIGHT, cv2.MARKER_TILTED_CROSS, side, 1, cv2.LINE_AA)


def reduced(place: Sequence[float], picture: Image, image_width: int) -> tuple[int, int]:
    """Return the pixel of a reduced picture that shows a position of the full image."""
    scale = picture.shape[1] / image_width
    return round((place[0] + 0.5) * scale - 0.5), round((place[1] + 0.5) * scale - 0.5)


def write_line(picture: Image, text: str) -> None:
    """Write text into the lower left corner of a camera's reduced picture."""
    place = (6, picture.shape[0] - 8)
    cv2.putText(picture, text, place, cv2.FONT_HERSHEY_PLAIN, 0.9, _WHITE, 1, cv2.LINE_AA)


def draw_labels(names: Sequence[str], markers_m: Array, seen: Mask, rig: CameraRig, pictures: Image) -> Image:
    """Return the cameras' reduced pictures with the markers' names.

    Args:
        markers_m: Markers (M, 3) of the tracked body.
        seen: Mask (M,) of the labelled markers; the names of the others are grey.
    """
    result = pictures.copy()
    width = result.shape[1] // len(rig)
    for number, camera in enumerate(rig.cameras):
        picture = result[:, number * width : (number + 1) * width]
        own = np.ascontiguousarray(picture)
        scale = width / camera.image_size[0]
        for name, pixel, is_seen in zip(names, camera.project(markers_m), seen.tolist(), strict=True):
            if np.all((pixel >= 0.0) & (pixel < camera.image_size)):
                place = (round(pixel[0] * scale) + 5, round(pixel[1] * scale) - 4)
                colour = _WHITE if is_seen else _GREY
                cv2.putText(own, name, place, cv2.FONT_HERSHEY_PLAIN, 0.6, colour, 1, cv2.LINE_AA)
        picture[:] = own
    return result
