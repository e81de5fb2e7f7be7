"""Estimation of a performer's skeleton and marker offsets from motion alone.

Poses and body are found in turn: the solver completes the poses for the current body, then bone lengths and marker
offsets are fitted to all frames together. With fixed joint rotations the markers are linear in both, so the fit is one
ridge regression towards the usual proportions and offsets. Finally `refine_body` corrects the body, if the database
contains similar motion.
"""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.scene_pose import PerformerPose
from ..database.store import Database
from ..errors import SubjectError
from ..geometry.arrays import Array, IntArray, Mask
from ..markers.marker_set import MarkerSet, PointKind
from ..markers.marker_take import MarkerTake
from ..markers.source_noise import SourceNoise, noise_of
from ..markers.subject import Subject
from ..markers.take_frames import take_frames
from ..session.session import Session
from ..system.progress import Progress, no_progress
from .body_change import SIGMAS, linear_model, observed_positions, part_covariance, sized
from .keypoint_bones import sized_by_distances
from .refine_body import refine_body

_TORSO = 3  # fewest torso markers that locate the root


@dataclass(frozen=True)
class MotionFitSettings:
    """Settings of the fit to motion."""

    rounds: int = 4
    most_frames: int = 300  # largest number of frames used; more say little more about the body
    stretches: int = 6  # number of equal parts of a long take, each of which supplies one stretch of frames
    fewest_frames: int = 20
    large_m: float = 0.06  # median marker error above which a frame is left out
    large_sigmas: float = 3.0  # added to `large_m`, in standard deviations of the source's lasting errors
    marker_sigma_m: float = 0.01  # distance of a marker from the modelled one, due to skin motion and solver
    # factors of the prior standard deviations for keypoints, whose distances gave the bones and which lie near joints
    keypoint_shares: tuple[float, float] = (0.1, 0.1)  # of sizes and of offsets
    independent_frames: float = 30.0  # weight of all frames together, because nearby frames repeat each other's errors


SETTINGS = MotionFitSettings()


def subject_from_motion(
    take: MarkerTake, start: Subject, database: Database, progress: Progress = no_progress
) -> Subject:
    """Return the subject with the bones and offsets that best explain a take.

    Its residual is the RMS marker error over the frames.

    Args:
        take: Labelled take; it need not show a held pose.
        start: First guess of the body, with the usual offsets; the fit is regularised towards it.
        database: Database with motion like the take's.

    Raises:
        SubjectError: Too few frames could be explained.
        TakeError: The take lacks torso markers.
    """
    subject = fitted_body(take, start, database, progress)
    if start.marker_set.points is PointKind.KEYPOINTS:  # errors of keypoints would be mistaken for errors of the bones
        return subject
    with contextlib.suppress(SubjectError):  # the motion is unlike the database
        subject = refine_body(take, subject, database).subject
    return subject


def fitted_body(take: MarkerTake, start: Subject, database: Database, progress: Progress = no_progress) -> Subject:
    """Return the subject without the final correction; arguments and errors are those of `subject_from_motion`."""
    part = frames_of(take, _telling_frames(observed_positions(take, start.marker_set), start.marker_set.torso))
    observed = observed_positions(part, start.marker_set)
    if start.marker_set.points is PointKind.KEYPOINTS:
        start = sized_by_distances(start, observed_positions(take, start.marker_set))
    subject = start
    for round_ in range(SETTINGS.rounds):
        progress(round_ / SETTINGS.rounds, "fitting the body")
        rotations, good = _poses(part, subject, database)
        used = int(good.sum())
        if used < SETTINGS.fewest_frames:
            raise _refusal(used, observed[:, start.marker_set.torso], take)
        subject = body_of_poses(rotations[good], observed[good], start, noise_of(start.marker_set.points))
    return subject


def _telling_frames(observed: Array, torso: Mask) -> IntArray:
    """Return the frames to fit: all that show the torso or, from a long take, stretches spread over its length.

    In each part of the take, the stretch with the most markers is chosen.
    """
    seen = np.isfinite(observed[..., 0])
    shown = np.flatnonzero(seen[:, torso].sum(axis=1) >= _TORSO)
    if len(shown) <= SETTINGS.most_frames:
        return shown if len(shown) else np.arange(min(len(observed), SETTINGS.most_frames))
    length = SETTINGS.most_frames // SETTINGS.stretches
    chosen = []
    for part in np.array_split(shown, SETTINGS.stretches):
        markers = np.convolve(seen[part].sum(axis=1), np.ones(length), mode="valid")
        first = int(np.argmax(markers))
        chosen.append(part[first : first + length])
    return np.concatenate(chosen)


def _refusal(used: int, torso: Array, take: MarkerTake) -> SubjectError:
    """Return the error for a take of which only `used` frames fit a body."""
    shown = int(np.sum(np.sum(np.isfinite(torso[..., 0]), axis=1) >= _TORSO))
    needed = f"but at least {SETTINGS.fewest_frames} are needed"
    if shown < SETTINGS.fewest_frames:
        what = f"only {shown} of {take.frames} frames show {_TORSO} torso markers, {needed}"
        advice = "record a longer take, or check these markers in the program that the take is from"
        return SubjectError(what, where=take.name, advice=advice)
    advice = "choose the marker set that was worn, or a database with such motion"
    return SubjectError(f"only {used} of {shown} frames fit a body, {needed}", where=take.name, advice=advice)


def frames_of(take: MarkerTake, frames: slice | IntArray) -> MarkerTake:
    """Return part of a take; TakeError if it is empty."""
    return replace(
        take,
        positions_m=take.positions_m[frames],
        frame_numbers=take.frame_numbers[frames],
        times_s=take.times_s[frames],
        single=take.single.select(frames) if take.single is not None else None,
    )


def _poses(take: MarkerTake, subject: Subject, database: Database) -> tuple[Array, Mask]:
    """Return joint rotations (F, J, 4) and a mask (F,) of the well solved frames."""
    session = Session(subject, database)
    poses = [session.step(frame) for frame in take_frames(take, subject.marker_set)]
    return np.array([pose.rotations for pose in poses]), well_solved(poses, subject)


def well_solved(poses: Sequence[PerformerPose], subject: Subject) -> Mask:
    """Return a mask (F,) of poses that lie close enough to their markers to tell something about the body."""
    # the median, because single markers may be worn far from their usual positions, which is not corrected yet
    large_m = SETTINGS.large_m + SETTINGS.large_sigmas * noise_of(subject.marker_set.points).lasting_m
    return np.array([_median_m(pose) < large_m and pose.confidence > 0.0 for pose in poses], dtype=bool)


def body_of_poses(rotations: Array, observed: Array, start: Subject, source: SourceNoise) -> Subject:
    """Return the subject that best explains observed markers (F, M, 3) in poses with rotations (F, J, 4)."""
    by_part, by_offset, modelled = linear_model(rotations, start)
    count, markers = observed.shape[:2]
    seen = np.all(np.isfinite(observed), axis=-1)
    # the root's position is free in every frame, so markers are compared relative to their mean in that frame
    residual = _less_mean(observed - modelled, seen).reshape(-1)
    columns = _less_mean(np.concatenate((by_part, by_offset), axis=-1), seen).reshape(count * markers * 3, -1)
    variance = SETTINGS.marker_sigma_m**2 + source.lasting_m**2
    weight = min(1.0, SETTINGS.independent_frames / count) / variance
    normal = weight * columns.T @ columns + _prior(by_part.shape[-1], start.marker_set)
    solution = np.linalg.solve(normal, weight * columns.T @ residual)
    error = (residual - columns @ solution).reshape(count, markers, 3)
    rms = float(np.sqrt(np.sum(error**2) / seen.sum()))
    parts = solution[: by_part.shape[-1]]
    offsets = start.marker_set.offsets_m + solution[by_part.shape[-1] :].reshape(-1, 3)
    return Subject(start.name, sized(start.skeleton, parts), start.marker_set.with_offsets(offsets), rms)


def _less_mean(values: Array, seen: Mask) -> Array:
    """Return values (F, M, ...) minus each frame's mean over the visible markers; 0 for hidden markers."""
    shown = seen.reshape(*seen.shape, *[1] * (values.ndim - 2))
    share = np.maximum(shown.sum(axis=1, keepdims=True), 1)
    mean = np.sum(values, axis=1, where=shown, keepdims=True) / share
    return np.where(shown, values - mean, 0.0)


def _prior(parts: int, marker_set: MarkerSet) -> Array:
    """Return the inverse of the prior covariance of part sizes and marker offsets."""
    is_keypoints = marker_set.points is PointKind.KEYPOINTS
    of_sizes, of_offsets = SETTINGS.keypoint_shares if is_keypoints else (1.0, 1.0)
    sigmas = [of_offsets * (SIGMAS.placed_m if marker.placed else SIGMAS.offset_m) for marker in marker_set.markers]
    result = np.diag(np.repeat([1.0] * parts + sigmas, [1] * parts + [3] * len(sigmas)) ** -2.0)
    result[:parts, :parts] = np.linalg.inv(of_sizes**2 * part_covariance(parts))
    return result


def _median_m(pose: PerformerPose) -> float:
    """Return the median distance between solved and observed markers, NaN if none was observed."""
    distances = np.linalg.norm(pose.observed_m - pose.markers_m, axis=1)
    seen = np.isfinite(distances)
    return float(np.median(distances[seen])) if np.any(seen) else float("nan")
