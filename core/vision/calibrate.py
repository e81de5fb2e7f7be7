"""Calibrating cameras from pictures of a planar board: intrinsics, relative pose, what was wrong with which picture.

Zhang, "A flexible new technique for camera calibration" (2000), through OpenCV; then both cameras, their relative
pose and the board's poses are refined together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from ..camera import WORLD_FROM_CAMERA, Camera, CameraRig
from ..errors import CalibrationError
from .board import Board, BoardView
from .relative_pose import Transform, inverse, relative_poses

Array = NDArray[np.float64]

MINIMUM_VIEWS = 3
_GOOD_VIEWS = 8
_CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-9)
_OUTLIER_FACTOR = 3.0
_OUTLIER_FLOOR_PX = 0.3
_GOOD_RMS = 0.5 / 640.0  # of the image width
_USABLE_RMS = 1.2 / 640.0


@dataclass(frozen=True)
class CameraViews:
    """What one camera saw: image size (w, h) and the board views by picture key (same key = same moment)."""

    name: str
    image_size: tuple[int, int]
    views: Mapping[str, BoardView]


@dataclass(frozen=True)
class Rejected:
    """A picture that was not used, and why."""

    picture: str
    reason: str


@dataclass(frozen=True)
class CalibrationResult:
    """A calibrated rig and how far to trust it.

    Args:
        rig: cameras in the world of the first one (y up, z towards it, x to its left as the performer sees it).
        stereo_rms_px: RMS reprojection error over all cameras with one board pose per moment.
        rms_px: RMS reprojection error per camera, alone.
        baseline_m: distance of the first two optical centres.
        used: keys of the moments used for the relative pose.
        rejected: pictures not used, with reasons.
        verdict: "good", "usable" or "redo".
        advice: what would make it better, in plain words.
    """

    rig: CameraRig
    stereo_rms_px: float
    rms_px: Mapping[str, float]
    baseline_m: float
    used: tuple[str, ...]
    rejected: tuple[Rejected, ...] = ()
    verdict: str = "good"
    advice: tuple[str, ...] = ()


@dataclass
class _Intrinsics:
    """One camera while it is being calibrated; `poses` are camera-from-board by picture key."""

    name: str
    image_size: tuple[int, int]
    matrix: Array
    distortion: Array
    rms_px: float
    poses: dict[str, Transform] = field(default_factory=dict)


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
    intrinsics = [_calibrate_camera(points_m, camera, refused) for camera in cameras]
    rig_poses, pairs = _connect(points_m, cameras, intrinsics, refused, half_turns=grid is not None)
    if left_right:
        _check_sides(rig_poses[1], cameras[0].name, cameras[1].name)
    return _result(points_m, intrinsics, rig_poses, pairs, refused)


def _calibrate_camera(points_m: Array, camera: CameraViews, refused: list[Rejected]) -> _Intrinsics:
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
        outliers = _outliers(errors)
        if not outliers.any():
            poses = {
                key: (cv2.Rodrigues(turn)[0], np.asarray(shift).ravel())
                for key, turn, shift in zip(keys, turns, shifts, strict=True)
            }
            return _Intrinsics(camera.name, camera.image_size, matrix, np.ravel(distortion)[:5], float(rms), poses)
        worst = int(np.argmax(errors))
        refused.append(Rejected(f"{camera.name} {keys[worst]}", f"board points do not fit ({errors[worst]:.2f} px)"))
        del keys[worst]


def _outliers(errors: Array) -> NDArray[np.bool_]:
    typical = float(np.median(errors))
    return np.asarray(errors > max(_OUTLIER_FACTOR * typical, typical + _OUTLIER_FLOOR_PX))


def _opencv_points(points_m: Array, views: Sequence[BoardView]) -> tuple[list[Array], list[Array]]:
    objects = [np.ascontiguousarray(points_m[view.ids], dtype=np.float32) for view in views]
    images = [np.ascontiguousarray(view.pixels, dtype=np.float32).reshape(-1, 1, 2) for view in views]
    return objects, images  # type: ignore[return-value]


def _run_opencv(function, *arguments, **options):  # type: ignore[no-untyped-def]
    try:
        return function(*arguments, **options)
    except cv2.error as error:
        raise CalibrationError(
            f"the board's pictures do not determine the camera ({error.err})",
            advice="tilt the board differently in each picture and fill the whole image with it",
        ) from error


def _connect(
    points_m: Array,
    cameras: Sequence[CameraViews],
    intrinsics: Sequence[_Intrinsics],
    refused: list[Rejected],
    *,
    half_turns: bool,
) -> tuple[list[Transform], dict[tuple[int, int], "_Pair"]]:
    """Return camera-from-first-camera transforms and the calibrated pairs that form the tree."""
    poses: list[Transform | None] = [(np.eye(3), np.zeros(3))] + [None] * (len(cameras) - 1)
    pairs: dict[tuple[int, int], _Pair] = {}
    while any(pose is None for pose in poses):
        candidates = [
            (len(set(intrinsics[i].poses) & set(intrinsics[j].poses)), i, j)
            for i, known in enumerate(poses)
            for j, wanted in enumerate(poses)
            if known is not None and wanted is None
        ]
        shared, i, j = max(candidates, key=lambda row: (row[0], -row[1], -row[2]))
        if shared < MINIMUM_VIEWS:
            raise CalibrationError(
                f"cameras {cameras[i].name} and {cameras[j].name} saw the board together in {shared} picture(s) only",
                advice="hold the board where both see it, in at least 12 moments",
            )
        pair = _calibrate_pair(points_m, cameras[i], cameras[j], intrinsics[i], intrinsics[j], refused, half_turns)
        if not pairs and len(cameras) == 2:
            _adopt(intrinsics, pair)
        pairs[(i, j)] = pair
        rotation, translation = pair.transform
        base = poses[i]
        assert base is not None  # noqa: S101 - only known cameras are candidates
        poses[j] = (rotation @ base[0], rotation @ base[1] + translation)
    return [pose for pose in poses if pose is not None], pairs


@dataclass(frozen=True)
class _Pair:
    """Two cameras' refined intrinsics, second-from-first transform, error and the moments used."""

    matrices: tuple[Array, Array]
    distortions: tuple[Array, Array]
    transform: Transform
    rms_px: float
    used: tuple[str, ...]


def _adopt(intrinsics: Sequence[_Intrinsics], pair: _Pair) -> None:
    for camera, matrix, distortion in zip(intrinsics, pair.matrices, pair.distortions, strict=True):
        camera.matrix, camera.distortion = matrix, distortion


def _calibrate_pair(
    points_m: Array,
    first: CameraViews,
    second: CameraViews,
    a: _Intrinsics,
    b: _Intrinsics,
    refused: list[Rejected],
    half_turns: bool,
) -> _Pair:
    keys = sorted(set(a.poses) & set(b.poses))
    centre = points_m.mean(axis=0) if half_turns else None
    chosen = relative_poses([a.poses[key] for key in keys], [b.poses[key] for key in keys], centre)
    turned = {key: chosen.turned[i] for i, key in enumerate(keys)}
    refused += [
        Rejected(key, f"{first.name} and {second.name} do not show the board in the same place at this moment")
        for i, key in enumerate(keys)
        if not chosen.agrees[i]
    ]
    keys = [key for i, key in enumerate(keys) if chosen.agrees[i]]
    while True:
        if len(keys) < MINIMUM_VIEWS:
            raise CalibrationError(
                f"the pictures of {first.name} and {second.name} do not belong together",
                advice="check that both lists hold the same moments in the same order",
            )
        pair, errors = _stereo(points_m, first, second, a, b, keys, turned)
        outliers = _outliers(errors)
        if not outliers.any():
            return pair
        worst = int(np.argmax(errors))
        refused.append(Rejected(keys[worst], f"does not fit the other pictures ({errors[worst]:.2f} px)"))
        del keys[worst]


def _stereo(
    points_m: Array,
    first: CameraViews,
    second: CameraViews,
    a: _Intrinsics,
    b: _Intrinsics,
    keys: Sequence[str],
    turned: Mapping[str, bool],
) -> tuple[_Pair, Array]:
    objects, images_a, images_b = [], [], []
    for key in keys:
        ids, rows_a, rows_b = _common_points(first.views[key], second.views[key], turned[key])
        objects.append(np.ascontiguousarray(points_m[ids], dtype=np.float32))
        images_a.append(np.ascontiguousarray(rows_a, dtype=np.float32).reshape(-1, 1, 2))
        images_b.append(np.ascontiguousarray(rows_b, dtype=np.float32).reshape(-1, 1, 2))
    # with enough moments the intrinsics gain from the second view of every board pose; with few they overfit
    flags = cv2.CALIB_USE_INTRINSIC_GUESS if len(keys) >= _GOOD_VIEWS else cv2.CALIB_FIX_INTRINSIC
    answer = _run_opencv(
        cv2.stereoCalibrateExtended,
        objects, images_a, images_b,
        a.matrix.copy(), a.distortion.copy(), b.matrix.copy(), b.distortion.copy(),
        first.image_size, np.eye(3), np.zeros((3, 1)), flags=flags, criteria=_CRITERIA,
    )  # fmt: skip
    rms, matrix_a, distortion_a, matrix_b, distortion_b, rotation, translation = answer[:7]
    pair = _Pair(
        (matrix_a, matrix_b),
        (np.ravel(distortion_a)[:5], np.ravel(distortion_b)[:5]),
        (_orthonormal(rotation), np.ravel(translation)),
        float(rms),
        tuple(keys),
    )
    return pair, np.asarray(answer[-1]).max(axis=1)


def _common_points(a: BoardView, b: BoardView, turned: bool) -> tuple[NDArray[np.int64], Array, Array]:
    if turned:
        return a.ids, a.pixels, b.pixels[::-1]
    common, rows_a, rows_b = np.intersect1d(a.ids, b.ids, return_indices=True)
    return common, a.pixels[rows_a], b.pixels[rows_b]


def _orthonormal(rotation: Array) -> Array:
    u, _, vt = np.linalg.svd(rotation)
    return np.asarray(u @ vt)


def _check_sides(second_from_first: Transform, left: str, right: str) -> None:
    centre = inverse(second_from_first)[1]  # of the second camera, in the first one's frame
    if centre[0] < -0.5 * np.linalg.norm(centre):
        raise CalibrationError(
            f"the pictures given for {left} come from the camera on the right and those for {right} from the left",
            advice="exchange --left and --right",
        )


def _result(
    points_m: Array,
    intrinsics: Sequence[_Intrinsics],
    poses: Sequence[Transform],
    pairs: Mapping[tuple[int, int], _Pair],
    refused: Sequence[Rejected],
) -> CalibrationResult:
    cameras = tuple(
        Camera(c.name, c.image_size, c.matrix, c.distortion, rotation @ WORLD_FROM_CAMERA.T, translation)
        for c, (rotation, translation) in zip(intrinsics, poses, strict=True)
    )
    counts = [len(pair.used) for pair in pairs.values()]
    rms = float(np.sqrt(np.average([pair.rms_px**2 for pair in pairs.values()], weights=counts)))
    used = tuple(dict.fromkeys(key for pair in pairs.values() for key in pair.used))
    verdict, advice = _judge(rms, intrinsics, min(counts))
    rig = CameraRig(cameras, {"error": rms, "pictures": len(used), "verdict": verdict})
    return CalibrationResult(
        rig=rig,
        stereo_rms_px=rms,
        rms_px={c.name: c.rms_px for c in intrinsics},
        baseline_m=rig.baseline_m(),
        used=used,
        rejected=tuple(refused),
        verdict=verdict,
        advice=advice,
    )


def _judge(rms: float, intrinsics: Sequence[_Intrinsics], moments: int) -> tuple[str, tuple[str, ...]]:
    width = intrinsics[0].image_size[0]
    advice = []
    if rms > _GOOD_RMS * width:
        advice.append("the error is high: keep the board flat and still, use more light, focus the cameras")
    if moments < _GOOD_VIEWS:
        advice.append(f"only {moments} moments show the board to both cameras: take 12 or more")
    for camera in intrinsics:
        tilts = [np.degrees(np.arccos(min(1.0, abs(r[2, 2])))) for r, _ in camera.poses.values()]
        if max(tilts) < 15.0:
            advice.append(f"{camera.name} saw the board almost straight on only: tilt it by 20 to 45 degrees")
    if rms > _USABLE_RMS * width:
        return "redo", tuple(advice)
    return ("usable" if advice else "good"), tuple(advice)


def grid_of(board: Board) -> tuple[int, int] | None:
    """Return the grid whose half turns are ambiguous: a chessboard's, None for a board with markers."""
    return board.corner_grid if board.kind == "chessboard" else None
