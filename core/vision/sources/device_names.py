"""Names of plugged-in cameras, without opening them.

Linux lists the name of each device number. Windows and macOS have names too, but not in the order of OpenCV's numbers:
a wrong name is worse than none, so there a camera is called by its number.
"""

import sys
from pathlib import Path

MOST_DEVICES = 8  # that are looked for where the system has no list of them
_LISTED = Path("/sys/class/video4linux")
_LONGEST = 60


def device_numbers() -> list[int]:
    """Return the numbers that may be cameras: Linux has a file for each."""
    if sys.platform != "linux":
        return list(range(MOST_DEVICES))
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
    name = "".join(letter for letter in name if letter.isprintable())[:_LONGEST]
    return f"{name} ({device})" if name else f"Camera {device}"
