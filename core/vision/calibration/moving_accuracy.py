"""Accuracy of cameras that a moving target calibrated, verdict, and advice for a better calibration."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ...geometry import rotations as rot
from ...geometry.arrays import Array
from ...geometry.camera import Camera
from .point_bundle import PER_CAMERA, PointBundle, moved_camera, reprojection_errors


@dataclass(frozen=True)
class MovingLimits:
    """Limits for a good and for a usable calibration."""

    draws: int = 200  # number of random sets of cameras that measure the accuracy
    good_angle_deg: float = 0.5  # largest standard deviation of the angles between cameras
    usable_angle_deg: float = 2.0
    good_distance: float = 0.035  # largest relative standard deviation of the distances between cameras
    usable_distance: float = 0.15
    good_focal: float = 0.02  # largest relative standard deviation of a focal length
    good_view_deg: tuple[float, float] = (40.0, 140.0)  # angles between cameras, as the target sees them
    least_view_deg: float = 8.0  # smaller angles determine nothing
    good_together: float = 0.5  # share of the moments at which a camera sees the target together with another
    good_delay_s: float = 0.02  # largest delay between cameras
    good_coverage: float = 0.15  # smallest share of an image that the target has covered
    good_s: float = 15.0  # shortest time for which a good calibration is possible


LIMITS = MovingLimits()


@dataclass(frozen=True)
class MovingAccuracy:
    """How well cameras are known; standard deviations."""

    angle_sigma_deg: float  # largest, of the angles between two cameras
    distance_sigma: float  # largest, relative, of the distances between cameras
    focal_sigmas: Array  # (C,) relative
    views_deg: Array  # angles between each two cameras, as the target sees them


def accuracy_of(bundle: PointBundle, scale_sigma: float) -> MovingAccuracy:
    """Return the accuracy of an adjusted bundle, from random cameras with its covariance.

    Args:
        scale_sigma: Relative standard deviation of the target's size.
    """
    covariance, count = bundle.covariance(), len(bundle.cameras)
    draws = np.random.default_rng(0).multivariate_normal(
        np.zeros(len(covariance)), covariance, LIMITS.draws, method="eigh"
    )
    steps = draws[:, : count * PER_CAMERA].reshape(-1, count, PER_CAMERA)
    drawn = [[moved_camera(*each) for each in zip(bundle.cameras, row, strict=True)] for row in steps]
    turns = np.array([_turns(cameras) for cameras in drawn])
    angles = rot.angle_between(turns, _turns(bundle.cameras)[None])
    sizes = np.array([_distances(cameras) for cameras in drawn]) / _distances(bundle.cameras)
    if len(bundle.bones_m):
        longer = draws[:, count * PER_CAMERA :] / np.maximum(bundle.bones_m, 1e-3)
        sizes = sizes / np.exp(np.median(longer, axis=1))[:, None]
    return MovingAccuracy(
        float(np.degrees(np.sqrt(np.mean(angles**2, axis=0)).max())),
        float(np.hypot(np.sqrt(np.mean((sizes - 1.0) ** 2, axis=0)).max(), scale_sigma)),
        np.where(bundle.is_free, steps[..., 6].std(axis=0), 0.0),
        _views_deg(bundle),
    )


def verdict_of(accuracy: MovingAccuracy) -> str:
    """Return "good", "usable" or "redo" by the accuracy alone."""
    limits = (
        ("good", LIMITS.good_angle_deg, LIMITS.good_distance),
        ("usable", LIMITS.usable_angle_deg, LIMITS.usable_distance),
    )
    for verdict, angle_deg, distance in limits:
        if accuracy.angle_sigma_deg <= angle_deg and accuracy.distance_sigma <= distance:
            return verdict
    return "redo"


def rms_px(bundle: PointBundle) -> Array:
    """Return each camera's reprojection error (C,) along both axes, pixels, from the median, which wrong points leave.

    The median of a two-dimensional error is 0.833 of its RMS.
    """
    lengths = np.linalg.norm(reprojection_errors(bundle), axis=-1)
    return np.nanmedian(lengths, axis=(0, 2)) / np.sqrt(np.log(2.0))


def moving_advice(bundle: PointBundle, accuracy: MovingAccuracy, coverage: Sequence[float]) -> list[str]:
    """Return what would make the calibration better.

    Args:
        coverage: Share of each camera's image that the target has covered.
    """
    names, seen = [camera.name for camera in bundle.cameras], bundle.sightings
    advice = []
    low, high = LIMITS.good_view_deg
    if not np.any((accuracy.views_deg >= low) & (accuracy.views_deg <= high)):
        nearest = accuracy.views_deg[np.argmin(np.abs(accuracy.views_deg - 90.0))]
        advice.append(f"the cameras look from directions {nearest:.0f} degrees apart: 60 to 110 degrees are best")
    together = seen.seen.any(axis=2).mean(axis=0)
    for name, share, part in zip(names, together, coverage, strict=True):
        if share < LIMITS.good_together:
            advice.append(
                f"{name} and another camera saw the same in only {100.0 * share:.0f} % of the moments: move where "
                "both see it"
            )
        elif part < LIMITS.good_coverage:
            advice.append(
                f"only {100.0 * part:.0f} % of {name}'s picture were used: come nearer, and move through the whole room"
            )
    spent_s = float(np.ptp(seen.times_s))
    if spent_s < LIMITS.good_s:
        advice.append(f"the recording shows {spent_s:.0f} s of motion: 20 s or more are better")
    if accuracy.angle_sigma_deg > LIMITS.good_angle_deg:
        advice.append(
            f"the angles between the cameras are only known to within {accuracy.angle_sigma_deg:.1f} degrees: move for "
            "longer, nearer to the cameras, and through the whole room"
        )
    for name, sigma, free in zip(names, accuracy.focal_sigmas, bundle.is_free, strict=True):
        if free and sigma > LIMITS.good_focal:
            advice.append(
                f"the focal length of {name} is only known to within {100.0 * sigma:.0f} %: calibrate its lens with "
                "the board once, and give that calibration"
            )
    if np.ptp(bundle.delays_s) >= LIMITS.good_delay_s:
        delays = ", ".join(f"{name} {1e3 * late:+.0f} ms" for name, late in zip(names, bundle.delays_s, strict=True))
        advice.append(f"the cameras do not take their pictures at the same time ({delays}): use the same rate for all")
    return advice


def _turns(cameras: Sequence[Camera]) -> Array:
    """Return the rotations (P, 4) between each two cameras."""
    pairs = combinations(cameras, 2)
    return rot.from_matrix(np.array([second.rotation @ first.rotation.T for first, second in pairs]))


def _distances(cameras: Sequence[Camera]) -> Array:
    return np.array([np.linalg.norm(a.centre_m - b.centre_m) for a, b in combinations(cameras, 2)])


def _views_deg(bundle: PointBundle) -> Array:
    """Return the median angles (P,) between the rays of each two cameras to the points."""
    points = bundle.points_m[bundle.sightings.seen.any(axis=1)]
    rays = [
        (each.centre_m - points) / np.linalg.norm(each.centre_m - points, axis=1)[:, None] for each in bundle.cameras
    ]
    cosines = [np.median(np.sum(a * b, axis=1)) for a, b in combinations(rays, 2)]
    return np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
