"""Pipeline from images to marker frames without labels."""

from collections.abc import Iterable, Sequence
from statistics import fmean

import numpy as np

from ..errors import CaptureError, counted
from ..geometry.arrays import Image
from ..geometry.camera import CameraRig
from ..markers.marker_frame import MarkerFrame
from .detection.background import Background, background_from_take, learn_backgrounds
from .detection.blob_detector import DetectionSettings, Detector
from .matching.camera_swap import CameraSwapDetector, ImageMismatch
from .matching.point_prediction import PointPredictor
from .matching.stereo import StereoMatcher, unused_blobs
from .matching.time_alignment import TimeAligner
from .sources.image_set import ImageSet

_ENCODED_PX = {1080: 1088}  # sides of videos that encoders fill up to whole blocks, which calibrations may include
_NO_BLOBS = np.empty((0, 5), dtype=np.float32)


class MarkerPipeline:
    """Detection, matching and triangulation for one rig.

    Backgrounds are learned by the `learn_*` methods; in the dark, no background is needed. An `aligner` moves the
    cameras' blobs to one time before they are matched.

    Attributes:
        mismatch: What seems to be wrong with the images (exchanged, mirrored or upside down), or None.
    """

    def __init__(self, rig: CameraRig, detection: DetectionSettings | None = None) -> None:
        self.rig = rig
        self._detection = detection
        self._matcher = StereoMatcher(rig)
        self._predictor = PointPredictor()
        self._swap_detector = CameraSwapDetector(rig)
        self.mismatch: ImageMismatch | None = None
        self.aligner: TimeAligner | None = None
        self.last_errors_px = np.empty((0, len(rig)))
        self.set_backgrounds([None] * len(rig))

    def set_backgrounds(self, backgrounds: Sequence[Background | None]) -> None:
        """Use a background for each camera; None for a camera in the dark."""
        _check_count(self.rig, len(backgrounds))
        self.backgrounds = tuple(backgrounds)
        self.detectors = tuple(
            Detector(background, self._detection, camera.ignored_px)
            for background, camera in zip(backgrounds, self.rig.cameras, strict=True)
        )

    def learn_empty(self, images: Iterable[tuple[Image, ...]]) -> None:
        """Learn backgrounds from moments without the performer, one image per camera."""
        self.set_backgrounds(learn_backgrounds(images))

    def learn_from_take(self, images: Iterable[tuple[Image, ...]]) -> None:
        """Learn backgrounds from frames spread over a take with the performer in it."""
        moments = list(images)
        if not moments:
            raise CaptureError("there are no images to learn the background from", advice="give images of the take")
        _check_count(self.rig, len(moments[0]))
        self.set_backgrounds([background_from_take(column) for column in zip(*moments, strict=True)])

    def process(self, images: ImageSet) -> MarkerFrame:
        """Return the markers of one image set: `detect`, then `locate`."""
        return self.locate(self.detect(images))

    def detect(self, images: ImageSet) -> MarkerFrame:
        """Return the blobs of one image set; an unusable image has no blobs.

        Raises:
            CaptureError: The number or the size of the images does not match the calibration.
        """
        check_images(self.rig, images)
        rows = zip(self.detectors, images.images, images.usable, strict=True)
        blobs = tuple(detector.detect(image) if use else _NO_BLOBS for detector, image, use in rows)
        stamps_s = np.where(images.usable, images.times_s, np.nan)
        time_s = fmean(stamps_s[np.isfinite(stamps_s)].tolist() or images.times_s)
        return MarkerFrame(images.number, time_s, blobs=blobs, camera_times_s=stamps_s, notes=images.notes)

    def locate(self, seen: MarkerFrame) -> MarkerFrame:
        """Return the markers of one moment from the blobs that `detect` returned."""
        time_s, blobs = seen.time_s, seen.blobs
        if self.aligner is not None:
            time_s, blobs = self.aligner.align(time_s, seen.camera_times_s, blobs)
        normalised = self._matcher.undistort(blobs)
        expected = self._predictor.predict(time_s)
        matches = self._matcher.match(blobs, normalised, expected)
        self._predictor.update(time_s, matches.points_m)
        self.last_errors_px = matches.errors_px
        self.mismatch = self._swap_detector.update(blobs, matches)
        free = [unused_blobs(matches.blobs, camera, len(rows)) for camera, rows in enumerate(normalised)]
        return MarkerFrame(
            number=seen.number,
            time_s=time_s,
            points_m=matches.points_m,
            covariances_m2=matches.covariances_m2,
            blobs=blobs,
            detected=seen.blobs,
            normalised=tuple(normalised),
            point_blobs=matches.blobs,
            single_cameras=np.repeat(np.arange(len(free)), [len(blobs) for blobs in free]),
            single_blobs=np.concatenate(free),
            single_points=np.concatenate([rows[blobs] for rows, blobs in zip(normalised, free, strict=True)]),
            camera_times_s=seen.camera_times_s,
            notes=(*seen.notes, self.mismatch.note) if self.mismatch is not None else seen.notes,
        )


def check_images(rig: CameraRig, images: ImageSet) -> None:
    """Raise CaptureError if the number or the size of the images does not match the calibration."""
    _check_count(rig, len(images.images))
    for camera, image in zip(rig.cameras, images.images, strict=True):
        height, width = image.shape[:2]
        encoded = _ENCODED_PX.get(width, width), _ENCODED_PX.get(height, height)
        if camera.image_size not in ((width, height), encoded):
            is_turned = (height, width) == camera.image_size
            alike = [other.name for other in rig.cameras if other.image_size == (width, height)]
            turned = f", as those of camera {alike[0]}: are the cameras exchanged?" if alike else ""
            turned = ", as if turned by 90 degrees" if is_turned else turned
            advice = "record at the size of the calibration, or calibrate again"
            raise CaptureError(
                f"images are {width}x{height}, but the calibration is for "
                f"{camera.image_size[0]}x{camera.image_size[1]}{turned}",
                where=f"camera {camera.name}",
                advice=f"turn the video back, or {advice}" if is_turned else advice,
            )


def _check_count(rig: CameraRig, count: int) -> None:
    if count != len(rig):
        raise CaptureError(
            f"there {'is' if count == 1 else 'are'} {counted(count, 'image')}, "
            f"but the calibration is for {counted(len(rig), 'camera')}",
            advice="use a calibration of this set-up",
        )
