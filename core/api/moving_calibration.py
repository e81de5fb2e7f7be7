"""Calibration of cameras without a board, for commands and scripts."""

from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import SettingsError
from ..geometry.arrays import Mask
from ..geometry.camera import Camera, CameraRig
from ..markers.marker_set import load_marker_set
from ..system.progress import Progress, no_progress
from ..vision.people.network_file import body_network_file

if TYPE_CHECKING:
    from ..markers.marker_frame import MarkerFrame
    from ..vision.calibration.calibrate_moving import MovingCalibration


def calibrate_by_walking(
    sources: Mapping[str, Path | str],
    height_m: float | None = None,
    lenses: CameraRig | None = None,
    network: Path | None = None,
    progress: Progress = no_progress,
) -> "MovingCalibration":
    """Calibrate two or more cameras by a person who walks about, and return them with their accuracy.

    Args:
        sources: Videos, or folders or patterns of images, by camera name. Videos that were not started together are
            synchronised by the person's motion; images were taken at the same moments.
        height_m: Height of the person, 1 to 2.5 m; None for that of an average adult.
        lenses: Calibration whose lenses the cameras of the same names have; unknown lenses are estimated.
        network: File of a body network; by default the one that `get_body_network` brought.
        progress: Called with the fraction done and the activity.

    Raises:
        SettingsError: There are fewer than two cameras, or a source is a live camera.
        CaptureError: A source cannot be read, or the network is missing.
        CalibrationError: The recording does not determine the cameras; the message names the cause.
    """
    from ..vision.calibration.calibrate_moving import calibrate_with_person  # OpenCV is slow to load
    from ..vision.people.body_network import BlazePose
    from ..vision.people.people_pipeline import PeoplePipeline
    from ..vision.people.person_clocks import synchronise_person

    found = BlazePose(network or body_network_file())

    def detect(rig: CameraRig, source: Any) -> "list[MarkerFrame]":
        return _frames(PeoplePipeline(rig, [found] * len(rig)), source, progress)

    points = load_marker_set(found.marker_set)
    cameras, is_free, frames = _detected(sources, lenses, detect, together=False)
    progress(0.9, "synchronising the recordings")
    frames, _ = synchronise_person(cameras, frames, points, placed=False)
    progress(0.95, "calibrating")
    return calibrate_with_person(cameras, is_free, frames, points, height_m)


def calibrate_by_marker(
    sources: Mapping[str, Path | str],
    *,
    stick_m: float = 0.0,
    apart_m: float = 0.0,
    lenses: CameraRig | None = None,
    progress: Progress = no_progress,
) -> "MovingCalibration":
    """Calibrate two or more cameras by one marker, or two on a stick, that are waved through the room.

    Args:
        sources, lenses, progress: As for `calibrate_by_walking`.
        stick_m: Distance between the centres of two markers on a stick; 0 for a single marker.
        apart_m: For a single marker, the distance between the first two cameras.

    Raises:
        SettingsError: As for `calibrate_by_walking`, or not exactly one of the two lengths is given.
        CaptureError, CalibrationError: As for `calibrate_by_walking`.
    """
    from ..vision.calibration.calibrate_moving import calibrate_with_markers
    from ..vision.pipeline import MarkerPipeline
    from .tracking import learn_from_source

    if (stick_m > 0.0) == (apart_m > 0.0):
        what = "one length is needed: that between the two markers of a stick, or that between the first two cameras"
        raise SettingsError(what, advice="measure one of them")

    def detect(rig: CameraRig, source: Any) -> "list[MarkerFrame]":
        pipeline = MarkerPipeline(rig)
        progress(0.0, "learning the background")
        learn_from_source(pipeline, source)
        return _frames(pipeline, source, progress)

    cameras, is_free, frames = _detected(sources, lenses, detect)
    progress(0.9, "calibrating")
    return calibrate_with_markers(cameras, is_free, frames, stick_m, apart_m)


def _frames(pipeline: Any, source: Any, progress: Progress) -> "list[MarkerFrame]":
    found = []
    for number, images in enumerate(source):
        if number % 10 == 0:
            progress(0.9 * number / source.frames, f"frame {number} of {source.frames}")
        found.append(pipeline.detect(images))
    return found


def _detected(
    sources: Mapping[str, Path | str], lenses: CameraRig | None, detect: Any, *, together: bool = True
) -> "tuple[Sequence[Camera], Mask, list[MarkerFrame]]":
    """Return the cameras with their lenses, which lenses are unknown, and what `detect` finds in their images."""
    from ..vision.calibration.moving_fit import cameras_with_lenses
    from ..vision.sources.source_kinds import open_image_source

    if len(sources) < 2:
        what = f"two cameras at least are needed, not {len(sources)}"
        raise SettingsError(what, advice="calibrate a single camera with the board")
    with closing(open_image_source(*sources.values(), together=together)) as source:
        if int(getattr(source, "frames", 0)) <= 0:
            raise SettingsError("live cameras are not recorded here", advice="give videos or folders of images")
        sizes = [(image.shape[1], image.shape[0]) for image in next(iter(source)).images]
        cameras, is_free = cameras_with_lenses(list(sources), sizes, lenses)
        return cameras, is_free, detect(CameraRig(tuple(cameras)), source)
