"""Counting down to the moment at which something is recorded."""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

from ...vision.sources.spec import ImageSetLike
from ..channel import Channel
from .cameras import Stopped


@dataclass
class Line:
    """What stands beside the countdown, and how much of the work is done."""

    text: str
    fraction: float | None = None


def counted_down(images: Iterator[ImageSetLike], seconds: float, channel: Channel, line: Line) -> ImageSetLike | None:
    """Take images and tell the seconds that are left; return the first image set after them, None at the end."""
    due_s, told = time.perf_counter() + seconds, 0
    for image_set in images:
        if channel.stop_requested.is_set():
            raise Stopped
        left = math.ceil(due_s - time.perf_counter())
        if left <= 0:
            return image_set
        if left != told:
            told = left
            channel.send_status(f"{left}: {line.text}", line.fraction)
    return None
