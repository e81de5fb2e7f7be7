"""Detection of exchanged cameras: the left one's images come as the right one's."""

from collections import deque
from collections.abc import Sequence
from statistics import fmean

from ...geometry.arrays import FloatArray
from ...geometry.camera import CameraRig
from .stereo import EPIPOLAR_PX, Matches, StereoMatcher

EXCHANGED = "left and right camera seem to be exchanged"
_FEWEST_BLOBS = 4
_FRAMES = 6  # of evidence: within a quarter of a second at 30 Hz
_DOUBTFUL_PX = 0.75  # mean error of the matches from which it is worth a look ...
_BETTER = 0.35  # ... whether it falls to such a share with the cameras exchanged


class CameraSwapDetector:
    """Test of exchanged cameras, where the blobs of two cameras meet badly.

    With more or fewer than two cameras nothing is looked for.
    """

    def __init__(self, rig: CameraRig) -> None:
        exchanged = CameraRig(rig.cameras[::-1]) if len(rig) == 2 else None
        self._matcher = StereoMatcher(exchanged) if exchanged else None
        self._errors_px: deque[tuple[float, float]] = deque(maxlen=_FRAMES)

    def update(self, blobs: Sequence[FloatArray], matches: Matches) -> str:
        """Return a warning, "" where nothing points to an exchange."""
        if self._matcher is None:
            return ""
        seen = min(len(rows) for rows in blobs)
        if seen >= _FEWEST_BLOBS:
            error = exchanged = self._error_px(matches, seen)
            if error > _DOUBTFUL_PX:
                exchanged = self._error_px(self._matcher.match(blobs, self._matcher.undistort(blobs), None), seen)
            self._errors_px.append((error, exchanged))
        if len(self._errors_px) < _FRAMES:
            return ""
        error, exchanged = (fmean(errors) for errors in zip(*self._errors_px, strict=True))
        worse = error > _DOUBTFUL_PX and exchanged < _BETTER * error
        return EXCHANGED if worse else ""

    def _error_px(self, matches: Matches, seen: int) -> float:
        """Return the mean meeting error of blobs, pixels; an unmatched one counts most."""
        return float(matches.errors_px.mean(axis=1).sum() + EPIPOLAR_PX * (seen - len(matches.points_m))) / seen
