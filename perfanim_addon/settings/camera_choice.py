"""Choice of cameras by name and thumbnail, or by network address; the settings store device numbers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

import bpy
import bpy.utils.previews
import numpy as np

from ...core.geometry.arrays import Image
from ...core.vision.sources.addresses import is_stream
from ...core.vision.sources.device_names import device_name, device_numbers
from ..preferences.online import is_online_allowed, is_this_computer

Item = tuple[str, str, str, int, int]

NONE = -1  # device number that means no camera
NETWORK = -2  # device number that means a network address


@dataclass
class _Seen:
    """Cameras found last, and their thumbnails."""

    devices: tuple[int, ...] = ()
    thumbnails: Any = None
    items: dict[str, list[Item]] = field(default_factory=dict)  # Blender does not hold references to their texts


_seen = _Seen()


def keep_pictures(devices: Sequence[int], pictures: Image) -> None:
    """Offer these cameras, with their RGB pictures (height, width, 3) side by side."""
    _seen.devices = tuple(devices)
    if _seen.thumbnails is not None:
        bpy.utils.previews.remove(_seen.thumbnails)
    _seen.thumbnails = bpy.utils.previews.new()
    for device, picture in zip(devices, np.array_split(pictures, len(devices), axis=1), strict=True):
        small = picture[::-2, ::2].astype(np.float32) / 255.0
        pixels = np.concatenate((small, np.ones((*small.shape[:2], 1), np.float32)), axis=2)
        thumbnail = _seen.thumbnails.new(str(device))
        thumbnail.image_size = thumbnail.icon_size = (pixels.shape[1], pixels.shape[0])
        thumbnail.image_pixels_float.foreach_set(pixels.ravel())
        thumbnail.icon_pixels_float.foreach_set(pixels.ravel())


def has_thumbnails() -> bool:
    """Return True if pictures of the cameras are known."""
    return _seen.thumbnails is not None


def are_there(settings: Any) -> bool:
    """Return True unless a chosen camera is known not to be plugged in."""
    chosen = {settings.left_device, settings.right_device} - {NONE, NETWORK}
    return chosen <= set(_seen.devices or device_numbers())


def items_of(setting: str, optional: bool) -> Callable[[Any, object], list[Item]]:
    """Return a function that lists the cameras for a setting with a device number."""

    def items(settings: Any, _context: object) -> list[Item]:
        chosen = getattr(settings, setting, NONE)
        numbers = sorted({*(_seen.devices or device_numbers()), chosen} - {NONE, NETWORK})
        rows = [(str(number), device_name(number), f"Camera {number}", _icon(number), number) for number in numbers]
        rows.append(("NETWORK", "Network Address", "A camera on the network: type its address below", 0, NETWORK))
        if optional:
            rows.append(("NONE", "None", "One camera only", 0, NONE))
        _seen.items[setting] = rows
        return rows

    return items


def address_problem(address: str) -> str:
    """Return the reason why a camera cannot have this address, or ""."""
    if not address:
        return "enter the address of the camera, such as rtsp://192.168.1.20:554/stream"
    if not is_stream(address):
        return f"{address}: not the address of a camera; enter an address such as rtsp://192.168.1.20:554/stream"
    try:
        host = urlsplit(address).hostname or ""
    except ValueError:  # an unbalanced bracket
        host = ""
    if not host:
        return f"{address}: has no host name; enter an address such as rtsp://192.168.1.20:554/stream"
    if is_online_allowed() or is_this_computer(host):
        return ""
    return f"{host}: online access is off; enable Allow Online Access in Preferences > System"


def _icon(device: int) -> int:
    known = _seen.thumbnails is not None and str(device) in _seen.thumbnails
    return int(_seen.thumbnails[str(device)].icon_id) if known else 0


def camera_choice(name: str, description: str, setting: str, optional: bool = False) -> Any:
    """Return a choice among cameras that sets a device number."""
    return bpy.props.EnumProperty(
        name=name,
        description=description,
        items=items_of(setting, optional),
        get=lambda self: getattr(self, setting),
        set=lambda self, value: setattr(self, setting, value),
        options={"SKIP_SAVE"},
    )


def unregister() -> None:
    """Forget the cameras and free their thumbnails."""
    if _seen.thumbnails is not None:
        bpy.utils.previews.remove(_seen.thumbnails)
    vars(_seen).update(vars(_Seen()))
