"""Walk test: a one-sentence verdict on a short capture, with the most useful advice."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.scene_pose import PerformerPose
from ..geometry.arrays import Array
from ..markers.marker_noise import marker_noise

SHORTEST_S = 5.0  # long enough for steps with both legs and swings of both arms, s
# Limits beyond which a figure needs to be improved. The simulated studio reaches 0, 60, 0.05, 0.0001, 0.001, 0.98.
_LOST, _FPS, _HIDDEN, _NOISE_M, _RMS_M, _CONFIDENCE = 0.05, 25.0, 0.25, 0.003, 0.03, 0.7
_HIDDEN_ON_AVERAGE = 0.1
_POOR = 2.0  # multiple of a limit above which the verdict is poor


@dataclass(frozen=True)
class WalkFigures:
    """Figures of a test walk."""

    lost: float  # share of the frames that did not arrive
    fps: float  # rate of the frames that arrived, frames per second
    hidden: Array  # (M,) share of frames in which no camera saw the marker
    noise_m: float  # noise of a marker's position
    rms_m: float  # distance between located markers and the solved body
    confidence: float  # median over the poses
    error_deg: float  # expected error of a joint; NaN if the method does not estimate it


def walk_figures(poses: Sequence[PerformerPose], lost: int) -> WalkFigures | None:
    """Return the figures for successive poses, or None if they span too short a time.

    Args:
        lost: Number of frames that did not arrive during this time.
    """
    times_s = np.array([pose.time_s for pose in poses])
    if len(poses) < 2 or times_s[-1] - times_s[0] < SHORTEST_S:
        return None
    observed_m = np.array([pose.observed_m for pose in poses])
    singles = np.array([pose.single_cameras for pose in poses])
    distances_m = np.array([pose.marker_rms_m for pose in poses])
    errors = [float(pose.part_errors_deg.mean()) for pose in poses if len(pose.part_errors_deg)]
    return WalkFigures(
        lost=lost / (len(poses) + lost),
        fps=(len(poses) - 1) / float(times_s[-1] - times_s[0]),
        hidden=np.mean(~np.isfinite(observed_m).all(axis=2) & (singles < 0), axis=0),
        noise_m=float(np.median(marker_noise(times_s, observed_m))),
        rms_m=float(np.nanmedian(distances_m)) if np.isfinite(distances_m).any() else float("nan"),
        confidence=float(np.median([pose.confidence for pose in poses])),
        error_deg=float(np.median(errors)) if errors else float("nan"),
    )


def judge_walk(figures: WalkFigures, marker_texts: Sequence[str]) -> str:
    """Return a sentence that says how good captures will be, with the most useful advice."""
    severity, advice = max(_problems(figures, marker_texts))
    unfamiliarity = (1.0 - figures.confidence) / (1.0 - _CONFIDENCE)
    if severity < 1.0 <= unfamiliarity:  # the markers are fine, so the motion is the cause
        advice = "the motion is unlike the database: add motion like yours"
    severity = max(severity, unfamiliarity)
    verdict = "good" if severity < 1.0 else "usable" if severity < _POOR else "poor"
    is_known = severity < 1.0 and np.isfinite(figures.error_deg)  # the expected error is reliable only for a good walk
    within = f", joints within about {figures.error_deg:.0f} degrees" if is_known else ""
    return f"captures will be {verdict}{within}; {advice if severity >= 1.0 else 'nothing needs to change'}"


def _problems(figures: WalkFigures, marker_texts: Sequence[str]) -> list[tuple[float, str]]:
    """Return how bad each figure is relative to its limit, 1 at the limit, with advice on it."""
    worst = int(np.argmax(figures.hidden))
    most, usual = float(figures.hidden[worst]), float(figures.hidden.mean())
    noise_m, rms_m = figures.noise_m, 1.0 if np.isnan(figures.rms_m) else figures.rms_m
    where = f"the marker {marker_texts[worst]} is hidden {most:.0%} of the time"
    return [
        (figures.lost / _LOST, f"{figures.lost:.0%} of the images are lost: close other programs, or lower the rate"),
        (
            _FPS / figures.fps,
            f"only {figures.fps:.0f} images arrive each second: use a shorter exposure, or other cameras",
        ),
        (most / _HIDDEN, f"{where}: turn or raise a camera"),
        (usual / _HIDDEN_ON_AVERAGE, f"markers are hidden {usual:.0%} of the time: check light, focus and exposure"),
        (noise_m / _NOISE_M, f"markers jitter by {1e3 * noise_m:.0f} mm: focus, or use larger markers"),
        (rms_m / _RMS_M, f"markers are {1e3 * rms_m:.0f} mm off the body: calibrate the performer again"),
    ]
