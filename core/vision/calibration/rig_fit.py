"""Fit of several cameras: consistent moments, initial poses, bundle adjustment, lens model, and error estimates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import CalibrationError, counted
from ...geometry.arrays import Array, Mask
from .bundle import (
    FIT,
    INTRINSICS,
    Bundle,
    CornerObservation,
    LensPrior,
    adjust,
    adjust_boards,
    camera_covariance,
    delay_s,
    residuals,
    rms,
    rms_by_moment,
)
from .calibration_board import BoardView
from .relative_pose import half_turn, pose_matrix, pose_vector, relative_pose, seen_alike

MINIMUM_VIEWS = 3
"""Number of board views that determine a lens (Zhang 2000, section 3.1)."""

_ALL = np.ones(INTRINSICS, dtype=bool)
NO_SKEW = _ALL & (np.arange(INTRINSICS) != 4)
_NO_SKEW_NO_K3 = NO_SKEW & (np.arange(INTRINSICS) != 9)
_MODELS = {"skew": _ALL, "no skew": NO_SKEW, "no skew, no k3": _NO_SKEW_NO_K3}


@dataclass(frozen=True)
class CameraViews:
    """Views of one camera: image size (w, h), and board views by moment."""

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
    """One camera, calibrated alone."""

    name: str
    image_size: tuple[int, int]
    intrinsics: Array  # (10,) as in `bundle`
    rms_px: float
    poses: dict[str, Array]  # camera-from-board (4, 4) by moment


@dataclass(frozen=True)
class RigFit:
    """Cameras adjusted together; see `calibrate.CalibrationResult`."""

    intrinsics: Array  # (C, 10) as in `bundle`
    poses: tuple[Array, ...]  # camera-from-first-camera (4, 4)
    rms_px: float
    held_out_px: float
    used: tuple[str, ...]
    errors_px: Array  # (M, C) for each view, NaN where a camera does not take part in a moment
    late_s: Array  # (C,), NaN if the board was held still
    distance_sigma: float


def is_outlier(errors: Array) -> Mask:
    """Return a mask of RMS errors (pixels) that are outliers."""
    typical = float(np.median(errors))
    return np.asarray(errors > max(FIT.outlier_factor * typical, typical + FIT.outlier_floor_px))


def fit_rig(
    points_m: Array,
    cameras: Sequence[CameraViews],
    singles: Sequence[SingleCamera],
    refused: list[Rejected],
    centre: Array | None,
) -> RigFit:
    """Fit all cameras together.

    Args:
        refused: Receives the views that do not fit.
        centre: Centre (3,) of a board that looks the same after half a turn, else None.

    Raises:
        CalibrationError: Cameras did not see the board together, or pictures do not belong together.
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
    """Return the fit of a rig with one camera, which is at the world's origin."""
    return RigFit(
        single.intrinsics[None],
        (np.eye(4),),
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
                f"the pictures of {camera.name} and {others} do not match",
                advice="check that pictures taken at the same moment have the same number",
            )


def _refuse_outliers(
    errors: Array,
    keys: Sequence[str],
    cameras: Sequence[CameraViews],
    members: Mapping[str, dict[int, bool]],
    refused: list[Rejected],
) -> bool:
    """Remove views with outlying errors (M, C); return whether there were any."""
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
    """Return the prior for ordinary lenses with images of these sizes (w, h).

    Pixels are nearly square, the axis meets the image near its centre, and distortion is moderate. The prior matters
    only with few views or a small board; then it keeps noise out of the lens.
    """
    means, information = np.zeros((len(sizes), INTRINSICS)), np.zeros((len(sizes), INTRINSICS, INTRINSICS))
    for index, (width, height) in enumerate(sizes):
        means[index, 2:4] = (width - 1) / 2.0, (height - 1) / 2.0
        lens = np.array(FIT.lens_sigmas)
        sigmas = np.array([np.inf, np.inf, *(width * lens[:3]), *lens[3:]])
        information[index] = np.diag(1.0 / sigmas**2)
        information[index, :2, :2] += np.array([[1.0, -1.0], [-1.0, 1.0]]) / (FIT.aspect_sigma * width) ** 2
    return LensPrior(means, information)


def _choose_model(
    bundle: Bundle, observations: Sequence[CornerObservation], keys: Sequence[str], prior: LensPrior
) -> RigFit:
    """Fit the richest lens model that predicts held-out moments well."""
    held_out = {name: _held_out(bundle, observations, free, prior) for name, free in _MODELS.items()}
    if np.isnan(next(iter(held_out.values()))):
        chosen = "no skew, no k3"  # too few moments to compare, so use the fewest unknowns
    else:
        limit = FIT.richer_may_cost * min(held_out.values())
        chosen = next(name for name, error in held_out.items() if error <= limit)
    free = _MODELS[chosen]
    fitted = adjust(_clear_fixed(bundle, free), observations, free, prior)
    return RigFit(
        fitted.intrinsics,
        tuple(pose_matrix(row) for row in fitted.cameras),
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
    centres = np.array([np.linalg.inv(pose_matrix(row))[:3, 3] for row in cameras])
    first, second = np.triu_indices(len(centres), 1)
    return np.asarray(np.linalg.norm(centres[first] - centres[second], axis=1))


def _delays_s(bundle: Bundle, observations: Sequence[CornerObservation]) -> Array:
    """Return each camera's median delay (C,) relative to the first, NaN if unknown."""
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
    """Return the RMS reprojection error of moments that are left out of the fit in turn."""
    if len(bundle.boards) < FIT.least_moments:
        return float("nan")
    squares = []
    for fold in range(FIT.folds):
        training = [s for s in observations if s.moment % FIT.folds != fold]
        tests = [s for s in observations if s.moment % FIT.folds == fold]
        fitted = adjust_boards(adjust(_clear_fixed(bundle, free), training, free, prior), tests)
        squares += [np.sum(residuals(fitted, observation) ** 2, axis=1) for observation in tests]
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def _chain_cameras(singles: Sequence[SingleCamera], centre: Array | None) -> list[Array]:
    """Return camera-from-first (4, 4) of all cameras, chained over the pairs with the most shared views."""
    starts = {0: np.eye(4)}
    while len(starts) < len(singles):
        shared = {
            (i, j): sorted(singles[i].poses.keys() & singles[j].poses.keys())
            for i in sorted(starts)
            for j in range(len(singles))
            if j not in starts
        }
        (i, j), keys = max(shared.items(), key=lambda item: len(item[1]))
        if len(keys) < MINIMUM_VIEWS:
            together = f"saw the board together in only {counted(len(keys), 'moment')}"
            what = f"{singles[i].name} and {singles[j].name} {together}"
            if not keys:
                names = " or ".join(singles[c].name for c in starts)
                what = f"{singles[j].name} never saw the board together with {names}"
            raise CalibrationError(what, advice="hold the board where both cameras see it, in at least 12 moments")
        agreed = relative_pose([singles[i].poses[k] for k in keys], [singles[j].poses[k] for k in keys], centre)
        starts[j] = agreed @ starts[i]
    return [starts[i] for i in range(len(singles))]


def _members(
    singles: Sequence[SingleCamera], starts: Sequence[Array], refused: list[Rejected], centre: Array | None
) -> dict[str, dict[int, bool]]:
    """Return each moment's cameras and whether each of them numbers the board from the other end.

    A moment's cameras are the largest group that agrees with one of its cameras on where the board is.
    """
    scale = float(np.median([np.linalg.norm(pose[:3, 3]) for single in singles for pose in single.poses.values()]))

    def agreeing(key: str, base: int, seen: Sequence[int]) -> dict[int, bool]:
        row = {base: False}
        for c in seen:
            placed = starts[c] @ np.linalg.inv(starts[base])
            agrees, turned = seen_alike(singles[base].poses[key], singles[c].poses[key], placed, centre, scale)
            if agrees and c != base:
                row[c] = turned
        return row

    members: dict[str, dict[int, bool]] = {}
    for key in sorted({key for single in singles for key in single.poses}):
        seen = [c for c, single in enumerate(singles) if key in single.poses]
        if len(seen) < 2:
            continue
        best = members[key] = max((agreeing(key, base, seen) for base in seen), key=len)
        for c in seen:
            if c not in best:
                names = " and ".join(singles[b].name for b in sorted({*best, c}))
                refused.append(Rejected(key, f"{names} do not show the board in the same place at this moment"))
    return members


def _start(
    points_m: Array,
    cameras: Sequence[CameraViews],
    singles: Sequence[SingleCamera],
    starts: Sequence[Array],
    members: Mapping[str, Mapping[int, bool]],
    keys: Sequence[str],
) -> tuple[Bundle, list[CornerObservation]]:
    observations = []
    boards = np.zeros((len(keys), 6))
    for moment, key in enumerate(keys):
        for c, turned in sorted(members[key].items(), reverse=True):
            view = cameras[c].views[key].reverse() if turned else cameras[c].views[key]
            observations.append(CornerObservation(c, moment, points_m[view.ids], view.pixels, view.motion_px_s))
            pose = singles[c].poses[key] @ half_turn(points_m.mean(axis=0)) if turned else singles[c].poses[key]
            boards[moment] = pose_vector(np.linalg.inv(starts[c]) @ pose)
    intrinsics = np.array([single.intrinsics for single in singles])
    return Bundle(intrinsics, np.array([pose_vector(start) for start in starts]), boards), observations
