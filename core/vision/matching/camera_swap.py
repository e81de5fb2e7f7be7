"""Detection of exchanged cameras: each delivers the images of the other."""

from collections import deque
from collections.abc import Sequence
from statistics import fmean

from ...geometry.arrays import FloatArray
from ...geometry.camera import CameraRig
from .matching_settings import MATCHING
from .stereo import Matches, StereoMatcher

EXCHANGED = "left and right camera seem to be exchanged"


class CameraSwapDetector:
    """Test of two cameras for exchange, while their blobs match badly; a no-op for other numbers of cameras."""

    def __init__(self, rig: CameraRig) -> None:
        self._matcher = StereoMatcher(CameraRig(rig.cameras[::-1])) if len(rig) == 2 else None
        self._errors_px: deque[tuple[float, float]] = deque(maxlen=MATCHING.swap_frames)

    def update(self, blobs: Sequence[FloatArray], matches: Matches) -> bool:
        """Return whether the cameras seem exchanged."""
        if self._matcher is None:
            return False
        seen = min(len(rows) for rows in blobs)
        if seen >= MATCHING.fewest_blobs:
            error = exchanged = self._error_px(matches, seen)
            if error > MATCHING.swap_px:
                exchanged = self._error_px(self._matcher.match(blobs, self._matcher.undistort(blobs), None), seen)
            self._errors_px.append((error, exchanged))
        if len(self._errors_px) < MATCHING.swap_frames:
            return False
        error, exchanged = (fmean(errors) for errors in zip(*self._errors_px, strict=True))
        return error > MATCHING.swap_px and exchanged < MATCHING.swap_gain * error

    def _error_px(self, matches: Matches, seen: int) -> float:
        """Return the mean reprojection error of blobs, pixels; one without a partner has the largest."""
        unmatched = seen - len(matches.points_m)
        return float(matches.errors_px.mean(axis=1).sum() + MATCHING.epipolar_px * unmatched) / seen
