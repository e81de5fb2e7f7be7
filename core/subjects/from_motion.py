"""Skeleton and marker offsets of a performer from motion alone.

Poses and body are found in turn: the solver completes the poses for the body known so far, then bone lengths and
marker offsets are fitted to all frames at once. With the joint rotations fixed the markers are linear in both, so the
fit is one ridge regression about the usual proportions and offsets (cf. the attachment phase of O'Brien et al. 2000,
where joint centres are linear in the same way).
"""

from dataclasses import replace

import numpy as np

from ..body.scene_pose import PerformerPose
from ..body.skeleton import Skeleton, forward_kinematics
from ..database.store import Database
from ..errors import SubjectError
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray, Mask
from ..markers.marker_set import MarkerSet
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from ..markers.take_frames import take_frames
from ..session.session import Session
from ..solver.settings import SolveSettings
from ..system.progress import Progress, no_progress

_ROUNDS = 4
_MOST_FRAMES = 300  # of the take that are looked at; more tell little new about the body
_LARGE_M = 0.06  # a frame with a larger median marker error shows no pose to learn from
_FEWEST_FRAMES = 20
_TORSO = 3  # markers by which the root is found
_SIZE_SIGMA = 0.08  # standard deviation of the whole body's size about the first estimate
_PART_SIGMA = 0.04  # of a part's share in it
_OFFSET_SIGMA_M = 0.02  # of a marker about its usual place on the body
_MARKER_SIGMA_M = 0.01  # of a marker about the modelled one, skin and solver together
_INDEPENDENT_FRAMES = 30.0  # frames that follow each other repeat each other's errors: all count as so many

_PARTS: dict[str, tuple[str, ...]] = {
    "hips": ("femur",),
    "trunk": ("lowerback", "upperback", "thorax", "lowerneck", "upperneck", "head", "clavicle", "humerus"),
    "thighs": ("tibia",),
    "shanks": ("foot",),
    "feet": ("toes",),
    "arms": ("radius", "wrist", "hand", "fingers", "thumb"),
}


def subject_from_motion(
    take: MarkerTake, start: Subject, database: Database, progress: Progress = no_progress
) -> Subject:
    """Return the subject with the bones and offsets that explain a take best.

    Args:
        take: labelled; nobody need stand still in it.
        start: first guess of the body with the usual offsets, to which the result is drawn.
        database: motion of the kind that the take shows.

    Returns:
        The subject; its residual is the RMS marker error over the frames, metres.

    Raises:
        SubjectError: too few frames could be explained.
        TakeError: the take lacks torso markers.
    """
    part = frames_of(take, slice(0, _MOST_FRAMES))
    observed = _observed(part, start.marker_set)
    subject = start
    for round_ in range(_ROUNDS):
        progress(round_ / _ROUNDS, "fitting the body")
        rotations, good = _poses(part, subject, database)
        used = int(good.sum())
        if used < _FEWEST_FRAMES:
            raise _refusal(used, observed[:, start.marker_set.torso], take.name)
        subject = _fitted(rotations[good], observed[good], start)
    return subject


def _refusal(used: int, torso: Array, name: str) -> SubjectError:
    """Return the error for a take with only `used` frames that fit."""
    shown = int(np.sum(np.sum(np.isfinite(torso[..., 0]), axis=1) >= _TORSO))
    if shown < _FEWEST_FRAMES:
        advice = "check them in the program that the take is from"
        return SubjectError(f"only {shown} frames show {_TORSO} markers of the torso", where=name, advice=advice)
    advice = "choose the marker set that was worn, or a database with such motion"
    return SubjectError(f"only {used} frames fit a body", where=name, advice=advice)


def frames_of(take: MarkerTake, frames: slice) -> MarkerTake:
    """Return part of a take; TakeError when nothing is left of it."""
    return replace(
        take,
        positions_m=take.positions_m[frames],
        frame_numbers=take.frame_numbers[frames],
        times_s=take.times_s[frames],
        single=take.single.select(frames) if take.single is not None else None,
    )


def _observed(take: MarkerTake, marker_set: MarkerSet) -> Array:
    """Return (F, M, 3) positions in the set's order, NaN where the take has none."""
    result = np.full((take.frames, len(marker_set), 3), np.nan)
    for column, name in enumerate(marker_set.names):
        if name in take.names:
            result[:, column] = take.positions_m[:, take.names.index(name)]
    return result


def _poses(take: MarkerTake, subject: Subject, database: Database) -> tuple[Array, Mask]:
    """Return joint rotations (F, J, 4) and a mask of well solved frames."""
    session = Session(subject, database, settings=SolveSettings())
    poses = [session.step(frame) for frame in take_frames(take, subject.marker_set)]
    # the median: a marker on a wand is as far from its usual place as no body explains, and just that is to be found
    good = np.array([_median_m(pose) < _LARGE_M and pose.confidence > 0.0 for pose in poses])
    return np.array([pose.rotations for pose in poses]), good


def _fitted(rotations: Array, observed: Array, start: Subject) -> Subject:
    """Return the subject of least marker error under rotations (F, J, 4)."""
    by_part, by_offset, modelled = _linear_model(rotations, start)
    count, markers = observed.shape[:2]
    seen = np.all(np.isfinite(observed), axis=-1)
    # the root's position is free in every frame: only differences to the frame's mean marker count
    residual = _less_mean(observed - modelled, seen).reshape(-1)
    columns = _less_mean(np.concatenate((by_part, by_offset), axis=-1), seen).reshape(count * markers * 3, -1)
    weight = min(1.0, _INDEPENDENT_FRAMES / count) / _MARKER_SIGMA_M**2
    normal = weight * columns.T @ columns + _prior(by_part.shape[-1], markers)
    solution = np.linalg.solve(normal, weight * columns.T @ residual)
    error = (residual - columns @ solution).reshape(count, markers, 3)
    rms = float(np.sqrt(np.sum(error**2) / seen.sum()))
    parts = solution[: by_part.shape[-1]]
    offsets = start.marker_set.offsets_m + solution[by_part.shape[-1] :].reshape(-1, 3)
    return Subject(start.name, _sized(start.skeleton, parts), start.marker_set.with_offsets(offsets), rms)


def _less_mean(values: Array, seen: Mask) -> Array:
    """Return values (F, M, ...) less the mean of the seen markers, 0 elsewhere."""
    shown = seen.reshape(*seen.shape, *[1] * (values.ndim - 2))
    share = np.maximum(shown.sum(axis=1, keepdims=True), 1)
    mean = np.sum(values, axis=1, where=shown, keepdims=True) / share
    return np.where(shown, values - mean, 0.0)


def _linear_model(rotations: Array, subject: Subject) -> tuple[Array, Array, Array]:
    """Return the derivatives by part sizes and offsets, and the markers (F, M, 3)."""
    skeleton, joints = subject.skeleton, subject.marker_set.joint_indices(subject.skeleton)
    positions, world = forward_kinematics(skeleton, rotations, np.zeros(3))
    parts = _part_of_joint(skeleton)
    by_part = np.empty((*rotations.shape[:1], len(joints), 3, len(_PARTS)))
    for part in range(len(_PARTS)):
        only = np.where((parts == part)[:, None], skeleton.offsets_m, 0.0)
        kept = replace(skeleton, offsets_m=only)
        by_part[..., part] = forward_kinematics(kept, rotations, np.zeros(3))[0][:, joints]
    turns = rot.to_matrix(world[:, joints])
    by_offset = np.zeros((len(rotations), len(joints), 3, 3 * len(joints)))
    for marker in range(len(joints)):
        by_offset[:, marker, :, 3 * marker : 3 * marker + 3] = turns[:, marker]
    offsets = subject.marker_set.offsets_m
    markers = positions[:, joints] + np.einsum("fmij,mj->fmi", turns, offsets)
    return by_part, by_offset, markers


def _part_of_joint(skeleton: Skeleton) -> IntArray:
    """Return (J,) the part of each joint's offset from its parent; -1 for the root."""
    result = np.full(len(skeleton), -1, dtype=np.int64)
    for number, members in enumerate(_PARTS.values()):
        for joint, name in enumerate(skeleton.names):
            if name in members or (name[:1] in "lr" and name[1:] in members):
                result[joint] = number
    return result


def _prior(parts: int, markers: int) -> Array:
    """Return the inverse covariance of part sizes and offsets."""
    covariance = np.full((parts, parts), _SIZE_SIGMA**2) + _PART_SIGMA**2 * np.eye(parts)
    result = np.zeros((parts + 3 * markers, parts + 3 * markers))
    result[:parts, :parts] = np.linalg.inv(covariance)
    diagonal = np.arange(parts, parts + 3 * markers)
    result[diagonal, diagonal] = _OFFSET_SIGMA_M**-2
    return result


def _sized(skeleton: Skeleton, parts: Array) -> Skeleton:
    """Return the skeleton with each part's bones longer by its share."""
    part = _part_of_joint(skeleton)
    factors = np.where(part >= 0, 1.0 + parts[part], 1.0)
    offsets = skeleton.offsets_m * factors[:, None]
    tips = skeleton.tips_m.copy()
    for joint in range(len(skeleton)):
        followers = [
            child
            for child in np.flatnonzero(skeleton.parents == joint)
            if np.allclose(skeleton.offsets_m[child], skeleton.tips_m[joint], atol=1e-6)
        ]
        tips[joint] = offsets[followers[0]] if followers else skeleton.tips_m[joint] * factors[joint]
    return replace(skeleton, offsets_m=offsets, tips_m=tips)


def _median_m(pose: PerformerPose) -> float:
    """Return the median distance between solved and observed markers, or NaN."""
    distances = np.linalg.norm(pose.observed_m - pose.markers_m, axis=1)
    seen = np.isfinite(distances)
    return float(np.median(distances[seen])) if np.any(seen) else float("nan")
