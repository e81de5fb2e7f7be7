"""Skeleton and marker offsets of a performer from motion alone.

Poses and body are found in turn: the solver completes the poses for the body known so far, then bone lengths and
marker offsets are fitted to all frames at once. With the joint rotations fixed the markers are linear in both, so the
fit is one ridge regression about the usual proportions and offsets. At the end the body is refined by frames without a
past (see `refine_body`), as far as the database holds such motion.
"""

import contextlib
from dataclasses import replace

import numpy as np

from ..body.scene_pose import PerformerPose
from ..database.store import Database
from ..errors import SubjectError
from ..geometry.arrays import Array, Mask
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from ..markers.take_frames import take_frames
from ..session.session import Session
from ..system.progress import Progress, no_progress
from .body_change import OFFSET_SIGMA_M, PART_SIGMA, SIZE_SIGMA, linear_model, observed_positions, sized
from .refine_body import refine_body

_ROUNDS = 4
_MOST_FRAMES = 300  # of the take that are looked at; more tell little new about the body
_LARGE_M = 0.06  # a frame with a larger median marker error shows no pose to learn from
_FEWEST_FRAMES = 20
_TORSO = 3  # markers by which the root is found
_MARKER_SIGMA_M = 0.01  # of a marker about the modelled one, skin and solver together
_INDEPENDENT_FRAMES = 30.0  # frames that follow each other repeat each other's errors: all count as so many


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
    observed = observed_positions(part, start.marker_set)
    subject = start
    for round_ in range(_ROUNDS):
        progress(round_ / _ROUNDS, "fitting the body")
        rotations, good = _poses(part, subject, database)
        used = int(good.sum())
        if used < _FEWEST_FRAMES:
            raise _refusal(used, observed[:, start.marker_set.torso], take.name)
        subject = _fitted(rotations[good], observed[good], start)
    with contextlib.suppress(SubjectError):  # no more can be learned from motion unlike the database
        subject = refine_body(take, subject, database).subject
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


def _poses(take: MarkerTake, subject: Subject, database: Database) -> tuple[Array, Mask]:
    """Return joint rotations (F, J, 4) and a mask of well solved frames."""
    session = Session(subject, database, smooth=False)
    poses = [session.step(frame) for frame in take_frames(take, subject.marker_set)]
    # the median: a marker on a wand is as far from its usual place as no body explains, and just that is to be found
    good = np.array([_median_m(pose) < _LARGE_M and pose.confidence > 0.0 for pose in poses])
    return np.array([pose.rotations for pose in poses]), good


def _fitted(rotations: Array, observed: Array, start: Subject) -> Subject:
    """Return the subject of least marker error under rotations (F, J, 4)."""
    by_part, by_offset, modelled = linear_model(rotations, start)
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
    return Subject(start.name, sized(start.skeleton, parts), start.marker_set.with_offsets(offsets), rms)


def _less_mean(values: Array, seen: Mask) -> Array:
    """Return values (F, M, ...) less the mean of the seen markers, 0 elsewhere."""
    shown = seen.reshape(*seen.shape, *[1] * (values.ndim - 2))
    share = np.maximum(shown.sum(axis=1, keepdims=True), 1)
    mean = np.sum(values, axis=1, where=shown, keepdims=True) / share
    return np.where(shown, values - mean, 0.0)


def _prior(parts: int, markers: int) -> Array:
    """Return the inverse covariance of part sizes and offsets."""
    covariance = np.full((parts, parts), SIZE_SIGMA**2) + PART_SIGMA**2 * np.eye(parts)
    result = np.zeros((parts + 3 * markers, parts + 3 * markers))
    result[:parts, :parts] = np.linalg.inv(covariance)
    diagonal = np.arange(parts, parts + 3 * markers)
    result[diagonal, diagonal] = OFFSET_SIGMA_M**-2
    return result


def _median_m(pose: PerformerPose) -> float:
    """Return the median distance between solved and observed markers, or NaN."""
    distances = np.linalg.norm(pose.observed_m - pose.markers_m, axis=1)
    seen = np.isfinite(distances)
    return float(np.median(distances[seen])) if np.any(seen) else float("nan")
