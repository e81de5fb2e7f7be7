"""Network addresses of cameras and videos."""

from pathlib import PurePosixPath
from urllib.parse import urlsplit

from .file_endings import VIDEO_ENDINGS

_PREFIXES = ("http://", "https://", "rtsp://", "rtmp://", "udp://", "tcp://")


def is_address(text: str) -> bool:
    """Return whether a string is a network address."""
    return text.lower().startswith(_PREFIXES)


def is_stream(text: str) -> bool:
    """Return whether a string is the address of a camera rather than a video file."""
    if not is_address(text):
        return False
    try:
        path = urlsplit(text).path
    except ValueError:  # an unmatched bracket, which is reported when the address is opened
        return True
    return PurePosixPath(path).suffix.lower() not in VIDEO_ENDINGS


def camera_name(device: int | str) -> str:
    """Return a camera's number, or its address without the login, which must not appear in messages and takes."""
    start, mark, rest = str(device).partition("://")
    return start + mark + rest.rpartition("@")[2]
