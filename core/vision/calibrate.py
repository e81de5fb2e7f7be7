"""Calibrating cameras from pictures of a planar board: intrinsics, relative pose, what was wrong with which picture.

Zhang, "A flexible new technique for camera calibration" (2000), through OpenCV; then all cameras and the
board's poses are refined together (`bundle`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..camera import WORLD_FROM_CAMERA, Camera, CameraRig
from ..errors import CalibrationError
from .board import Board, BoardView
from .bundle import matrix_of
from .relative_pose import Transform, inverse
from .rig_fit import MINIMUM_VIEWS, CameraViews, Rejected, RigFit, SingleCamera, fit_rig, is_outlier

Array = NDArray[np.float64]

_GOOD_VIEWS = 8
_CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-9)
_OUTLIER_FACTOR = 3.0
_OUTLIER_FLOOR_PX = 0.3
_GOOD_RMS = 0.5 / 640.0  # of the image width
_USABLE_RMS = 1.2 / 640.0


@dataclass(frozen=True)
class CalibrationResult:
    """A calibrated rig and how far to trust it.

    Args:
        rig: cameras in the world of the first one (y up, z towards it, x to its left as the performer sees it).
        stereo_rms_px: RMS reprojection error over all cameras with one board pose per moment.
        held_out_px: the same for moments left out of the fit; NaN with too few of them.
        rms_px: RMS reprojection error per camera, alone.
        baseline_m: distance of the first two optical centres.
        used: keys of the moments used for the relative pose.
        rejected: pictures not used, with reasons.
        verdict: "good", "usable" or "redo".
        advice: what would make it better, in plain words.
    """

    rig: CameraRig
    stereo_rms_px: float
    held_out_px: float
    rms_px: Mapping[str, float]
    baseline_m: float
    used: tuple[str, ...]
    rejected: tuple[Rejected, ...] = ()
    verdict: str = "good"
    advice: tuple[str, ...] = ()


def calibrate_from_points(
    points_m: Array,
    cameras: Sequence[CameraViews],
    rejected: Sequence[Rejected] = (),
    *,
    left_right: bool = True,
    grid: tuple[int, int] | None = None,
) -> CalibrationResult:
    """Calibrate from board points (N, 3) and where each camera saw them.

    Args:
        points_m: board points, z = 0.
        cameras: at least two cameras.
        rejected: pictures already refused, passed on to the result.
        left_right: the first two cameras are the left and the right one, as the cameras see it; checked.
        grid: inner corners (columns, rows) of a chessboard whose half-turn ambiguity is to be resolved; None
            when every point is identified.

    Raises:
        CalibrationError: too few views, cameras that never saw the board together, pictures that do not belong
            together, left and right exchanged.
    """
    if len(cameras) < 2:
        raise CalibrationError("one camera cannot be calibrated for 3D", advice="give pictures of two cameras")
    refused = list(rejected)
    singles = [_calibrate_camera(points_m, camera, refused) for camera in cameras]
    centre = points_m.mean(axis=0) if grid is not None else None
    fit = fit_rig(points_m, cameras, singles, refused, centre)
    if left_right:
        _check_sides(fit.poses[1], cameras[0].name, cameras[1].name)
    return _result(singles, fit, refused)


def _calibrate_camera(points_m: Array, camera: CameraViews, refused: list[Rejected]) -> SingleCamera:
    keys = sorted(camera.views)
    while True:
        if len(keys) < MINIMUM_VIEWS:
            raise CalibrationError(
                f"the board was seen well in {len(keys)} picture(s) only; at least {MINIMUM_VIEWS} are needed",
                where=f"camera {camera.name}",
                advice="take 12 or more pictures with the board tilted differently in all parts of the picture",
            )
        objects, images = _opencv_points(points_m, [camera.views[key] for key in keys])
        # a sixth-order term needs corners far from the centre in many views, else it bends the picture's edge
        flags = 0 if len(keys) >= _GOOD_VIEWS else cv2.CALIB_FIX_K3
        rms, matrix, distortion, turns, shifts, _, _, errors = _run_opencv(
            cv2.calibrateCameraExtended, objects, images, camera.image_size, None, None, flags=flags, criteria=_CRITERIA
        )
        errors = np.asarray(errors).ravel()
        outliers = is_outlier(errors)
        if not outliers.any():
            poses = {
                key: (cv2.Rodrigues(turn)[0], np.asarray(shift).ravel())
                for key, turn, shift in zip(keys, turns, shifts, strict=True)
            }
            return SingleCamera(camera.name, camera.image_size, matrix, np.ravel(distortion)[:5], float(rms), poses)
        worst = int(np.argmax(errors))
        refused.append(Rejected(f"{camera.name} {keys[worst]}", f"board points do not fit ({errors[worst]:.2f} px)"))
        del keys[worst]


def _opencv_points(points_m: Array, views: Sequence[BoardView]) -> tuple[list[Array], list[Array]]:
    objects = [np.ascontiguousarray(points_m[view.ids], dtype=np.float32) for view in views]
    images = [np.ascontiguousarray(view.pixels, dtype=np.float32).reshape(-1, 1, 2) for view in views]
    return objects, images  # type: ignore[return-value]


def _run_opencv(function: Any, *arguments: Any, **options: Any) -> Any:
    try:
        return function(*arguments, **options)
    except cv2.error as error:
        raise CalibrationError(
            f"the board's pictures do not determine the camera ({error.err})",
            advice="tilt the board differently in each picture and fill the whole image with it",
        ) from error


def _check_sides(second_from_first: Transform, left: str, right: str) -> None:
    centre = inverse(second_from_first)[1]  # of the second camera, in the first one's frame
    if centre[0] < -0.5 * np.linalg.norm(centre):
        raise CalibrationError(
            f"the pictures given for {left} come from the camera on the right and those for {right} from the left",
            advice="exchange --left and --right",
        )


def _result(singles: Sequence[SingleCamera], fit: RigFit, refused: Sequence[Rejected]) -> CalibrationResult:
    cameras = tuple(
        Camera(
            single.name,
            single.image_size,
            matrix_of(intrinsics),
            intrinsics[5:],
            _orthonormal(rotation) @ WORLD_FROM_CAMERA.T,
            translation,
        )
        for single, intrinsics, (rotation, translation) in zip(singles, fit.intrinsics, fit.poses, strict=True)
    )
    verdict, advice = _judge(fit, singles)
    metadata = {"error": fit.rms_px, "pictures": len(fit.used), "verdict": verdict}
    rig = CameraRig(cameras, metadata)
    return CalibrationResult(
        rig=rig,
        stereo_rms_px=fit.rms_px,
        held_out_px=fit.held_out_px,
        rms_px={single.name: single.rms_px for single in singles},
        baseline_m=rig.baseline_m(),
        used=fit.used,
        rejected=tuple(refused),
        verdict=verdict,
        advice=advice,
    )


def _orthonormal(rotation: Array) -> Array:
    u, _, vt = np.linalg.svd(rotation)
    return np.asarray(u @ vt)


def _judge(fit: RigFit, singles: Sequence[SingleCamera]) -> tuple[str, tuple[str, ...]]:
    width = singles[0].image_size[0]
    advice = []
    if fit.rms_px > _GOOD_RMS * width:
        advice.append("the error is high: keep the board flat and still, use more light, focus the cameras")
    if len(fit.used) < _GOOD_VIEWS:
        advice.append(f"only {len(fit.used)} moments show the board to more than one camera: take 12 or more")
    for camera in singles:
        tilts = [np.degrees(np.arccos(min(1.0, abs(r[2, 2])))) for r, _ in camera.poses.values()]
        if max(tilts) < 15.0:
            advice.append(f"{camera.name} saw the board almost straight on only: tilt it by 20 to 45 degrees")
    if fit.rms_px > _USABLE_RMS * width:
        return "redo", tuple(advice)
    return ("usable" if advice else "good"), tuple(advice)


def grid_of(board: Board) -> tuple[int, int] | None:
    """Return the grid whose half turns are ambiguous: a chessboard's, None for a board with markers."""
    return board.corner_grid if board.kind == "chessboard" else None
