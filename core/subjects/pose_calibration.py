"""Calibration of skeleton and marker offsets from held poses (Chai and Hodgins 2005, section 4.2).

The skeleton is fitted to the markers by `held_pose_fit`. An offset is the position of the marker relative to its joint,
in the joint's axes. A single pose shows where a limb ends, not where it begins: only poses with the arms sideways,
forward and down separate the shoulder from the arm.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.calibration_poses import CALIBRATION, POSES
from ..body.skeleton import Skeleton, forward_kinematics, marker_positions
from ..body.standard_skeleton import default_skeleton
from ..errors import SubjectError
from ..geometry import rotations as rot
from ..geometry.arrays import Array, Mask
from ..geometry.rigid_transform import kabsch, transform
from ..markers.marker_set import MarkerSet
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from .held_pose_fit import BodyFit, fit_body, usual_offsets

_LIMBS = {"humerus": "arm", "femur": "leg"}
_HELD_AS = {
    "t": "the T pose",
    "standing": "standing at rest",
    "hanging": "the pose with hanging arms",
    "motorcycle": "the motorcycle pose",
}


@dataclass(frozen=True)
class CalibrationLimits:
    """Limits for held poses and for the calibration's quality."""

    farthest_swing_deg: float = 35.0  # largest angle of a limb from the calibration pose
    careless_deg: float = 15.0  # angle of a limb from the pose above which the advice mentions it
    noise_m: float = 0.03  # largest range of a still marker's positions due to measurement alone
    still_m_s: float = 0.15  # speed above which a pose is not held
    like_pose_m: float = 0.20  # largest RMS distance from the default body's markers in the pose; allows for size
    as_close: float = 1.3  # the stillest moment is chosen among those up to this factor from the smallest distance
    residual_m: float = 0.015  # RMS marker error above which a calibration should be redone
    odd_marker_m: float = 0.035  # distance of a marker from its usual position above which the advice mentions it
    shoulder_m: float = 0.012  # standard deviation of a shoulder's position above which another pose is worthwhile


LIMITS = CalibrationLimits()


@dataclass(frozen=True)
class SubjectCalibration:
    """A calibrated subject and its quality.

    Args:
        sigmas_m: Standard deviation of each joint's distance from its parent, by joint name.
        marker_residuals_m: RMS distance of each marker from its usual position on this body, by marker name.
        verdict: "good", "usable" (another pose would help) or "redo".
    """

    subject: Subject
    sigmas_m: dict[str, float]
    marker_residuals_m: dict[str, float]
    verdict: str
    advice: tuple[str, ...]


def calibration_points(
    take: MarkerTake, marker_set: MarkerSet, seconds: float = 1.0, frames: slice = slice(None)
) -> Array:
    """Return the median marker positions (M, 3) in the first still moment, NaN for hidden markers.

    Args:
        take: Take that shows the calibration pose.
        frames: Part of the take to search.

    Raises:
        SubjectError: The take lacks a marker of the set, or its markers are never still.
    """
    positions = _positions(take, marker_set)[frames]
    return _median(positions, next(_still(positions, take.fps, seconds)))


def pose_points(take: MarkerTake, marker_set: MarkerSet, poses: Sequence[str], seconds: float = 1.0) -> Array:
    """Return the median marker positions (N, M, 3) in each held pose, from its stillest moment.

    Args:
        take: Take that shows the poses in any order.
        marker_set: Markers to find, with their usual offsets.
        poses: Names (N) in `POSES`.

    Raises:
        SubjectError: A pose is unknown or not held, or the take lacks a marker of the set.
    """
    check_poses(poses)
    positions = _positions(take, marker_set)
    skeleton, offsets = default_skeleton(), usual_offsets(marker_set)
    joints = marker_set.joint_indices(skeleton)
    templates = {
        pose: marker_positions(skeleton, joints, offsets, POSES[pose](skeleton), np.zeros(3)) for pose in poses
    }
    held: dict[str, list[tuple[float, float, Array]]] = {}
    for window in _still(positions, take.fps, seconds):
        points = _median(positions, window)
        distances = {name: _distance(points, template) for name, template in templates.items()}
        nearest = min(distances, key=lambda name: distances[name])
        if distances[nearest] < LIMITS.like_pose_m:
            shown = np.isfinite(points[:, 0])
            spread = float(np.nanstd(positions[window][:, shown], axis=0).max())
            held.setdefault(nearest, []).append((distances[nearest], spread, points))
    for pose in poses:
        if pose not in held:
            raise SubjectError(
                f"{_HELD_AS[pose]} is not held for {seconds:.1f} s",
                where=take.name,
                advice="hold every pose still with all markers visible, or leave this pose out",
            )
    return np.array([_stillest(held[pose]) for pose in poses])


def _stillest(moments: list[tuple[float, float, Array]]) -> Array:
    """Return the points of the stillest moment that is close to the pose; moments are (distance, spread, points).

    At the closest moment the performer may still be moving into the pose.
    """
    most = LIMITS.as_close * min(distance for distance, _, _ in moments)
    return min((moment for moment in moments if moment[0] < most), key=lambda moment: moment[1])[2]


def check_poses(poses: Sequence[str]) -> None:
    """Raise SubjectError unless all poses are in `POSES`, each once."""
    for pose in poses:
        if pose not in POSES:
            raise SubjectError(f"there is no calibration pose {pose!r}", advice="choose from " + ", ".join(POSES))
    if len(set(poses)) < len(poses) or not poses:
        advice = "name each pose once: " + ", ".join(POSES)
        raise SubjectError("a calibration pose is named twice, or none is named", advice=advice)


def _positions(take: MarkerTake, marker_set: MarkerSet) -> Array:
    """Return the markers (F, M, 3) of a set; raise SubjectError if the take lacks one."""
    missing = [name for name in marker_set.names if name not in take.names]
    if missing:
        raise SubjectError(
            "the take has no marker " + ", ".join(missing),
            where=take.name,
            advice="its markers are " + ", ".join(take.names) + "; choose the marker set that was worn",
        )
    return take.positions_m[:, [take.names.index(name) for name in marker_set.names]]


def _median(positions: Array, window: slice) -> Array:
    """Return the markers' median positions (M, 3) in a window, NaN for hidden ones."""
    seen = np.all(np.isfinite(positions[window]), axis=-1)
    result = np.full(positions.shape[1:], np.nan)
    for marker in np.flatnonzero(seen.any(axis=0)):
        result[marker] = np.median(positions[window][seen[:, marker], marker], axis=0)
    return result


def _distance(points: Array, template: Array) -> float:
    """Return the RMS distance of the visible points (M, 3) from a template (M, 3) rigidly fitted to them."""
    seen = np.isfinite(points[:, 0])
    if seen.sum() < 3:
        return np.inf
    matrix, translation = kabsch(template[seen], points[seen])
    error = transform(matrix, translation, template[seen]) - points[seen]
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


def _still(positions: Array, fps: float, seconds: float) -> Iterator[slice]:
    """Yield the windows in which the markers are still, in order of time; SubjectError if there are none."""
    length = min(max(2, round(seconds * fps)), len(positions))
    some = seen_at_all = False
    for start in range(0, len(positions) - length + 1, max(1, length // 4)):
        window = positions[start : start + length]
        seen = np.all(np.isfinite(window), axis=-1).any(axis=0)
        if seen.sum() < min(3, positions.shape[1]):
            continue
        seen_at_all = True
        spread = np.nanmax(window[:, seen], axis=0) - np.nanmin(window[:, seen], axis=0)
        # markers that are mostly hidden must not make a window look still
        moved = max(float(np.linalg.norm(spread, axis=-1).max()) - LIMITS.noise_m, 0.0)
        if moved * fps / length + 0.1 * np.mean(~np.isfinite(window)) < LIMITS.still_m_s:
            some = True
            yield slice(start, start + length)
    if some:
        return
    if not seen_at_all:
        raise SubjectError("fewer than three markers are seen at once", advice="record the calibration pose again")
    raise SubjectError(
        f"the markers are never still for {length / fps:.1f} s",
        advice="hold the calibration pose, give the frames in which it is held, or fit the body to motion instead",
    )


def calibrate_subject(
    points_m: Array, marker_set: MarkerSet, prototypes: Sequence[Skeleton], name: str, *poses: str
) -> SubjectCalibration:
    """Return the subject whose markers are at `points_m` in the calibration poses.

    Args:
        points_m: Markers (N, M, 3), or (M, 3) in one pose, in world axes; NaN where a marker is hidden.
        marker_set: Markers with their joints, and their usual offsets if known.
        prototypes: Bodies of many sizes with the standard skeleton's joints.
        poses: Names (N) in `POSES`, by default the T pose; the first one defines the upright trunk.

    Raises:
        SubjectError: There are too few markers, a pose is unknown, or a limb is far from its pose.
    """
    poses = poses or ("t",)
    check_poses(poses)
    points = np.asarray(points_m, dtype=np.float64).reshape(len(poses), len(marker_set), 3)
    seen = np.all(np.isfinite(points), axis=-1)
    _check_seen(seen, marker_set, name)
    fit = fit_body(points, marker_set, prototypes, [POSES[pose] for pose in poses])
    _check_limbs(fit, poses)
    shown, offsets = _shown(fit, points, marker_set)
    error = np.where(seen, np.sum((shown - points) ** 2, axis=-1), 0.0)
    residuals = np.sqrt(error.sum(axis=0) / seen.sum(axis=0))
    residual = float(np.sqrt(error.sum() / seen.sum()))
    advice = _hidden(seen, marker_set, poses)
    advice += _advice(fit, poses, residual, dict(zip(marker_set.texts, residuals.tolist(), strict=True)))
    return SubjectCalibration(
        subject=Subject(name, fit.skeleton, marker_set.with_offsets(offsets), residual),
        sigmas_m=dict(zip(fit.skeleton.names, fit.sigmas_m.tolist(), strict=True)),
        marker_residuals_m=dict(zip(marker_set.names, residuals.tolist(), strict=True)),
        verdict="redo" if residual > LIMITS.residual_m else "usable" if advice else "good",
        advice=advice,
    )


def calibrate_markers(
    points_m: Array, marker_set: MarkerSet, known: Subject, name: str, *poses: str
) -> SubjectCalibration:
    """Return a known performer with markers that were moved, added or removed.

    The bones are kept. The earlier marker offsets help to find the held pose. Arguments and errors are those of
    `calibrate_subject`.

    Args:
        known: The performer, calibrated with any marker set.
    """
    before = {(marker.name, marker.joint): marker.offset_m for marker in known.marker_set.markers}
    markers = tuple(
        replace(marker, offset_m=before.get((marker.name, marker.joint), marker.offset_m))
        for marker in marker_set.markers
    )
    return calibrate_subject(points_m, replace(marker_set, markers=markers), [known.skeleton], name, *poses)


def _check_seen(seen: Mask, marker_set: MarkerSet, name: str) -> None:
    """Raise SubjectError for a pose that shows too few torso markers, and for markers that no pose shows."""
    for shown in seen:
        if np.sum(shown & marker_set.torso) < 3:
            unseen = [marker for marker, there in zip(marker_set.names, shown, strict=True) if not there]
            raise SubjectError(
                "fewer than three torso markers were visible (hidden: " + ", ".join(unseen) + ")",
                where=name,
                advice="stand so that the cameras see every marker, and record the pose again",
            )
    unseen = [marker for marker, there in zip(marker_set.names, seen.any(axis=0), strict=True) if not there]
    if unseen:
        raise SubjectError(
            "no frame shows " + ", ".join(unseen),
            where=name,
            advice="record the pose again, or use a smaller marker set",
        )


def _check_limbs(fit: BodyFit, poses: Sequence[str]) -> None:
    """Raise SubjectError for limbs far from the calibration pose."""
    for limb, off_deg, pose in _astray(fit, poses):
        if off_deg > LIMITS.farthest_swing_deg:
            raise SubjectError(
                f"{limb} is {off_deg:.0f} degrees away from where {_HELD_AS[pose]} puts it",
                advice="hold this pose, or choose the one that was held",
            )


def _astray(fit: BodyFit, poses: Sequence[str]) -> list[tuple[str, float, str]]:
    """Return each limb in each pose, its angle from that pose in degrees, and the pose."""
    words = {"l": "the left ", "r": "the right "}
    return [
        (words[joint[0]] + _LIMBS[joint[1:]], float(np.degrees(angle)), pose)
        for pose, limbs in zip(poses, fit.astray_rad, strict=True)
        for joint, angle in limbs.items()
    ]


def _shown(fit: BodyFit, points: Array, marker_set: MarkerSet) -> tuple[Array, Array]:
    """Return the fitted body's markers (N, M, 3) at their usual offsets, and the observed offsets (M, 3)."""
    joints = marker_set.joint_indices(fit.skeleton)
    positions, world = forward_kinematics(fit.skeleton, fit.rotations, fit.root_positions_m)
    shown = positions[:, joints] + rot.rotate(world[:, joints], usual_offsets(marker_set))
    offsets = rot.rotate(rot.conjugate(world[:, joints]), points - positions[:, joints])
    return shown, np.nanmean(offsets, axis=0)


def _hidden(seen: Mask, marker_set: MarkerSet, poses: Sequence[str]) -> tuple[str, ...]:
    """Return advice on markers that a pose hides."""
    return tuple(
        f"the marker of the {text} was not seen in {_HELD_AS[pose]}: stand so that both cameras see all markers"
        for pose, shown in zip(poses, seen, strict=True)
        for text, there in zip(marker_set.texts, shown, strict=True)
        if not there
    )


def _advice(fit: BodyFit, poses: Sequence[str], residual_m: float, markers_m: dict[str, float]) -> tuple[str, ...]:
    """Return advice on the calibration, most important first."""
    advice = []
    if residual_m > LIMITS.residual_m:
        advice.append(
            "the markers do not fit the pose or the marker set: check both, record the pose again, or fit the body to "
            "motion instead"
        )
    advice += [
        f"the marker of the {text} is {1e3 * off:.0f} mm from its usual position: check where it is worn"
        for text, off in markers_m.items()
        if off > LIMITS.odd_marker_m
    ]
    shoulder_m = max(fit.sigmas_m[fit.skeleton.index(side + "humerus")] for side in "lr")
    missing = [name for name in CALIBRATION if name not in poses]
    if shoulder_m > LIMITS.shoulder_m and missing:
        advice.append(
            f"shoulders, and so arms, are known only to within {1e3 * shoulder_m:.0f} mm: hold these poses as well: "
            + ", ".join(_HELD_AS[name] for name in missing)
        )
    advice += [
        f"{limb} was {off:.0f} degrees away from where {_HELD_AS[pose]} puts it: look at a picture of the pose"
        for limb, off, pose in _astray(fit, poses)
        if off > LIMITS.careless_deg
    ]
    return tuple(advice)
