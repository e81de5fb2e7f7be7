"""Detection of exchanged cameras: each delivers the images of the other."""

from collections import deque
from collections.abc import Sequence
from statistics import fmean

from ...geometry.arrays import FloatArray
from ...geometry.camera import CameraRig
from .stereo import STEREO, Matches, StereoMatcher

EXCHANGED = "left and right camera seem to be exchanged"


class CameraSwapDetector:
    """Test of two cameras for exchange, while their blobs match badly; a no-op for other numbers of cameras."""

    def __init__(self, rig: CameraRig) -> None:
        exchanged = CameraRig(rig.cameras[::-1]) if len(rig) == 2 else None
        self._matcher = StereoMatcher(exchanged) if exchanged else None
        self._errors_px: deque[tuple[float, float]] = deque(maxlen=STEREO.swap_frames)

    def update(self, blobs: Sequence[FloatArray], matches: Matches) -> str:
        """Return a warning, "" without one."""
        if self._matcher is None:
            return ""
        seen = min(len(rows) for rows in blobs)
        if seen >= STEREO.fewest_blobs:
            error = exchanged = self._error_px(matches, seen)
            if error > STEREO.swap_px:
                exchanged = self._error_px(self._matcher.match(blobs, self._matcher.undistort(blobs), None), seen)
            self._errors_px.append((error, exchanged))
        if len(self._errors_px) < STEREO.swap_frames:
            return ""
        error, exchanged = (fmean(errors) for errors in zip(*self._errors_px, strict=True))
        return EXCHANGED if error > STEREO.swap_px and exchanged < STEREO.swap_gain * error else ""

    def _error_px(self, matches: Matches, seen: int) -> float:
        """Return the mean reprojection error of blobs, pixels; one without a partner has the largest."""
        return float(matches.errors_px.mean(axis=1).sum() + STEREO.epipolar_px * (seen - len(matches.points_m))) / seen
