"""Fit of several cameras: moments that agree, start, bundle adjustment, errors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from ...errors import CalibrationError
from ...geometry.arrays import Array, Mask
from .bundle import (
    INTRINSICS,
    Bundle,
    CornerObservation,
    LensPrior,
    adjust,
    adjust_boards,
    camera_covariance,
    delay_s,
    intrinsics_of,
    residuals,
    rms,
    rms_by_moment,
)
from .calibration_board import BoardView
from .relative_pose import Transform, compose, half_turn, inverse, relative_poses, seen_alike

MINIMUM_VIEWS = 3
_OUTLIER_FACTOR = 3.0
_OUTLIER_FLOOR_PX = 0.6
_FOLDS = 5
_SMALLEST_FOR_FOLDS = 10
_RICHER_MAY_COST = 1.05
_ASPECT_SIGMA = 0.01  # fx - fy, of the image's width
_LENS_SIGMAS = np.array([0.15, 0.15, 0.03, 0.5, 1.0, 0.02, 0.02, 3.0])  # cx, cy, skew (of the width), distortion

_ALL = np.ones(INTRINSICS, dtype=bool)
NO_SKEW = _ALL & (np.arange(INTRINSICS) != 4)
_NO_SKEW_NO_K3 = NO_SKEW & (np.arange(INTRINSICS) != 9)
_MODELS = {"skew": _ALL, "no skew": NO_SKEW, "no skew, no k3": _NO_SKEW_NO_K3}


@dataclass(frozen=True)
class CameraViews:
    """Views of one camera: image size (w, h), board views by moment."""

    name: str
    image_size: tuple[int, int]
    views: Mapping[str, BoardView]


@dataclass(frozen=True)
class Rejected:
    """A picture that was not used, and why."""

    picture: str
    reason: str


@dataclass
class SingleCamera:
    """One camera calibrated alone; `poses` are camera-from-board by moment."""

    name: str
    image_size: tuple[int, int]
    matrix: Array
    distortion: Array
    rms_px: float
    poses: dict[str, Transform] = field(default_factory=dict)


@dataclass(frozen=True)
class RigFit:
    """Cameras adjusted together.

    Args:
        intrinsics: (C, 10) as in `bundle`.
        poses: camera-from-first-camera.
        rms_px: over all cameras and moments; `held_out_px` the same for moments left out of the fit (NaN with
            too few of them).
        errors_px: (M, C) RMS reprojection error of each view, NaN where a camera takes no part in a moment.
        late_s: (C,) how late the pictures of a camera are against the first one's, NaN where the board held still.
        distance_sigma: standard deviation of the distances between cameras, as a fraction of them; the largest.
    """

    intrinsics: Array
    poses: tuple[Transform, ...]
    rms_px: float
    held_out_px: float
    used: tuple[str, ...]
    errors_px: Array
    late_s: Array
    distance_sigma: float


def is_outlier(errors: Array) -> Mask:
    """Return a mask of RMS errors (pixels) that are outliers."""
    typical = float(np.median(errors))
    return np.asarray(errors > max(_OUTLIER_FACTOR * typical, typical + _OUTLIER_FLOOR_PX))


def fit_rig(
    points_m: Array,
    cameras: Sequence[CameraViews],
    singles: Sequence[SingleCamera],
    refused: list[Rejected],
    centre: Array | None,
) -> RigFit:
    """Fit all cameras together.

    Args:
        refused: views that do not fit are added, with reasons.
        centre: (3,) centre of a board that looks the same after half a turn, else None.

    Raises:
        CalibrationError: cameras that did not see the board together, or pictures that do not belong together.
    """
    starts = _chain_cameras(singles, centre)
    members = _members(singles, starts, refused, centre)
    prior = lens_prior([camera.image_size for camera in cameras])
    while True:
        keys = [key for key, row in members.items() if len(row) > 1]
        _check_moments(cameras, members, keys)
        start, observations = _start(points_m, cameras, singles, starts, members, keys)
        bundle = adjust(adjust(start, observations, _NO_SKEW_NO_K3, prior), observations, NO_SKEW, prior)
        errors = rms_by_moment(bundle, observations)
        if not _refuse_outliers(errors, keys, cameras, members, refused):
            return _choose_model(bundle, observations, keys, prior)


def fit_of_one(single: SingleCamera) -> RigFit:
    """Return a camera calibrated alone as a rig; it stands where the world is."""
    return RigFit(
        intrinsics_of(single.matrix, single.distortion)[None],
        ((np.eye(3), np.zeros(3)),),
        single.rms_px,
        float("nan"),
        tuple(single.poses),
        np.full((len(single.poses), 1), np.nan),
        np.full(1, np.nan),
        0.0,
    )


def _check_moments(
    cameras: Sequence[CameraViews], members: Mapping[str, Mapping[int, bool]], keys: Sequence[str]
) -> None:
    for index, camera in enumerate(cameras):
        if sum(index in members[key] for key in keys) < MINIMUM_VIEWS:
            others = " and ".join(c.name for c in cameras if c is not camera)
            raise CalibrationError(
                f"the pictures of {camera.name} and of {others} do not belong together",
                advice="check that the cameras' pictures of one moment have the same number",
            )


def _refuse_outliers(
    errors: Array,
    keys: Sequence[str],
    cameras: Sequence[CameraViews],
    members: Mapping[str, dict[int, bool]],
    refused: list[Rejected],
) -> bool:
    """Remove the worst views by errors (M, C); return whether there were any."""
    seen = np.isfinite(errors)
    outlying = np.zeros(errors.shape, dtype=bool)
    outlying[seen] = is_outlier(errors[seen]) & (errors[seen] > 0.5 * errors[seen].max())
    for moment in np.flatnonzero(outlying.any(axis=1)):
        row = members[keys[moment]]
        worst = int(np.nanargmax(errors[moment]))
        del row[worst]
        picture = f"{cameras[worst].name} {keys[moment]}" if len(row) > 1 else keys[moment]
        refused.append(Rejected(picture, f"does not fit the other pictures ({errors[moment, worst]:.2f} px)"))
    return bool(outlying.any())


def lens_prior(sizes: Sequence[tuple[int, int]]) -> LensPrior:
    """Return the prior of ordinary lenses with images of these sizes (w, h).

    Pixels are nearly square, the axis meets the image near its middle, distortion is moderate. Views of a board that
    fill the images tell all of it far better; with few views, or a small board, it keeps the lens from taking up what
    is no property of it.
    """
    means, information = np.zeros((len(sizes), INTRINSICS)), np.zeros((len(sizes), INTRINSICS, INTRINSICS))
    for index, (width, height) in enumerate(sizes):
        means[index, 2:4] = (width - 1) / 2.0, (height - 1) / 2.0
        sigmas = np.array([np.inf, np.inf, *(width * _LENS_SIGMAS[:3]), *_LENS_SIGMAS[3:]])
        information[index] = np.diag(1.0 / sigmas**2)
        information[index, :2, :2] += np.array([[1.0, -1.0], [-1.0, 1.0]]) / (_ASPECT_SIGMA * width) ** 2
    return LensPrior(means, information)


def _choose_model(
    bundle: Bundle, observations: Sequence[CornerObservation], keys: Sequence[str], prior: LensPrior
) -> RigFit:
    """Choose the richest camera model that predicts held-out moments well."""
    held_out = {name: _held_out(bundle, observations, free, prior) for name, free in _MODELS.items()}
    if np.isnan(next(iter(held_out.values()))):
        chosen = "no skew, no k3"  # too few moments to tell: the fewest unknowns
    else:
        limit = _RICHER_MAY_COST * min(held_out.values())
        chosen = next(name for name, error in held_out.items() if error <= limit)
    free = _MODELS[chosen]
    fitted = adjust(_clear_fixed(bundle, free), observations, free, prior)
    poses = tuple((cv2.Rodrigues(row[:3])[0], row[3:]) for row in fitted.cameras)
    return RigFit(
        fitted.intrinsics,
        poses,
        rms(fitted, observations),
        held_out[chosen],
        tuple(keys),
        rms_by_moment(fitted, observations),
        _delays_s(fitted, observations),
        _distance_sigma(fitted, camera_covariance(fitted, observations, free, prior)),
    )


def _distance_sigma(bundle: Bundle, covariance: Array) -> float:
    start = _distances(bundle.cameras)
    steps = 1e-6 * np.eye(bundle.cameras.size)
    slopes = np.array([_distances(bundle.cameras + step.reshape(-1, 6)) - start for step in steps]).T / 1e-6
    return float((np.sqrt(np.einsum("ij,jk,ik->i", slopes, covariance, slopes)) / start).max())


def _distances(cameras: Array) -> Array:
    """Return the distances between all pairs of cameras (C, 6)."""
    centres = np.array([-cv2.Rodrigues(row[:3])[0].T @ row[3:] for row in cameras])
    first, second = np.triu_indices(len(centres), 1)
    return np.asarray(np.linalg.norm(centres[first] - centres[second], axis=1))


def _delays_s(bundle: Bundle, observations: Sequence[CornerObservation]) -> Array:
    """Return the median delay (C,) of each camera against the first, NaN if unknown."""
    delays = np.full((len(bundle.boards), len(bundle.intrinsics)), np.nan)
    for observation in observations:
        delays[observation.moment, observation.camera] = delay_s(bundle, observation)
    known = np.isfinite(delays).any(axis=0)
    late = np.full(len(known), np.nan)
    late[known] = np.nanmedian(delays[:, known], axis=0)
    return late - late[0]


def _clear_fixed(bundle: Bundle, free: Mask) -> Bundle:
    return Bundle(np.where(free, bundle.intrinsics, 0.0), bundle.cameras, bundle.boards)


def _held_out(bundle: Bundle, observations: Sequence[CornerObservation], free: Mask, prior: LensPrior) -> float:
    if len(bundle.boards) < _SMALLEST_FOR_FOLDS:
        return float("nan")
    squares = []
    for fold in range(_FOLDS):
        training = [s for s in observations if s.moment % _FOLDS != fold]
        tests = [s for s in observations if s.moment % _FOLDS == fold]
        fitted = adjust_boards(adjust(_clear_fixed(bundle, free), training, free, prior), tests)
        squares += [np.sum(residuals(fitted, observation) ** 2, axis=1) for observation in tests]
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def _chain_cameras(singles: Sequence[SingleCamera], centre: Array | None) -> list[Transform]:
    """Return camera-from-first of all cameras, chained by most shared views."""
    starts: dict[int, Transform] = {0: (np.eye(3), np.zeros(3))}
    while len(starts) < len(singles):
        shared, i, j = _nearest_pair(singles, starts)
        if shared < MINIMUM_VIEWS:
            _refuse_pair(singles, list(starts), shared, i, j)
        keys = sorted(set(singles[i].poses) & set(singles[j].poses))
        agreed = relative_poses([singles[i].poses[k] for k in keys], [singles[j].poses[k] for k in keys], centre)
        starts[j] = compose(agreed, starts[i])
    return [starts[i] for i in range(len(singles))]


def _refuse_pair(singles: Sequence[SingleCamera], joined: Sequence[int], shared: int, i: int, j: int) -> None:
    if shared:
        what = f"{singles[i].name} and {singles[j].name} saw the board together in {shared} picture(s) only"
    else:
        names = " or ".join(singles[c].name for c in joined)
        what = f"{singles[j].name} never saw the board together with {names}"
    raise CalibrationError(what, advice="hold the board where both cameras see it, in at least 12 moments")


def _members(
    singles: Sequence[SingleCamera], starts: Sequence[Transform], refused: list[Rejected], centre: Array | None
) -> dict[str, dict[int, bool]]:
    """Return each moment's cameras, and whether its board is numbered from the end.

    A moment's cameras are those that most of them agree with on where the board is.
    """
    scale = float(np.median([np.linalg.norm(pose[1]) for single in singles for pose in single.poses.values()]))
    members: dict[str, dict[int, bool]] = {}
    for key in sorted({key for single in singles for key in single.poses}):
        seen = [c for c, single in enumerate(singles) if key in single.poses]
        if len(seen) < 2:
            continue
        rows = [_agreeing_cameras(base, seen, key, singles, starts, centre, scale) for base in seen]
        best = max(rows, key=len)
        members[key] = best
        for c in seen:
            if c not in best:
                names = " and ".join(singles[b].name for b in sorted({*best, c}))
                refused.append(Rejected(key, f"{names} do not show the board in the same place at this moment"))
    return members


def _agreeing_cameras(
    base: int,
    seen: Sequence[int],
    key: str,
    singles: Sequence[SingleCamera],
    starts: Sequence[Transform],
    centre: Array | None,
    scale: float,
) -> dict[int, bool]:
    row = {base: False}
    for c in seen:
        if c == base:
            continue
        placed = compose(starts[c], inverse(starts[base]))
        agrees, turned = seen_alike(singles[base].poses[key], singles[c].poses[key], placed, centre, scale)
        if agrees:
            row[c] = turned
    return row


def _nearest_pair(singles: Sequence[SingleCamera], starts: Mapping[int, Transform]) -> tuple[int, int, int]:
    candidates = [
        (len(set(singles[i].poses) & set(singles[j].poses)), -i, -j)
        for i in starts
        for j in range(len(singles))
        if j not in starts
    ]
    shared, i, j = max(candidates)
    return shared, -i, -j


def _start(
    points_m: Array,
    cameras: Sequence[CameraViews],
    singles: Sequence[SingleCamera],
    starts: Sequence[Transform],
    members: Mapping[str, Mapping[int, bool]],
    keys: Sequence[str],
) -> tuple[Bundle, list[CornerObservation]]:
    observations = []
    boards = np.zeros((len(keys), 6))
    for moment, key in enumerate(keys):
        for c, turned in sorted(members[key].items(), reverse=True):
            view = cameras[c].views[key].reverse() if turned else cameras[c].views[key]
            observations.append(CornerObservation(c, moment, points_m[view.ids], view.pixels, view.motion_px_s))
            pose = singles[c].poses[key]
            pose = compose(pose, half_turn(points_m.mean(axis=0))) if turned else pose
            boards[moment] = _vector(compose(inverse(starts[c]), pose))
    intrinsics = np.array([intrinsics_of(single.matrix, single.distortion) for single in singles])
    return Bundle(intrinsics, np.array([_vector(start) for start in starts]), boards), observations


def _vector(transform: Transform) -> Array:
    return np.concatenate((cv2.Rodrigues(transform[0])[0].ravel(), transform[1]))
