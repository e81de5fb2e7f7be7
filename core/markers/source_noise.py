"""Errors of points by kind of source, used by filters, solver, body fit and confidence."""

import math
from dataclasses import dataclass

from .marker_set import PointKind


@dataclass(frozen=True)
class SourceNoise:
    """Expected errors of the points of one kind of source, per coordinate."""

    most_fast_m: float  # largest noise between frames that is smoothed; a larger one is sudden motion at a low rate
    lasting_m: float  # standard deviation of errors that last for many frames, so that smoothing cannot remove them
    calm_hz: float  # highest cut-off for poses of recorded takes; above it there is only noise
    calmest_hz: float  # lowest cut-off, for slow motion
    calmed_m: float  # largest RMS displacement of a joint that lowering the cut-off may cause; below `lasting_m`
    # standard deviation of the Gaussian weights with which a shown pose is averaged with the poses before and after it;
    # at 60 Hz those of markers are about 1 4 6 4 1
    shown_s: float
    guessed_m: float = 0.0  # standard deviation of a depth that is guessed from one camera's picture

    @property
    def across_m(self) -> float:
        """Standard deviation across the ray of a single camera, whose noise is not smoothed; 0 for exact points."""
        return math.hypot(self.lasting_m, self.most_fast_m) if self.lasting_m else 0.0


_NOISES = {
    PointKind.MARKERS: SourceNoise(
        most_fast_m=0.004, lasting_m=0.0, calm_hz=16.0, calmest_hz=16.0, calmed_m=0.0, shown_s=1.0 / 60.0
    ),
    # Networks locate points with errors of 20 to 30 mm that last 0.2 to 0.5 s, and 4 to 8 mm between frames. Standard
    # deviations of that size would let the database override motion that it lacks (chosen on CMU's 07_01, 14_08 and
    # 49_10).
    PointKind.KEYPOINTS: SourceNoise(
        most_fast_m=0.015,
        lasting_m=0.012,
        calm_hz=4.0,
        calmest_hz=2.5,
        calmed_m=0.005,
        shown_s=1.0 / 30.0,
        guessed_m=0.15,
    ),
}


def noise_of(points: PointKind) -> SourceNoise:
    """Return the expected errors of a kind of points."""
    return _NOISES[points]
