"""Open the image source that a description names, the simulated studio included."""

from collections.abc import Mapping
from typing import Any

from ..errors import SettingsError
from ..vision.sources.camera_controls import CameraControls
from ..vision.sources.camera_source import CameraSource
from ..vision.sources.image_file_source import ImageFileSource
from ..vision.sources.source_kinds import ImageSource, frame_rate, listed_values, open_videos


def open_source(spec: Mapping[str, Any]) -> ImageSource:
    """Return the source that a description names.

    Raises:
        SettingsError: the description is not one. CaptureError: the source cannot be opened.
    """
    try:
        return _opened(spec)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        advice = "choose the source again"
        raise SettingsError(f"a setting of the image source is wrong ({error})", advice=advice) from error


def _opened(spec: Mapping[str, Any]) -> ImageSource:
    """Return the source, before wrong types are caught.

    A description is text of another process or of a file, so any value may be of any type.
    """
    kind = str(spec.get("kind", ""))
    fps = frame_rate(spec)
    if kind == "simulated":
        from ..simulate.studio.simulated_source import open_simulated

        simulated: ImageSource = open_simulated(spec)
        return simulated
    if kind == "videos":
        return open_videos(listed_values(spec, "paths"), fps)
    if kind == "images":
        return ImageFileSource(listed_values(spec, "paths"), fps or 30.0)
    if kind == "cameras":
        size = spec.get("size")
        controls = [CameraControls.of_spec(row) for row in spec.get("controls", ())]
        return CameraSource(
            listed_values(spec, "devices"), (int(size[0]), int(size[1])) if size else None, fps, controls
        )
    raise SettingsError(f"unknown image source {kind!r}", advice="use simulated, videos, images or cameras")
