"""Reduced images of the cameras, for display in Blender."""

import time
from collections.abc import Callable, Sequence

import cv2
import numpy as np

from ...geometry.arrays import Image
from ..channel import Channel
from ..worker_settings import WORKER

Draw = Callable[[int, Image, int], None]  # draws into the reduced picture of a camera; see `PreviewSender.send`


class PreviewSender:
    """Sends the cameras' images side by side, if previews are requested."""

    def __init__(self, wanted: bool, channel: Channel) -> None:
        self._channel = channel
        self._wanted = wanted
        self._due_s = 0.0

    def send(self, images: Sequence[Image], draw: Draw) -> None:
        """Send the images (BGR) of one moment, if a preview is due.

        `draw` receives the camera's number, its reduced picture to draw into, and the width of its image.
        """
        if not self._wanted or time.monotonic() < self._due_s:
            return
        self._due_s = time.monotonic() + WORKER.preview_s
        pictures = []
        for number, image in enumerate(images):
            size = (WORKER.preview_px, round(image.shape[0] * WORKER.preview_px / image.shape[1]))
            pictures.append(np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8))
            draw(number, pictures[-1], image.shape[1])
        tallest = max(len(picture) for picture in pictures)
        padded = [np.pad(picture, ((0, tallest - len(picture)), (0, 0), (0, 0))) for picture in pictures]
        self._channel.send_preview(
            np.asarray(cv2.cvtColor(np.concatenate(padded, axis=1), cv2.COLOR_BGR2RGB), np.uint8)
        )
