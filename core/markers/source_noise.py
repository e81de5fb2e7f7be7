"""Errors of points by the kind of their source: one setting for filters, solver, body fit and confidence."""

from dataclasses import dataclass

from .marker_set import PointKind


@dataclass(frozen=True)
class SourceNoise:
    """What to expect of the points of a kind of source; lengths are of one coordinate unless said."""

    most_fast_m: float  # largest noise from frame to frame that is smoothed; more is sudden motion at a low rate
    lasting_m: float  # errors that last for many frames, which no smoothing of a point removes
    calm_hz: float  # cut-off for poses of recorded takes, above which there is noise only


_NOISES = {
    PointKind.MARKERS: SourceNoise(most_fast_m=0.004, lasting_m=0.0, calm_hz=16.0),
    # Networks see points 20 to 30 mm off for 0.2 to 0.5 s, and 4 to 8 mm from frame to frame. Counted in full, these
    # errors would let the database outvote motion that it lacks (chosen on CMU's 07_01, 14_08 and 49_10).
    PointKind.KEYPOINTS: SourceNoise(most_fast_m=0.015, lasting_m=0.012, calm_hz=4.0),
}


def noise_of(points: PointKind) -> SourceNoise:
    """Return the errors of a kind of points."""
    return _NOISES[points]
