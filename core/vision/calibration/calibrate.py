"""Camera calibration from board pictures: lenses, relative poses, and advice.

OpenCV starts with "A flexible new technique for camera calibration" (Zhang 2000); a bundle adjustment then refines all
cameras and board poses together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import cv2
import numpy as np

from ...errors import CalibrationError, counted
from ...geometry.arrays import Array
from ...geometry.camera import WORLD_FROM_CAMERA, Camera, CameraRig
from ...geometry.rigid_transform import nearest_rotation
from .board_quality import Coverage, coverage
from .bundle import Bundle, CornerObservation, adjust, intrinsics_of, matrix_of, rms, rms_by_moment
from .calibration_board import BoardView
from .relative_pose import pose_matrix
from .rig_fit import (
    MINIMUM_VIEWS,
    NO_SKEW,
    CameraViews,
    Rejected,
    RigFit,
    SingleCamera,
    fit_of_one,
    fit_rig,
    is_outlier,
    lens_prior,
)


@dataclass(frozen=True)
class VerdictSettings:
    """Limits for a good and for a usable calibration; image lengths are fractions of the image's width."""

    good_views: int = 8  # fewest moments in which more than one camera sees the board
    good_rms: float = 0.5 / 640.0
    usable_rms: float = 1.2 / 640.0
    good_coverage: float = 0.25  # smallest share of an image that the board has covered
    good_coverage_in_the_middle: float = 0.5  # the same for a board that never came near any edge of the image
    good_distance: float = 0.002  # largest relative standard deviation of the distances between cameras
    good_tilt_deg: float = 15.0  # smallest tilt of the most tilted board
    good_delay_s: float = 0.02  # largest delay between cameras
    smeared: float = 4.0 / 640.0  # width above which edges are blurred
    usable_distance: float = 0.5  # above this, the distances between the cameras are unknown
    same_picture: float = 5e-4  # median difference of corners below which two pictures are copies
    smeared_one_way: float = 1.5  # ratio of edge widths above which motion smears them; below, they are out of focus


_VERDICT = VerdictSettings()


class ExchangedCamerasError(CalibrationError):
    """The camera given as the left one stands to the right of the other."""


@dataclass(frozen=True)
class CalibrationResult:
    """A calibrated rig and its accuracy; errors are RMS reprojection errors."""

    rig: CameraRig  # in the world of the first camera: y up, z towards it, x to the performer's left
    stereo_rms_px: float  # over all cameras with one board pose per moment
    held_out_px: float  # for moments left out of the fit; NaN if there are too few
    rms_px: Mapping[str, float]  # for each camera alone
    baseline_m: float  # distance between the first two optical centres; 0 for one camera
    distance_sigma: float  # largest relative standard deviation of the distances between cameras
    views_px: Mapping[tuple[str, str], float]  # by moment and camera
    coverage: Mapping[str, float]  # share of each camera's image that the board has covered
    late_s: Mapping[str, float]  # delay of each camera relative to the first; only for videos of a moving board
    used: tuple[str, ...]  # names of the moments used
    rejected: tuple[Rejected, ...] = ()
    verdict: str = "good"  # "good", "usable" or "redo"
    advice: tuple[str, ...] = ()


def calibration_summary(result: CalibrationResult, square_m: float = 0.0) -> dict[str, Any]:
    """Return a calibration's summary; `square_m` is the side of the board's squares, 0 if unknown."""
    summary: dict[str, Any] = {
        "verdict": result.verdict,
        "stereo_rms_px": result.stereo_rms_px,
        "held_out_rms_px": result.held_out_px,
        "rms_px": dict(result.rms_px),
        "coverage": dict(result.coverage),
        "used": len(result.used),
        "rejected": [{"picture": row.picture, "reason": row.reason} for row in result.rejected],
        "views_px": {
            name: {picture: error for (picture, camera), error in result.views_px.items() if camera == name}
            for name in result.rms_px
        },
        "advice": list(result.advice),
    }
    if len(result.rig) > 1:
        summary["baseline_mm"] = result.baseline_m * 1000.0
        summary["distance_sigma_percent"] = 100.0 * result.distance_sigma
    if result.late_s:
        summary["late_ms"] = {name: 1000.0 * late for name, late in result.late_s.items()}
    if square_m and len(result.rig) > 1:
        summary["baseline_squares"] = result.baseline_m / square_m
    return summary


def calibrate_from_points(
    points_m: Array,
    cameras: Sequence[CameraViews],
    rejected: Sequence[Rejected] = (),
    *,
    left_right: bool = True,
    ambiguous: bool = False,
) -> CalibrationResult:
    """Calibrate from board points (N, 3) and the positions at which each camera saw them.

    Args:
        points_m: Board points, z = 0.
        cameras: Views of each camera; a single camera stands at the world's origin, and only its lens is calibrated.
        rejected: Pictures already rejected, to be listed in the result.
        left_right: Check that the first two cameras are the left and the right one, as seen from behind the cameras.
        ambiguous: Whether the board looks the same after half a turn (see `Board.is_ambiguous`).

    Raises:
        ExchangedCamerasError: The first camera stands to the right of the second.
        CalibrationError: There are too few views, cameras never saw the board together, or the pictures do not belong
            together.
    """
    if not cameras:
        raise CalibrationError("there is no camera to calibrate", advice="give pictures of the board")
    _check_different(cameras)
    refused = list(rejected)
    singles = [_calibrate_camera(points_m, camera, refused) for camera in cameras]
    if len(cameras) == 1:
        fit = fit_of_one(singles[0])
    else:
        centre = points_m.mean(axis=0) if ambiguous else None
        fit = fit_rig(points_m, cameras, singles, refused, centre)
        centre = np.linalg.inv(fit.poses[1])[:3, 3]  # second camera, in the first one's frame
        if left_right and centre[0] < -0.5 * np.linalg.norm(centre):
            raise ExchangedCamerasError(
                f"camera {cameras[0].name} stands on the right, camera {cameras[1].name} on the left",
                advice="exchange the two cameras or their pictures",
            )
    return _result(cameras, singles, fit, refused)


def _check_different(cameras: Sequence[CameraViews]) -> None:
    """Raise CalibrationError if two cameras have the same pictures."""
    for one, other in combinations(cameras, 2):
        apart = []
        for key in one.views.keys() & other.views.keys():
            own, theirs = one.views[key], other.views[key]
            _, at, there = np.intersect1d(own.ids, theirs.ids, return_indices=True)
            shown = own.pixels[at] / one.image_size[0] - theirs.pixels[there] / other.image_size[0]
            apart += [float(np.median(np.linalg.norm(shown, axis=1)))] if len(at) else []
        if len(apart) >= MINIMUM_VIEWS and np.median(apart) < _VERDICT.same_picture:
            raise CalibrationError(
                f"cameras {one.name} and {other.name} have the same pictures", advice="give each camera its own"
            )


def _calibrate_camera(points_m: Array, camera: CameraViews, refused: list[Rejected]) -> SingleCamera:
    keys = sorted(camera.views)
    bundle: Bundle | None = None
    while True:
        if len(keys) < MINIMUM_VIEWS:
            raise CalibrationError(
                f"only {counted(len(keys), 'picture')} of the board can be used, but {MINIMUM_VIEWS} are needed",
                where=f"camera {camera.name}",
                advice="take 12 or more pictures, with the board tilted differently and in all parts of the image",
            )
        views = [camera.views[key] for key in keys]
        start = bundle or _first_guess(points_m, camera, views)
        observations = [CornerObservation(0, m, points_m[view.ids], view.pixels) for m, view in enumerate(views)]
        bundle = adjust(start, observations, NO_SKEW, lens_prior([camera.image_size]))
        errors = rms_by_moment(bundle, observations)[:, 0]
        if not is_outlier(errors).any():
            poses = {key: pose_matrix(row) for key, row in zip(keys, bundle.boards, strict=True)}
            error = rms(bundle, observations)
            return SingleCamera(camera.name, camera.image_size, bundle.intrinsics[0], error, poses)
        worst = int(np.argmax(errors))
        refused.append(Rejected(f"{camera.name} {keys[worst]}", f"board points do not fit ({errors[worst]:.2f} px)"))
        del keys[worst]
        bundle = replace(bundle, boards=np.delete(bundle.boards, worst, axis=0))


def _first_guess(points_m: Array, camera: CameraViews, views: Sequence[BoardView]) -> Bundle:
    """Return a lens with its axis at the image's centre, and the boards' poses."""
    objects = [np.ascontiguousarray(points_m[view.ids], dtype=np.float32) for view in views]
    images = [np.ascontiguousarray(view.pixels, dtype=np.float32).reshape(-1, 1, 2) for view in views]
    flags = cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    try:
        _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
            objects,
            images,
            camera.image_size,
            None,
            None,
            flags=flags,  # type: ignore[call-overload]
        )
    except cv2.error as error:
        raise CalibrationError(
            f"the board's pictures do not determine the camera ({error.err})",
            where=f"camera {camera.name}",
            advice="tilt the board differently in each picture and fill the whole image with it",
        ) from error
    boards = np.array([np.concatenate((np.ravel(a), np.ravel(b))) for a, b in zip(turns, shifts, strict=True)])
    return Bundle(intrinsics_of(matrix, distortion)[None], np.zeros((1, 6)), boards)


def _result(
    views: Sequence[CameraViews], singles: Sequence[SingleCamera], fit: RigFit, refused: Sequence[Rejected]
) -> CalibrationResult:
    seen = {camera.name: coverage(camera.views.values(), camera.image_size) for camera in views}
    cameras = tuple(
        Camera(
            single.name,
            single.image_size,
            matrix_of(intrinsics),
            intrinsics[5:],
            nearest_rotation(pose[:3, :3]) @ WORLD_FROM_CAMERA.T,
            pose[:3, 3],
        )
        for single, intrinsics, pose in zip(singles, fit.intrinsics, fit.poses, strict=True)
    )
    names = [single.name for single in singles]
    late_s = {name: float(late) for name, late in zip(names, fit.late_s, strict=True) if np.isfinite(late)}
    advice = (*_fit_advice(fit, singles, late_s), *_picture_advice(views, seen))
    verdict = "usable" if advice else "good"
    is_unknown = not fit.distance_sigma <= _VERDICT.usable_distance and len(cameras) > 1
    if fit.rms_px > _VERDICT.usable_rms * singles[0].image_size[0] or is_unknown:
        verdict = "redo"
    rig = CameraRig(cameras, {"error": fit.rms_px, "pictures": len(fit.used), "verdict": verdict})
    return CalibrationResult(
        rig=rig,
        stereo_rms_px=fit.rms_px,
        held_out_px=fit.held_out_px,
        rms_px={single.name: single.rms_px for single in singles},
        baseline_m=rig.baseline_m() if len(rig) > 1 else 0.0,
        distance_sigma=fit.distance_sigma,
        views_px={
            (fit.used[m], names[c]): float(fit.errors_px[m, c]) for m, c in np.argwhere(np.isfinite(fit.errors_px))
        },
        coverage={name: part.fraction for name, part in seen.items()},
        late_s=late_s,
        used=fit.used,
        rejected=tuple(refused),
        verdict=verdict,
        advice=advice,
    )


def _fit_advice(fit: RigFit, singles: Sequence[SingleCamera], late_s: Mapping[str, float]) -> list[str]:
    advice = []
    if fit.rms_px > _VERDICT.good_rms * singles[0].image_size[0]:
        advice.append("the error is high: keep the board flat and still, use more light, focus the cameras")
    if len(fit.used) < _VERDICT.good_views:
        seen_by = " by more than one camera" if len(singles) > 1 else ""
        advice.append(f"the board was seen{seen_by} in only {counted(len(fit.used), 'moment')}: take 12 or more")
    if fit.distance_sigma > _VERDICT.good_distance:
        advice.append(
            f"the distances between the cameras are only known to within {100.0 * fit.distance_sigma:.1f} %: take more "
            "pictures of the board, closer and in all parts of the images, or use a larger board"
        )
    for camera in singles:
        most_tilted = min(abs(pose[2, 2]) for pose in camera.poses.values())
        if most_tilted > np.cos(np.radians(_VERDICT.good_tilt_deg)):
            advice.append(f"{camera.name} saw the board only almost face-on: tilt it by 20 to 45 degrees")
    if np.ptp([*late_s.values(), 0.0]) >= _VERDICT.good_delay_s:
        delays = ", ".join(f"{name} {1000.0 * late:+.0f} ms" for name, late in late_s.items())
        advice.append(
            f"the cameras do not take their pictures at the same time ({delays}): hold the board still in each place"
        )
    return advice


def _picture_advice(cameras: Sequence[CameraViews], seen: Mapping[str, Coverage]) -> list[str]:
    advice = []
    for camera in cameras:
        part = seen[camera.name]
        if part.fraction < (_VERDICT.good_coverage_in_the_middle if part.in_the_middle else _VERDICT.good_coverage):
            what = "stayed in the middle of" if part.in_the_middle else "was only in a part of"
            advice.append(
                f"the board {what} {camera.name}'s picture: coverage {100.0 * part.fraction:.0f} %; "
                "hold it near the sides and in the corners too"
            )
        measured = [view.edge_widths_px for view in camera.views.values() if view.edge_widths_px is not None]
        widths = np.array(measured, dtype=np.float64).reshape(-1, 2)
        widths = widths[np.isfinite(widths).all(axis=1)]
        if not len(widths):
            continue
        width = float(np.median(widths.max(axis=1)))
        if width > _VERDICT.smeared * camera.image_size[0]:
            smeared = float(np.median(widths.max(axis=1) / widths.min(axis=1))) > _VERDICT.smeared_one_way
            advice.append(
                f"{camera.name}: exposure too long: corners smeared over {width:.0f} pixels; hold the board still, "
                "or use more light and a shorter exposure"
                if smeared
                else f"{camera.name} is out of focus: edges {width:.0f} pixels wide"
            )
    return advice
