"""Opening image sources, including the simulated studio."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from ..errors import CaptureError, SettingsError
from ..simulate.studio.simulated_performer import SimulatedPerformer
from ..system.schema import About, Schema, Table
from ..vision.sources.camera_source import CameraSource
from ..vision.sources.image_file_source import ImageFileSource
from ..vision.sources.image_set import ImageSource
from ..vision.sources.source_kinds import open_videos
from ..vision.sources.source_requests import LiveCameras, VideoFiles
from ..vision.sources.source_settings import SOURCES
from .requests import SourceRequest, TrackerSource


@dataclass(frozen=True)
class _Description:
    source: Annotated[SourceRequest, About("image source")]


_DESCRIPTION = Schema(_Description, "Image source", "", SettingsError, "choose the source again")


def open_source(asked: SourceRequest | Table, newest: bool = False) -> ImageSource:
    """Return an image source.

    Args:
        newest: Cameras drop images that wait while earlier ones are processed.

    Raises:
        SettingsError: The description of the source is invalid.
        CaptureError: The source cannot be opened.
    """
    if isinstance(asked, Mapping):
        asked = _DESCRIPTION.read({"source": asked}, "request").source
    if isinstance(asked, SimulatedPerformer):
        from ..simulate.studio.simulated_source import open_simulated

        return open_simulated(asked)
    if isinstance(asked, VideoFiles):
        return open_videos(asked.paths, asked.fps, asked.starts_s)
    if isinstance(asked, LiveCameras):
        held = 1 if newest else SOURCES.held
        return CameraSource(asked.devices, asked.size, asked.fps, asked.controls, held)
    if isinstance(asked, TrackerSource):
        raise CaptureError("trackers give no images", advice="choose cameras or video files")
    return ImageFileSource(asked.paths, asked.fps or 30.0)
