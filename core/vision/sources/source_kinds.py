"""Opening image sources described by strings."""

from collections.abc import Sequence
from pathlib import Path

from ...errors import CaptureError
from ...system.files import is_file, is_folder
from .addresses import camera_name, is_address, is_stream
from .camera_source import CameraSource
from .image_file_source import ImageFileSource, is_image_pattern
from .image_set import SampledSource
from .video_source import VideoSource


def open_image_source(
    *sources: str | Path, fps: float | None = None, size: tuple[int, int] | None = None, together: bool = True
) -> SampledSource:
    """Return a source from one string per camera: a video, folder, pattern, device number or address.

    Args:
        size: Width and height of the images that devices deliver, as calibrated.
        together: Refuse videos of different lengths (see `VideoSource`).

    Raises:
        CaptureError: A string is none of these, or they are not all of the same kind.
    """
    texts = [str(source) for source in sources]
    kinds = [_kind(text) for text in texts]
    if len(set(kinds)) != 1:
        raise CaptureError(
            "the cameras' sources are of different kinds: "
            + ", ".join(f"{camera_name(text)} ({kind})" for text, kind in zip(texts, kinds, strict=True)),
            advice="give only videos, only folders or patterns of images, or only device numbers or addresses",
        )
    if kinds[0] == "cameras":
        return CameraSource([text if is_stream(text) else int(text) for text in texts], size, fps)
    if kinds[0] == "videos":
        return VideoSource(texts, fps or 30.0, together=together)
    return ImageFileSource(texts, fps or 30.0)


def open_videos(paths: Sequence[str], fps: float | None = None, starts_s: Sequence[float] = ()) -> SampledSource:
    """Return a source for videos that begin at these times (see `VideoSource`), or for addresses of network cameras."""
    streams = [path for path in paths if is_stream(path)]
    if not streams:
        return VideoSource(paths, fps or 30.0, starts_s=starts_s)
    if len(streams) < len(paths):
        raise CaptureError(
            "is a camera, but another source is a video", where=streams[0], advice="give only videos, or only cameras"
        )
    return CameraSource(streams, None, fps)


def _kind(text: str) -> str:
    if text.isdecimal() and len(text) < 6:
        return "cameras"
    if is_address(text):
        return "cameras" if is_stream(text) else "videos"
    if is_image_pattern(text):
        return "images"
    if is_file(text):
        return "videos"
    what = "contains no image files" if is_folder(text) else "not found"
    raise CaptureError(
        what, where=text, advice="give a video, a folder, a pattern like take/*_1.jpg, a device number or an address"
    )
