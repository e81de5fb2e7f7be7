"""Names of plugged-in cameras, without opening them.

Linux lists the name of each device number. Windows and macOS list names in an order that differs from OpenCV's numbers,
so a camera is called by its number there.
"""

import sys
from pathlib import Path

_LISTED = Path("/sys/class/video4linux")


def device_numbers() -> list[int]:
    """Return the numbers that may be cameras: on Linux those of device files, elsewhere 0 to 7."""
    if sys.platform != "linux":
        return list(range(8))
    numbers = (path.name.removeprefix("video") for path in Path("/dev").glob("video*"))
    return sorted(int(number) for number in numbers if number.isdecimal())


def device_name(device: int) -> str:
    """Return a camera's name and number, such as "HD Webcam C525 (0)"."""
    name = ""
    if sys.platform == "linux":
        try:
            name = (_LISTED / f"video{device}" / "name").read_text(encoding="utf-8", errors="replace").strip()
        except OSError:  # unplugged, or a system without this folder
            name = ""
    name = "".join(letter for letter in name if letter.isprintable())[:60]
    return f"{name} ({device})" if name else f"Camera {device}"
