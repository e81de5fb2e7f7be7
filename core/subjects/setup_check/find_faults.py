"""The complete check: from pictures of the background and of a performer to findings."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from ...body.standard_skeleton import DEFAULT_HEIGHT_M
from ...errors import CaptureError
from ...geometry.arrays import FloatArray
from ...geometry.camera import CameraRig
from ...markers.marker_frame import MarkerFrame
from ...markers.marker_set import MarkerSet
from ...vision.detection.background import Background
from ...vision.detection.blob_detector import Detector
from ...vision.matching.camera_swap import ImageMismatch
from ...vision.pipeline import MarkerPipeline
from ...vision.sources.image_set import ImageSet, camera_title
from ...vision.tracked_take import synchronise_frames
from .finding import Finding, Place
from .image_faults import marker_light_faults, moving_images, reflections, room_faults, sharpness_faults
from .rig_faults import bump_fault, mismatch_fault, place_fault
from .spots import SpotRecorder
from .worn_faults import find_t_poses, missing_fault, scale_fault

_FEWEST_MOMENTS = 10


def check_setup(
    rig: CameraRig,
    backgrounds: Sequence[Background],
    moments: Iterable[ImageSet],
    marker_set: MarkerSet,
    height_m: float | None = None,
) -> list[Finding]:
    """Return the faults to fix first, or an empty list if all is well.

    Faults that hide others come first: a possible consequence is not checked until its cause is fixed.

    Args:
        rig: Calibrated cameras; the performer's position is checked only if the floor is y = 0.
        backgrounds: Background of each camera.
        moments: Images of a performer with the markers: two seconds in a T pose, then walking for as long.
        height_m: Height of the performer; None if unknown. A known height reveals a wrong scale more reliably.

    Raises:
        CaptureError: There are too few images, or their size differs from the calibration's.
    """
    pipeline = MarkerPipeline(rig)
    pipeline.set_backgrounds(backgrounds)
    frames: list[MarkerFrame] = []
    mismatches: list[ImageMismatch | None] = []

    def detect(moment: ImageSet) -> Sequence[FloatArray]:
        frames.append(pipeline.process(moment))
        mismatches.append(pipeline.mismatch)
        return frames[-1].detected

    if found := _picture_faults([camera.name for camera in rig.cameras], backgrounds, moments, detect):
        return found
    if found := mismatch_fault(mismatches):
        return found
    if len(rig) < 2:
        return []
    frames = synchronise_frames(rig, frames)[0]
    if found := bump_fault(rig, frames):
        return found
    poses = find_t_poses(frames, marker_set, height_m)
    if found := scale_fault(poses, height_m):
        return found
    points_m = np.concatenate([frame.points_m for frame in frames])
    if len(points_m) and has_floor(rig):
        found = place_fault(rig, np.median(points_m, axis=0), height_m or DEFAULT_HEIGHT_M)
    return found or missing_fault(rig, poses, marker_set)


def has_floor(rig: CameraRig) -> bool:
    """Return whether the world's floor is y = 0: without a floor, the first camera is at the origin."""
    return bool(rig.cameras[0].centre_m[1] > 0.05)


def check_pictures(
    names: Sequence[str],
    backgrounds: Sequence[Background],
    moments: Iterable[ImageSet],
    ignored: Sequence[Place] = (),
) -> list[Finding]:
    """Return the faults that can be seen in pictures from uncalibrated cameras; see `check_setup`.

    Args:
        names: Names of the cameras.
        ignored: Positions at which blobs are ignored (see `CameraRig.ignored`).
    """
    rows = np.array(ignored, dtype=np.float64).reshape(-1, 3)
    detectors = [
        Detector(background, ignored_px=rows[rows[:, 0] == index, 1:]) for index, background in enumerate(backgrounds)
    ]

    def detect(moment: ImageSet) -> Sequence[FloatArray]:
        return [detector.detect(image) for detector, image in zip(detectors, moment.images, strict=True)]

    return _picture_faults(names, backgrounds, moments, detect)


def _picture_faults(
    names: Sequence[str],
    backgrounds: Sequence[Background],
    moments: Iterable[ImageSet],
    detect: Callable[[ImageSet], Sequence[FloatArray]],
) -> list[Finding]:
    """Return the faults of single cameras; `detect` returns the blobs of each camera at a moment."""
    titles = [camera_title(index, names) for index in range(len(names))]
    if found := [finding for pair in zip(titles, backgrounds, strict=True) for finding in room_faults(*pair)]:
        return found
    recorders = [SpotRecorder(background.mean.max(axis=2)) for background in backgrounds]
    count = 0
    for count, moment in enumerate(moments, 1):  # noqa: B007 - used after the loop
        rows = zip(recorders, moment.times_s, moment.images, detect(moment), strict=True)
        for recorder, time_s, image, blobs in rows:
            recorder.add(time_s, image, blobs)
    if count < _FEWEST_MOMENTS:
        raise CaptureError(
            f"{count} moments are too few for a check", advice="record six seconds: a T pose, then some steps"
        )
    return _camera_faults(titles, recorders)


def _camera_faults(titles: Sequence[str], recorders: Sequence[SpotRecorder]) -> list[Finding]:
    """Return the faults of single cameras; those of focus and shutter come first, because blur also dims markers."""
    blunt, dim, false = [], [], []
    cameras = [recorder.result() for recorder in recorders]
    moving = moving_images(cameras)
    for index, (title, recorder, spots) in enumerate(zip(titles, recorders, cameras, strict=True)):
        blunt += sharpness_faults(title, spots)
        dim += marker_light_faults(title, spots, recorder.rises, recorder.images)
        false += reflections(index, title, spots, moving)
    return blunt or dim or false
