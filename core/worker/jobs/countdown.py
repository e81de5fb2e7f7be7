"""Countdown to the moment of a recording."""

import math
import time
from collections.abc import Iterator

from ...vision.sources.source_kinds import ImageSetLike
from ..channel import Channel, Stopped


def count_down(images: Iterator[ImageSetLike], seconds: float, channel: Channel, text: str) -> ImageSetLike | None:
    """Send the seconds left and a text; return the first image set after them.

    Returns None if the source ends before.
    """
    due_s, sent = time.perf_counter() + seconds, 0
    for image_set in images:
        if channel.stop_requested.is_set():
            raise Stopped
        left = math.ceil(due_s - time.perf_counter())
        if left <= 0:
            return image_set
        if left != sent:
            sent = left
            channel.send_status(f"{left}: {text}")
    return None
