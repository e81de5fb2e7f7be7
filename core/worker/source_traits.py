"""What is to be known about an image source before it is opened, without the images' libraries."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any


def is_live(request: Mapping[str, Any]) -> bool:
    """Return whether what comes does not wait: from cameras or trackers; `request` as of `camera_job`."""
    return str(request["source"].get("kind", "")) == "cameras" or has_no_cameras(request)


def has_no_cameras(request: Mapping[str, Any]) -> bool:
    """Return whether markers come from another program (see `tracker_job`), and there are no images."""
    return str(request["source"].get("kind", "")) == "vmc"


def is_simulated(request: Mapping[str, Any]) -> bool:
    """Return whether the images are the simulated performer's, whose time stamps are exact."""
    return str(request["source"].get("kind", "")) == "simulated"


def is_repeatable(request: Mapping[str, Any]) -> bool:
    """Return whether the images can be read again, so that a process that takes another's place loses none.

    Cameras', trackers' and streams' cannot, and those of a simulated performer who plays by the clock.
    """
    if is_simulated(request):
        return not request["source"].get("live")
    return not is_live(request) and all(Path(path).exists() or "*" in path for path in request["source"]["paths"])
