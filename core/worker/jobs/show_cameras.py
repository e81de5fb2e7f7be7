"""Job: take one picture with each plugged-in camera, so that the user can choose.

The RESULT has "cameras": device and size of each camera; the size is null if it gives no image. A PREVIEW shows all
pictures side by side.
"""

import numpy as np

from ...errors import CaptureError
from ...geometry.arrays import Image
from ...vision.blob_preview import write_line
from ...vision.sources.camera_source import find_cameras
from ...vision.sources.device_names import device_name
from ..channel import Channel
from ..requests import ShowCamerasRequest
from .preview_sender import PreviewSender

_BLANK: Image = np.zeros((480, 640, 3), dtype=np.uint8)


def run(_request: ShowCamerasRequest, channel: Channel) -> None:
    """Send the pictures and the RESULT.

    Raises:
        CaptureError: No camera was found.
    """
    channel.send_status("looking for cameras")
    found = find_cameras()
    if not found:
        raise CaptureError(
            "no camera was found, or other programs use all of them",
            advice="plug in two cameras, or close those programs",
        )

    def draw(number: int, picture: Image, image_width: int) -> None:
        silent = "" if found[number].image is not None else ": no image"
        write_line(picture, f"{device_name(found[number].device)}{silent}")

    images = [_BLANK if camera.image is None else camera.image for camera in found]
    PreviewSender(True, channel).send(images, draw)
    channel.send_result({"cameras": [{"device": camera.device, "size": camera.size} for camera in found]})
