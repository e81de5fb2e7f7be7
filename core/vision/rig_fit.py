"""Several cameras into one world: which moments agree, the start for the bundle adjustment, and its honest error."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from .board import BoardView
from .bundle import (
    INTRINSICS,
    Bundle,
    Sighting,
    adjust,
    adjust_boards,
    intrinsics_of,
    residuals,
    rms,
    rms_by_moment,
)
from .relative_pose import Transform, compose, relative_poses

Array = NDArray[np.float64]

MINIMUM_VIEWS = 3
_OUTLIER_FACTOR = 3.0
_OUTLIER_FLOOR_PX = 0.6
_FOLDS = 5
_SMALLEST_FOR_FOLDS = 10
_RICHER_MAY_COST = 1.05

_ALL = np.ones(INTRINSICS, dtype=bool)
_NO_SKEW = _ALL & (np.arange(INTRINSICS) != 4)
_NO_SKEW_NO_K3 = _NO_SKEW & (np.arange(INTRINSICS) != 9)
_MODELS = {"skew": _ALL, "no skew": _NO_SKEW, "no skew, no k3": _NO_SKEW_NO_K3}


@dataclass(frozen=True)
class CameraViews:
    """What one camera saw: image size (w, h) and the board views by moment (same key = same moment)."""

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
        used: moments.
        model: which intrinsics were adjusted.
    """

    intrinsics: Array
    poses: tuple[Transform, ...]
    rms_px: float
    held_out_px: float
    used: tuple[str, ...]
    model: str


def is_outlier(errors: Array) -> NDArray[np.bool_]:
    """Return which RMS errors in pixels stand out of the others."""
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
        points_m: (N, 3) board points.
        cameras, singles: what each saw and its own calibration.
        refused: moments that do not fit are added, with reasons.
        centre: (3,) centre of a board that looks the same after half a turn, else None.

    Raises:
        CalibrationError: cameras that did not see the board together, or whose pictures do not belong together.
    """
    starts, members = _connect(cameras, singles, refused, centre)
    keys = sorted({key for row in members for key in row})
    while True:
        if len(keys) < MINIMUM_VIEWS:
            raise CalibrationError(
                "the pictures of " + " and ".join(c.name for c in cameras) + " do not belong together",
                advice="check that the cameras' pictures of one moment have the same number",
            )
        start, sightings = _start(points_m, cameras, singles, starts, members, keys)
        bundle = adjust(adjust(start, sightings, _NO_SKEW_NO_K3), sightings, _NO_SKEW)
        errors = np.nanmax(rms_by_moment(bundle, sightings), axis=1)
        if not is_outlier(errors).any():
            break
        worst = int(np.argmax(errors))
        refused.append(Rejected(keys[worst], f"does not fit the other pictures ({errors[worst]:.2f} px)"))
        del keys[worst]
    return _choose_model(bundle, sightings, keys)


def _choose_model(bundle: Bundle, sightings: Sequence[Sighting], keys: Sequence[str]) -> RigFit:
    """Take the richest camera model that predicts moments left out of the fit as well as the best does."""
    held_out = {name: _held_out(bundle, sightings, free) for name, free in _MODELS.items()}
    if np.isnan(next(iter(held_out.values()))):
        chosen = "no skew, no k3"  # too few moments to tell: the fewest unknowns
    else:
        limit = _RICHER_MAY_COST * min(held_out.values())
        chosen = next(name for name, error in held_out.items() if error <= limit)
    free = _MODELS[chosen]
    fitted = adjust(_cleared(bundle, free), sightings, free)
    poses = tuple((cv2.Rodrigues(row[:3])[0], row[3:]) for row in fitted.cameras)
    return RigFit(fitted.intrinsics, poses, rms(fitted, sightings), held_out[chosen], tuple(keys), chosen)


def _cleared(bundle: Bundle, free: NDArray[np.bool_]) -> Bundle:
    return Bundle(np.where(free, bundle.intrinsics, 0.0), bundle.cameras, bundle.boards)


def _held_out(bundle: Bundle, sightings: Sequence[Sighting], free: NDArray[np.bool_]) -> float:
    if len(bundle.boards) < _SMALLEST_FOR_FOLDS:
        return float("nan")
    squares = []
    for fold in range(_FOLDS):
        training = [s for s in sightings if s.moment % _FOLDS != fold]
        tests = [s for s in sightings if s.moment % _FOLDS == fold]
        fitted = adjust_boards(adjust(_cleared(bundle, free), training, free), tests)
        squares += [np.sum(residuals(fitted, sighting) ** 2, axis=1) for sighting in tests]
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def _connect(
    cameras: Sequence[CameraViews], singles: Sequence[SingleCamera], refused: list[Rejected], centre: Array | None
) -> tuple[list[Transform], list[dict[str, bool]]]:
    """Chain the cameras from the first one on.

    Returns camera-from-first transforms and, per camera, the moments it takes part in with whether its board is
    numbered from the other end.
    """
    starts: dict[int, Transform] = {0: (np.eye(3), np.zeros(3))}
    members: list[dict[str, bool]] = [{} for _ in cameras]
    while len(starts) < len(cameras):
        shared, i, j = _nearest_pair(singles, starts)
        if shared < MINIMUM_VIEWS:
            raise CalibrationError(
                f"{cameras[i].name} and {cameras[j].name} saw the board together in {shared} picture(s) only",
                advice="hold the board where both cameras see it, in at least 12 moments",
            )
        keys = sorted(set(singles[i].poses) & set(singles[j].poses))
        agreed = relative_poses([singles[i].poses[k] for k in keys], [singles[j].poses[k] for k in keys], centre)
        for key, turned, agrees in zip(keys, agreed.turned, agreed.agrees, strict=True):
            if not agrees:
                names = f"{cameras[i].name} and {cameras[j].name}"
                refused.append(Rejected(key, f"{names} do not show the board in the same place at this moment"))
                continue
            base = members[i].setdefault(key, False)
            members[j][key] = base != bool(turned)
        starts[j] = compose(agreed.transform, starts[i])
    return [starts[i] for i in range(len(cameras))], members


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
    members: Sequence[Mapping[str, bool]],
    keys: Sequence[str],
) -> tuple[Bundle, list[Sighting]]:
    sightings = []
    boards = np.zeros((len(keys), 6))
    for moment, key in enumerate(keys):
        for c in reversed(range(len(cameras))):
            if key not in members[c]:
                continue
            view, turned = cameras[c].views[key], members[c][key]
            pixels = view.pixels[::-1] if turned else view.pixels
            sightings.append(Sighting(c, moment, points_m[view.ids], pixels))
            if not turned:  # the lowest camera that numbers the board as the moment does gives its first pose
                rotation, translation = starts[c]
                inverse = (rotation.T, -rotation.T @ translation)
                boards[moment] = _vector(compose(inverse, singles[c].poses[key]))
    intrinsics = np.array([intrinsics_of(single.matrix, single.distortion) for single in singles])
    return Bundle(intrinsics, np.array([_vector(start) for start in starts]), boards), sightings


def _vector(transform: Transform) -> Array:
    return np.concatenate((cv2.Rodrigues(transform[0])[0].ravel(), transform[1]))
