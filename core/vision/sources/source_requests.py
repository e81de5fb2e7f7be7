"""Descriptions of cameras and files as image sources, in a module that is cheap to import."""

from dataclasses import dataclass
from typing import Annotated

from ...system.files import exists
from ...system.schema import About, check_ranges
from .addresses import is_stream

_RATE = About("frame rate; by default the source's own", "frames per second", 0.1, 1000.0)


@dataclass(frozen=True)
class CameraControls:
    """Settings of a camera; None lets the camera choose."""

    exposure_s: Annotated[
        float | None, About("exposure time; a few milliseconds make markers sharp", "s", most=1.0, above=0.0)
    ] = None
    gain: Annotated[float | None, About("gain, in the camera's own units")] = None
    focus: Annotated[float | None, About("focus, in the camera's own units")] = None

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class LiveCameras:
    """Plugged-in or network cameras."""

    devices: Annotated[tuple[int | str, ...], About("device numbers, or addresses of network cameras", fewest=1)]
    kind: Annotated[str, About("kind of source", choices=("cameras",), optional=False)] = "cameras"
    size: Annotated[tuple[int, int] | None, About("width and height of the images", "pixels", 1, 100_000)] = None
    fps: Annotated[float | None, _RATE] = None
    controls: Annotated[tuple[CameraControls, ...], About("controls of each camera")] = ()
    is_live = True
    is_repeatable = False


@dataclass(frozen=True)
class _Files:
    paths: Annotated[tuple[str, ...], About("one path for each camera", fewest=1)]

    @property
    def is_live(self) -> bool:
        """Whether the source cannot be paused."""
        return any(map(is_stream, self.paths))

    @property
    def is_repeatable(self) -> bool:
        """Whether the images can be read again."""
        return not self.is_live and all(exists(path) or "*" in path for path in self.paths)


@dataclass(frozen=True)
class VideoFiles(_Files):
    """Video files, or addresses of videos or network cameras."""

    kind: Annotated[str, About("kind of source", choices=("videos",), optional=False)] = "videos"
    fps: Annotated[float | None, _RATE] = None
    starts_s: Annotated[
        tuple[float, ...], About("times at which the videos begin, on one clock; by default together", "s")
    ] = ()


@dataclass(frozen=True)
class ImageFiles(_Files):
    """Folders or patterns of images."""

    kind: Annotated[str, About("kind of source", choices=("images",), optional=False)] = "images"
    fps: Annotated[float | None, _RATE] = None
