"""File of the body network, in a module that is cheap to import."""

import hashlib
from pathlib import Path

from ...errors import CaptureError
from ...system.files import is_file, read_bytes
from ...system.user_folder import cache_folder

# the file: its name in MediaPipe's package, and its SHA-256
NETWORK_FILE = "pose_landmark_full.tflite"
MOST_BYTES = 64 << 20  # largest file that is read
NETWORK_SHA256 = "e9a5c5cb17f736fafd4c2ec1da3b3d331d6edbe8a0d32395855aeb2cdfd64b9f"


def body_network_file() -> Path:
    """Return the path of the user's body network, which may not exist yet."""
    return cache_folder() / "networks" / NETWORK_FILE


def read_network(path: Path) -> bytes:
    """Return the content of a body network's file.

    Raises:
        CaptureError: The file is missing, damaged or another network.
    """
    if not is_file(path):
        raise CaptureError("there is no body network", where=str(path), advice="get the body network first")
    data = read_bytes(path, MOST_BYTES, CaptureError)
    # OpenCV does not survive every damaged network
    if hashlib.sha256(data).hexdigest() != NETWORK_SHA256:
        what = f"is damaged, or not the {NETWORK_FILE} that this version knows"
        raise CaptureError(what, where=str(path), advice="get the body network again")
    return data
