"""Traits of an image source, known without opening it."""

from collections.abc import Mapping
from typing import Any

from ..system.files import exists
from ..vision.sources.addresses import is_stream


def _kind(request: Mapping[str, Any]) -> str:
    return str(request["source"].get("kind", ""))


def is_live(request: Mapping[str, Any]) -> bool:
    """Return whether the source of a job's request cannot wait: cameras, trackers."""
    kind = _kind(request)
    return kind in ("cameras", "vmc") or (kind == "videos" and any(map(is_stream, request["source"]["paths"])))


def has_no_cameras(request: Mapping[str, Any]) -> bool:
    """Return whether markers come from another program, without images."""
    return _kind(request) == "vmc"


def is_simulated(request: Mapping[str, Any]) -> bool:
    """Return whether the images are simulated, so that their time stamps are exact."""
    return _kind(request) == "simulated"


def is_repeatable(request: Mapping[str, Any]) -> bool:
    """Return whether the images can be read again after a process was replaced.

    Those of cameras, trackers and streams cannot, nor those of a simulated performer who plays by the clock.
    """
    if is_simulated(request):
        return not request["source"].get("live")
    return not is_live(request) and all(exists(path) or "*" in path for path in request["source"].get("paths", ()))
