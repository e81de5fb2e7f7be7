"""Quality of tracking: agreement of pose and markers, and detection of lost or mislabelled bodies."""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..body.pose_notes import NoteKind
from ..body.scene_pose import PerformerPose
from ..geometry.arrays import Mask
from ..markers.source_noise import SourceNoise
from ..solver.observation import Observation
from ..solver.solution import Solution


@dataclass(frozen=True)
class TrackingSettings:
    """Thresholds for tracking."""

    explained_m: float = 0.03  # distance between solved and observed markers at which they explain 1/e
    familiar_m: float = 0.15  # distance to the closest example at which the agreement has fallen to 1/e
    wrong_m: float = 0.10  # distance between solved and observed markers above which labels or pose are wrong
    # multiples of the RMS length of the source's lasting errors that are added in quadrature to explained_m and wrong_m
    lasting: tuple[float, float] = (3.5, 8.0)
    wrong_for_s: float = 0.5  # time with such distances after which labelling restarts
    lost_for_s: float = 1.0  # time with too few torso markers after which labelling restarts
    torso_markers: int = 2  # fewest torso markers of a tracked body


SETTINGS = TrackingSettings()


def tracking_of(source: SourceNoise) -> TrackingSettings:
    """Return the thresholds for points with the errors of a source."""
    lasting_m = math.sqrt(3.0) * source.lasting_m  # RMS length, from the standard deviation per axis
    explained_m, wrong_m = (
        math.hypot(usual_m, times * lasting_m)
        for usual_m, times in zip((SETTINGS.explained_m, SETTINGS.wrong_m), SETTINGS.lasting, strict=True)
    )
    return replace(SETTINGS, explained_m=explained_m, wrong_m=wrong_m)


@dataclass(frozen=True)
class Fit:
    """How well a solution agrees with its observation."""

    located: Mask  # (M,) located markers
    rms_m: float  # RMS distance between located and solved markers; NaN if none was located
    explained: float  # 0 (nothing seen, or far from the solved markers) to 1 (no distance); at most 0.5 with rays only
    agreement: float  # share of the markers that are seen, explained, and like those of an example: judges labels


def assess_fit(observation: Observation, solution: Solution, settings: TrackingSettings = SETTINGS) -> Fit:
    """Return how well a solution agrees with the located markers of an observation."""
    located = observation.located
    away_m = solution.markers_m[located] - observation.points_m[located]
    rms_m = math.sqrt(float(np.vdot(away_m, away_m)) / len(away_m)) if len(away_m) else math.nan
    seen = (len(away_m) + 0.5 * np.count_nonzero(observation.single)) / len(located)
    if len(away_m) == 0:
        return Fit(located, rms_m, seen, seen)
    explained = math.exp(-((rms_m / settings.explained_m) ** 2))
    familiarity = math.exp(-((solution.nearest_m / settings.familiar_m) ** 2))
    return Fit(located, rms_m, explained, seen * explained * familiarity)


class _Lapse:
    """Stopwatch for the time since a condition last held."""

    def __init__(self) -> None:
        self._since_s: float | None = None

    def update(self, now_s: float, holds: bool) -> float:
        """Return for how long the condition has not held; before the first update it is assumed to hold."""
        if holds or self._since_s is None:
            self._since_s = now_s
        return now_s - self._since_s


class TrackingQuality:
    """Decides when a tracked body is lost.

    Args:
        one_camera: There is only one camera, so markers on its rays count as seen.
    """

    def __init__(self, torso: Mask, one_camera: bool, settings: TrackingSettings = SETTINGS) -> None:
        self._torso, self._one_camera = torso, one_camera
        self.settings = settings
        self.reset()

    def reset(self) -> None:
        """Forget the poses so far."""
        self._unseen, self._wrong = _Lapse(), _Lapse()

    def reason_lost(self, pose: PerformerPose) -> NoteKind | None:
        """Return why the body is lost, or None: its torso was hidden, or its pose was wrong, for too long."""
        settings, now_s = self.settings, pose.time_s
        seen = np.isfinite(pose.observed_m[:, 0])
        if self._one_camera:
            seen |= pose.single_cameras >= 0
        unseen_s = self._unseen.update(now_s, np.count_nonzero(seen & self._torso) >= settings.torso_markers)
        wrong_s = self._wrong.update(now_s, not pose.marker_rms_m > settings.wrong_m)
        if unseen_s > settings.lost_for_s:
            return NoteKind.TORSO_LOST
        return NoteKind.MISFIT if wrong_s > settings.wrong_for_s else None
