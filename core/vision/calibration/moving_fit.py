"""Fit of cameras to a moving target: are they in step, rough poses, bundle adjustment, size."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import CalibrationError
from ...geometry.arrays import Array, Mask, median_of_known
from ...geometry.camera import Camera, CameraRig
from ...geometry.lens_check import lens_fault
from ...geometry.triangulation import triangulate
from .moving_targets import MovingTarget
from .point_bundle import PointBundle, Sightings, adjust_points
from .two_view_start import place_cameras, place_two


@dataclass(frozen=True)
class MovingFitSettings:
    """Settings of the fit."""

    usual_focal: float = 0.85  # focal length of an unknown lens, in units of the image's longer side
    started: tuple[float, ...] = (0.65, 0.85, 1.15)  # focal lengths from which unknown lenses are adjusted
    gate: float = 1.0  # largest distance from the epipolar line at the start, in units of the median deviation
    rounds: int = 2  # number of times that points are matched again with better cameras
    latest_s: float = 1.5  # largest difference between cameras' clocks that is recognised
    in_step_s: float = 0.15  # smaller differences are estimated with the cameras
    out_of_step: float = 1.2  # ratio of agreeing points at another time to those at the same time
    step_points: int = 200  # number of points that are compared at each time


_S = MovingFitSettings()
_AGAIN = "move for longer and through the whole room, or calibrate the lenses with the board"


def usual_camera(name: str, image_size: tuple[int, int]) -> Camera:
    """Return a camera with the lens of an ordinary webcam or phone."""
    return _with_focal(Camera(name, image_size, np.eye(3)), _S.usual_focal)


def cameras_with_lenses(
    names: Sequence[str], sizes: Sequence[tuple[int, int]], lenses: CameraRig | None
) -> tuple[list[Camera], Mask]:
    """Return cameras of these names and image sizes with their lenses, and which lenses (C,) are unknown.

    Args:
        lenses: Calibration whose lenses the cameras of the same names have; None if no lens is known.

    Raises:
        CalibrationError: The calibration lacks one of the cameras.
    """
    known = {camera.name: camera for camera in lenses.cameras} if lenses else {}
    for name in names:
        if lenses and name not in known:
            what = f"has no lens of {name}, but those of {', '.join(known)}"
            raise CalibrationError(what, advice="name the cameras alike")
    cameras = [known.get(name) or usual_camera(name, size) for name, size in zip(names, sizes, strict=True)]
    return cameras, np.array([name not in known for name in names])


def fit_moving(cameras: Sequence[Camera], is_free: Mask, target: MovingTarget) -> PointBundle:
    """Return the cameras adjusted to a target, in metres and in the frame of the first camera.

    Args:
        cameras: Cameras with known lenses or with usual ones; their poses are not used.
        is_free: Whether a camera's lens (C,) is unknown.

    Raises:
        CalibrationError: The cameras were not in step, or saw too little together.
    """
    seen = target.sightings()
    _check_in_step(cameras, seen)
    starts = [_start(cameras, is_free, target, seen, share) for share in (_S.started if is_free.any() else (1.0,))]
    try:
        bundle = min((adjust_points(start) for start in starts), key=lambda each: each.near.reduced.cost)
        for _ in range(_S.rounds):
            bundle = _located(bundle, target.sightings(bundle.cameras))
            bundle = adjust_points(_scaled(bundle, target.scale(bundle)))
    except np.linalg.LinAlgError as error:
        raise CalibrationError("what the cameras saw does not determine where they are", advice=_AGAIN) from error
    for camera, free in zip(bundle.cameras, is_free, strict=True):
        if free and (fault := lens_fault(camera)):
            raise CalibrationError(f"{camera.name} {fault}", advice=_AGAIN)
    return _scaled(bundle, target.scale(bundle))


def _with_focal(camera: Camera, share: float) -> Camera:
    width, height = camera.image_size
    focal = share * max(width, height)
    matrix = np.array([[focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])
    return replace(camera, matrix=matrix)


def _gate(cameras: Sequence[Camera], seen: Sightings) -> float:
    focal = float(np.mean([camera.focal_px for camera in cameras]))
    return _S.gate * float(np.median(seen.sigmas_px[np.isfinite(seen.pixels[..., 0])])) / focal


def _normalised(cameras: Sequence[Camera], seen: Sightings) -> Array:
    return np.stack([camera.undistort(seen.pixels[:, c]) for c, camera in enumerate(cameras)], axis=1)


def _check_in_step(cameras: Sequence[Camera], seen: Sightings) -> None:
    """Raise CalibrationError if far more points agree when one camera's times are changed."""
    points, gate = _normalised(cameras, seen), _gate(cameras, seen)
    step_s = float(np.median(np.diff(seen.times_s)))
    most = min(round(_S.latest_s / step_s), len(points) // 2)
    for c in range(1, len(cameras)):
        counts = {}
        for lag in range(-most, most + 1):
            first, second = (points[max(0, -lag) :, 0], points[max(0, lag) :, c])
            shared = min(len(first), len(second))
            found = place_two(first[:shared].reshape(-1, 2), second[:shared].reshape(-1, 2), gate, _S.step_points)
            counts[lag] = 0.0 if found is None else found.agreeing / found.used
        best = max(counts, key=lambda lag: counts[lag])
        is_better = counts[best] > _S.out_of_step * counts[0] > 0.0
        if is_better and abs(best) * step_s > _S.in_step_s:
            late, early = (cameras[c], cameras[0]) if best > 0 else (cameras[0], cameras[c])
            raise CalibrationError(
                f"the pictures of {late.name} are about {abs(best) * step_s:.1f} s behind those of {early.name}",
                advice="start both recordings at the same moment, or cut them so that they begin together",
            )


def _start(
    cameras: Sequence[Camera], is_free: Mask, target: MovingTarget, seen: Sightings, share: float
) -> PointBundle:
    begun = [_with_focal(each, share) if free else each for each, free in zip(cameras, is_free, strict=True)]
    points = _normalised(begun, seen).swapaxes(1, 2).reshape(-1, len(begun), 2)
    placed = place_cameras(begun, points, _gate(begun, seen))
    if isinstance(placed, int):
        others = " and ".join(camera.name for c, camera in enumerate(cameras) if c != placed)
        raise CalibrationError(
            f"{cameras[placed].name} and {others} saw too little of it at the same time",
            advice="move where at least two cameras see it, and begin the recordings at the same moment",
        )
    none = np.zeros(len(cameras))
    blank = PointBundle(seen, tuple(cameras), tuple(placed), is_free, none, np.empty(0), np.empty((0, 0, 3)))
    bundle = _located(blank, seen)
    return _scaled(bundle, target.scale(bundle))


def _located(bundle: PointBundle, seen: Sightings) -> PointBundle:
    """Return the bundle with other sightings, and points and bones from the present cameras."""
    frames, count, points_seen = len(seen.times_s), len(bundle.cameras), seen.pixels.shape[2]
    normalised = _normalised(bundle.cameras, seen).swapaxes(1, 2).reshape(-1, count, 2)
    weights = seen.seen.swapaxes(1, 2).reshape(-1, count).astype(np.float64)
    known = weights.any(axis=1)
    points = np.full((len(weights), 3), np.nan)
    points[known] = triangulate(bundle.cameras, normalised[known], weights[known], 1.0)[0]
    points = points.reshape(frames, points_seen, 3)
    apart = points[:, seen.bones[:, 0]] - points[:, seen.bones[:, 1]]
    bones = median_of_known(np.linalg.norm(apart, axis=-1))
    return replace(bundle, sightings=seen, bones_m=np.nan_to_num(bones, nan=1.0), points_m=np.nan_to_num(points))


def _scaled(bundle: PointBundle, scale: float) -> PointBundle:
    """Return the bundle with all lengths multiplied."""
    return replace(
        bundle,
        cameras=tuple(replace(each, translation_m=scale * each.translation_m) for each in bundle.cameras),
        apart_m=scale * float(np.linalg.norm(bundle.cameras[1].translation_m)),
        bones_m=scale * bundle.bones_m,
        points_m=scale * bundle.points_m,
    )
