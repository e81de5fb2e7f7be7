"""A person's skeleton and marker offsets from the markers of one calibration pose (section 4.2 of the paper).

Skeleton: the seen markers are written as a mixture of the markers of prototype bodies in the same pose; the same
mixture of their skeletons is the person's. The left side, with the middle of the body, and the right side are
measured apart. Offsets: the seen marker relative to its joint, in the joint's axes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from . import rotations as rot
from .calibration_pose import standing, t_pose
from .errors import SubjectError
from .marker_set import MarkerSet, Subject
from .marker_take import MarkerTake
from .product_skeleton import mirrored_name
from .rigid import kabsch, transform
from .skeleton import Skeleton, forward_kinematics

Array = NDArray[np.float64]

POSES: dict[str, Callable[[Skeleton], Array]] = {"t": t_pose, "standing": standing}

_ROUNDS = 6  # mixture and placement each need the other
_SPREAD_PENALTY = 0.02  # metres of marker error that an uneven mixture is worth: few markers leave it open
_SUM_WEIGHT = 100.0  # metres: makes the mixture's weights add up to one
_FARTHEST_SWING_DEG = 35.0  # of a straight limb from the calibration pose: nobody holds it exactly
_NOISE_M = 0.03  # by which measurement alone spreads a marker that is held still
_STILL_M_S = 0.15  # a marker moving faster is not held still
_LIMBS = {"humerus": ("humerus", "radius", "wrist", "hand", "fingers", "thumb"), "femur": ("femur", "tibia", "foot")}


@dataclass(frozen=True)
class SubjectCalibration:
    """A calibrated subject and how well the prototypes explained its markers.

    Args:
        subject: skeleton and offsets.
        bones_m: length of each bone by joint name.
        used_markers: markers that were seen.
    """

    subject: Subject
    bones_m: dict[str, float]
    used_markers: tuple[str, ...]


def calibration_points(
    take: MarkerTake, marker_set: MarkerSet, seconds: float = 1.0, frames: slice = slice(None)
) -> Array:
    """Return the median positions (M, 3) of the set's markers while the performer first stands still.

    Markers that are not seen then are NaN.

    Args:
        take: shows the calibration pose among other things.
        marker_set: markers that are wanted.
        seconds: how long the pose is held.
        frames: part of the take that is looked at.

    Raises:
        SubjectError: the take lacks markers of the set.
    """
    missing = [name for name in marker_set.names if name not in take.names]
    if missing:
        raise SubjectError(
            "the take has no marker " + ", ".join(missing),
            where=take.name,
            advice="its markers are " + ", ".join(take.names) + "; choose the marker set that was worn",
        )
    columns = [take.names.index(name) for name in marker_set.names]
    positions = take.positions_m[frames][:, columns]
    start, stop = _stillest(positions, take.fps, max(2, round(seconds * take.fps)))
    window = positions[start:stop]
    seen = np.all(np.isfinite(window), axis=-1)
    result = np.full(window.shape[1:], np.nan)
    for marker in np.flatnonzero(seen.any(axis=0)):
        result[marker] = np.median(window[seen[:, marker], marker], axis=0)
    return result


def _stillest(positions: Array, fps: float, length: int) -> tuple[int, int]:
    """Return the first window in which every marker that is seen stays still; SubjectError where there is none."""
    length = min(length, len(positions))
    speeds = np.full(len(positions), np.inf)
    for start in range(0, len(positions) - length + 1, max(1, length // 4)):
        window = positions[start : start + length]
        seen = np.all(np.isfinite(window), axis=-1).any(axis=0)
        if seen.sum() < min(3, positions.shape[1]):
            continue
        spread = np.nanmax(window[:, seen], axis=0) - np.nanmin(window[:, seen], axis=0)
        # markers that are hardly seen must not make a window look still
        moved = max(float(np.linalg.norm(spread, axis=-1).max()) - _NOISE_M, 0.0)
        speeds[start] = moved * fps / length + 0.1 * np.mean(~np.isfinite(window))
        if speeds[start] < _STILL_M_S:
            return start, start + length
    if not np.isfinite(speeds).any():
        raise SubjectError("fewer than three markers are seen at once", advice="record the calibration pose again")
    raise SubjectError(
        f"the markers are never still for {length / fps:.1f} s",
        advice="hold the calibration pose, name the frames in which it is held, or fit to motion with --database",
    )


def calibrate_subject(
    points_m: Array, marker_set: MarkerSet, prototypes: Sequence[Skeleton], name: str, pose: str = "t"
) -> SubjectCalibration:
    """Return the subject that shows `points_m` in the calibration pose.

    Args:
        points_m: (M, 3) seen markers in the world (y up), NaN where unseen.
        marker_set: its joints, and its usual offsets where it has them.
        prototypes: bodies of many sizes with the product's joints.
        name: of the person.
        pose: one of `POSES`.

    Raises:
        SubjectError: too few markers, an unknown pose, or no prototype body comes near the markers.
    """
    if pose not in POSES:
        raise SubjectError(f"there is no calibration pose {pose!r}", advice="poses: " + ", ".join(POSES))
    seen = np.all(np.isfinite(points_m), axis=-1)
    unseen = [marker.name for marker, there in zip(marker_set.markers, seen, strict=True) if not there]
    if np.sum(seen & marker_set.torso) < 3:
        raise SubjectError(
            "fewer than three torso markers were seen (unseen: " + ", ".join(unseen) + ")",
            where=name,
            advice="stand so that both cameras see every marker, and record the pose again",
        )
    if unseen:
        raise SubjectError(
            "never seen: " + ", ".join(unseen), where=name, advice="record the pose again, or use a smaller marker set"
        )
    placed = _place(points_m, marker_set, prototypes, POSES[pose])
    offsets = _offsets(points_m, marker_set, placed)
    subject = Subject(name, placed.skeleton, marker_set.with_offsets(offsets), placed.residual_m)
    lengths = np.linalg.norm(placed.skeleton.tips_m, axis=1)
    bones = {joint: float(length) for joint, length in zip(placed.skeleton.names, lengths, strict=True)}
    return SubjectCalibration(subject, bones, tuple(np.array(marker_set.names)[seen]))


def calibrate_markers(
    points_m: Array, marker_set: MarkerSet, known: Subject, name: str, pose: str = "t"
) -> SubjectCalibration:
    """Return a known person with other markers: what is needed after one has been moved, added or taken off.

    The bones stay. Markers that the person wore before help, where they were, to find the pose that is held.

    Args:
        points_m, marker_set, name, pose: as for `calibrate_subject`.
        known: the person, calibrated with any marker set.

    Raises:
        SubjectError: as for `calibrate_subject`.
    """
    before = {(marker.name, marker.joint): marker.offset_m for marker in known.marker_set.markers}
    markers = tuple(
        replace(marker, offset_m=before.get((marker.name, marker.joint), marker.offset_m))
        for marker in marker_set.markers
    )
    return calibrate_subject(points_m, replace(marker_set, markers=markers), [known.skeleton], name, pose)


@dataclass(frozen=True)
class _Placed:
    skeleton: Skeleton
    rotations: Array
    root_position_m: Array
    residual_m: float


def _place(
    points_m: Array, marker_set: MarkerSet, prototypes: Sequence[Skeleton], pose: Callable[[Skeleton], Array]
) -> _Placed:
    """Find mixture, placement and limb directions in turn."""
    usual = _usual_offsets(marker_set)
    joints = marker_set.joint_indices(prototypes[0])
    swings = rot.identity((len(prototypes[0]),))
    skeleton = prototypes[len(prototypes) // 2]
    for _ in range(_ROUNDS):
        local, _ = _pose_markers(skeleton, pose, swings, joints, usual)
        matrix, translation = kabsch(local, points_m, np.where(marker_set.torso, 2.0, 1.0))
        seen_local = (points_m - translation) @ matrix
        candidates = np.array([_pose_markers(p, pose, swings, joints, usual)[0] for p in prototypes])
        skeleton = _mixed(prototypes, candidates, seen_local, joints)
        swings = _swings(skeleton, pose, swings, joints, usual, seen_local)
    _check_pose(skeleton, swings)
    local, rotations = _pose_markers(skeleton, pose, swings, joints, usual)
    matrix, translation = kabsch(local, points_m, np.where(marker_set.torso, 2.0, 1.0))
    rotations[0] = rot.multiply(rot.from_matrix(matrix), rotations[0])
    error = transform(matrix, translation, local) - points_m
    return _Placed(skeleton, rotations, translation, float(np.sqrt(np.mean(np.sum(error**2, axis=1)))))


def _check_pose(skeleton: Skeleton, swings: Array) -> None:
    """Refuse a pose whose limbs are elsewhere than the calibration pose has them."""
    for base, limb in (("humerus", "arm"), ("femur", "leg")):
        for side, word in (("l", "left"), ("r", "right")):
            off = float(np.degrees(rot.angle_between(rot.identity(), swings[skeleton.index(side + base)])))
            if off > _FARTHEST_SWING_DEG:
                raise SubjectError(
                    f"the {word} {limb} is {off:.0f} degrees away from where the pose has it",
                    advice="take the pose that is asked for, or name the one that was taken",
                )


def _usual_offsets(marker_set: MarkerSet) -> Array:
    """Return usual offsets (M, 3); zero, on the joint itself, where the set names none."""
    return np.array([marker.offset_m or (0.0, 0.0, 0.0) for marker in marker_set.markers])


def _pose_markers(
    skeleton: Skeleton, pose: Callable[[Skeleton], Array], swings: Array, joints: NDArray[np.int64], offsets: Array
) -> tuple[Array, Array]:
    """Return the markers (M, 3) of the calibration pose with the root at the origin, and its rotations."""
    rotations = rot.multiply(swings, pose(skeleton))
    positions, world = forward_kinematics(skeleton, rotations, np.zeros(3))
    return positions[joints] + rot.rotate(world[joints], offsets), rotations


def _mixed(prototypes: Sequence[Skeleton], candidates: Array, seen_local: Array, joints: NDArray[np.int64]) -> Skeleton:
    """Return the mixture of prototypes whose markers come closest, each side of the body on its own."""
    names = prototypes[0].names
    sides = np.array([name[0] if mirrored_name(name) != name else "m" for name in names])
    offsets = np.array([p.offsets_m for p in prototypes])
    tips = np.array([p.tips_m for p in prototypes])
    mixed_offsets, mixed_tips = np.empty_like(offsets[0]), np.empty_like(tips[0])
    for side in "mlr":
        counted = np.isin(sides[joints], ("m", side)) if side != "m" else np.ones(len(joints), dtype=bool)
        weights = _mixture(candidates[:, counted].reshape(len(prototypes), -1), seen_local[counted].ravel())
        mixed_offsets[sides == side] = np.einsum("p,pjc->jc", weights, offsets[:, sides == side])
        mixed_tips[sides == side] = np.einsum("p,pjc->jc", weights, tips[:, sides == side])
    first = prototypes[0]
    return Skeleton(names, first.parents, mixed_offsets, mixed_tips, first.angle_axes, first.angle_orders)


def _mixture(candidates: Array, target: Array) -> Array:
    """Return weights >= 0 with sum 1 of candidates (P, n) closest to `target` (n), as even as the data allow."""
    count = len(candidates)
    even = _SPREAD_PENALTY * np.eye(count)
    system = np.concatenate((candidates.T, np.full((1, count), _SUM_WEIGHT), even))
    values = np.concatenate((target, [_SUM_WEIGHT], np.full(count, _SPREAD_PENALTY / count)))
    weights, _ = nnls(system, values)
    return np.asarray(weights / weights.sum())


def _swings(
    skeleton: Skeleton,
    pose: Callable[[Skeleton], Array],
    swings: Array,
    joints: NDArray[np.int64],
    offsets: Array,
    seen_local: Array,
) -> Array:
    """Turn whole arms and legs, kept straight, towards their seen markers: nobody holds the pose exactly."""
    result = swings.copy()
    positions, world = forward_kinematics(skeleton, rot.multiply(swings, pose(skeleton)), np.zeros(3))
    markers = positions[joints] + rot.rotate(world[joints], offsets)
    for side in "lr":
        for base, members in _LIMBS.items():
            carriers = [skeleton.index(side + member) for member in members]
            on_limb = np.isin(joints, carriers)
            if not on_limb.any():
                continue
            pivot = skeleton.index(side + base)
            here, there = markers[on_limb] - positions[pivot], seen_local[on_limb] - positions[pivot]
            turn_world = rot.between(here.sum(axis=0), there.sum(axis=0))
            parent = world[skeleton.parents[pivot]]
            turn = rot.multiply(rot.multiply(rot.conjugate(parent), turn_world), parent)
            result[pivot] = rot.multiply(turn, swings[pivot])
    return result


def _offsets(points_m: Array, marker_set: MarkerSet, placed: _Placed) -> Array:
    """Return the seen markers relative to their joints, in the joints' axes."""
    joints = marker_set.joint_indices(placed.skeleton)
    positions, world = forward_kinematics(placed.skeleton, placed.rotations, placed.root_position_m)
    return rot.rotate(rot.conjugate(world[joints]), points_m - positions[joints])
