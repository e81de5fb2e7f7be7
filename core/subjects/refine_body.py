"""Correct the bones and offsets of a calibrated performer by a take's motion.

Poses that were solved with wrong bones have swallowed the error, so they tell next to nothing. This looks at frames
without a past instead: the database's examples give a pose, with how sure it is, before the markers are met; where the
markers then are, beside where they should be (the innovation), shows the body. All is linear about the body found so
far, and Gaussian. How far a body may be off is learned from the take (empirical Bayes): a right body stays as it is.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from ..database.store import Database
from ..errors import SubjectError
from ..geometry.arrays import Array
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from ..solver.observation import Observation
from ..solver.pose_solver import PoseSolver
from ..solver.settings import BestSettings, SolveSettings
from ..solver.subject_model import SubjectModel
from ..system.progress import Progress, no_progress
from .body_change import (
    OFFSET_SIGMA_M,
    PART_SIGMA,
    PARTS,
    SIZE_SIGMA,
    linear_model,
    observed_positions,
    part_lengths_m,
    sized,
)

_ROUNDS = 4
_INTERVAL_S = 0.25  # between frames that are looked at
_MOST_FRAMES = 240  # that are looked at: one minute
_FEWEST_FRAMES = 3
_FARTHEST_M = 0.12  # from the closest example; beyond it the motion is another, not the body
_ROOT_SIGMA_M, _ROOT_SIGMA_RAD = 0.5, 0.3  # wide: the examples do not know where the body is
_MARKER_SIGMA_M = 0.01
_NEAREST_SHARE = 0.3  # of the distance to the closest example that its pose may be off besides
_FRAMES_PER_S = 1.2  # that tell something new; frames near each other repeat each other's errors
_PART_SCALES = (0.05, 0.2, 0.35, 0.5, 0.75, 1.0)  # of the usual deviations, tried
_OFFSET_SCALES = (0.05, 0.2, 0.35, 0.5)
# Deviations under which errors lie within twice the standard deviation 19 times of 20: chosen by bodies of five takes,
# right ones and wrong ones, and found to hold on five others
_TRUSTED_PART_SIGMA, _TRUSTED_OFFSET_SIGMA_M = 0.08, 0.015
_COMMON_SIGMA = 0.02  # all bones are found so much too short, whatever the take
_WITHOUT_PAST = SolveSettings(best=BestSettings(prior_share=0.0))  # the learned prior needs half a second of it


@dataclass(frozen=True)
class Refinement:
    """A corrected body.

    Args:
        subject: with its bones and offsets.
        whole: change of the length of all bones together, as a share; known better than that of a part.
        whole_sigma: standard deviation of this.
        sizes: part -> change of its bones' length, as a share.
        size_sigmas: part -> standard deviation of this.
        offset_sigmas_m: marker -> standard deviation of its offset along one axis.
        frames: that the body was found from.
        evidence: logarithm of how many times likelier the take is with a body that is off than with the start's.
    """

    subject: Subject
    whole: float
    whole_sigma: float
    sizes: dict[str, float]
    size_sigmas: dict[str, float]
    offset_sigmas_m: dict[str, float]
    frames: int
    evidence: float


@dataclass(frozen=True)
class _Evidence:
    """Evidence of frames about parts and offsets.

    Args:
        information: (N, N), of `vector` (N,): the least squares' normal equations.
    """

    information: Array
    vector: Array
    frames: int


def refine_body(take: MarkerTake, start: Subject, database: Database, progress: Progress = no_progress) -> Refinement:
    """Correct a subject's bones and offsets by a take's motion.

    Args:
        take: labelled; of any motion that the database knows.
        start: the body as it was calibrated.
        database: motion of the kind that the take shows.

    Raises:
        SubjectError: too few frames are near the database's motion.
        TakeError: the take lacks torso markers.
    """
    step = max(round(_INTERVAL_S * take.fps), 1)
    observed = observed_positions(take, start.marker_set)[::step][:_MOST_FRAMES]
    seconds = min(take.frames / take.fps, _INTERVAL_S * _MOST_FRAMES)
    change = np.zeros(len(PARTS) + 3 * len(start.marker_set))
    subject = start
    for round_ in range(_ROUNDS):

        def looked(share: float, round_: int = round_) -> None:
            progress((round_ + share) / _ROUNDS, "correcting the body")

        found = _evidence(observed, subject, database, looked)
        if found.frames < _FEWEST_FRAMES:
            raise SubjectError(
                f"only {found.frames} of {len(observed)} frames are near motion of the database",
                where=take.name,
                advice="choose a database with such motion, or leave the subject as it is",
            )
        # parts are shares of the body's present bones: of the start's, they are smaller by their change
        slope = np.append(1.0 / (1.0 + change[: len(PARTS)]), np.ones(len(change) - len(PARTS)))
        weight = _FRAMES_PER_S * seconds / len(observed)
        information = weight * found.information * np.outer(slope, slope)
        vector = weight * found.vector * slope + information @ change
        covariance, evidence = _posterior(information, vector)
        change = covariance @ vector
        parts, offsets = change[: len(PARTS)], change[len(PARTS) :].reshape(-1, 3)
        marker_set = start.marker_set.with_offsets(start.marker_set.offsets_m + offsets)
        subject = replace(start, skeleton=sized(start.skeleton, parts), marker_set=marker_set)
    trusted = _trusted_covariance(information)
    sigmas = np.sqrt(np.diag(trusted))
    lengths = part_lengths_m(start.skeleton)
    weights = lengths / lengths.sum()
    return Refinement(
        subject,
        float(weights @ change[: len(PARTS)]),
        float(np.sqrt(weights @ trusted[: len(PARTS), : len(PARTS)] @ weights)),
        dict(zip(PARTS, parts.tolist(), strict=True)),
        dict(zip(PARTS, sigmas[: len(PARTS)].tolist(), strict=True)),
        dict(zip(marker_set.names, sigmas[len(PARTS) :].reshape(-1, 3).max(axis=1).tolist(), strict=True)),
        found.frames,
        evidence,
    )


def _evidence(observed: Array, subject: Subject, database: Database, looked: Callable[[float], None]) -> _Evidence:
    """Return the evidence of frames (F, M, 3) about the subject's body.

    `looked` is called with the share of them that are done.
    """
    solver = PoseSolver(SubjectModel(subject, database.mean_rotations), database, _WITHOUT_PAST)
    model = solver.subject
    unknowns = len(PARTS) + 3 * len(subject.marker_set)
    information, vector, frames = np.zeros((unknowns, unknowns)), np.zeros(unknowns), 0
    root_variances = np.square(np.repeat((_ROOT_SIGMA_M, _ROOT_SIGMA_RAD), 3))
    for index, points_m in enumerate(observed):
        looked(index / len(observed))
        solution, state = solver.step(solver.initial_state, Observation.of_points(points_m), 0.0, limit_m=_FARTHEST_M)
        if solution is None or state.expectation is None or solution.nearest_m > _FARTHEST_M:
            continue
        expectation = state.expectation
        pose = expectation.prior.mean.reshape(-1, 3)
        seen = np.isfinite(points_m[:, 0])
        markers, jacobian = model.markers_and_jacobian(pose, expectation.root)
        by_root, by_pose = np.split(jacobian[seen].reshape(-1, jacobian.shape[-1]), [6], axis=1)
        spread = by_pose @ expectation.prior.covariance @ by_pose.T + (by_root * root_variances) @ by_root.T
        spread[np.diag_indices_from(spread)] += _MARKER_SIGMA_M**2 + (_NEAREST_SHARE * solution.nearest_m) ** 2
        by_part, by_offset, _ = linear_model(model.rotations(pose, expectation.root)[None], subject)
        columns = np.concatenate((by_part, by_offset), axis=-1)[0][seen].reshape(-1, unknowns)
        innovation = (points_m - markers)[seen].reshape(-1, 1)
        whitened = solve_triangular(np.linalg.cholesky(spread), np.hstack((columns, innovation)), lower=True)
        information += whitened[:, :-1].T @ whitened[:, :-1]
        vector += whitened[:, :-1].T @ whitened[:, -1]
        frames += 1
    return _Evidence(information, vector, frames)


def _posterior(information: Array, vector: Array) -> tuple[Array, float]:
    """Return the covariance of a body's change under the likeliest deviations.

    With the logarithm of how much likelier these are than the smallest.

    The likelihood of the take is taken over all bodies (type II maximum likelihood; MacKay 1992, "Bayesian
    interpolation").
    """
    best: Array = np.zeros_like(information)
    most, least = -np.inf, 0.0
    for part_scale in _PART_SCALES:
        for offset_scale in _OFFSET_SCALES:
            factor = _factor(
                len(vector), part_scale * SIZE_SIGMA, part_scale * PART_SIGMA, offset_scale * OFFSET_SIGMA_M
            )
            # in units of the deviations, so that the narrowest ones are no matter of rounding
            inner = np.eye(len(vector)) + factor.T @ information @ factor
            explained = np.linalg.solve(inner, factor.T @ vector)
            evidence = 0.5 * (vector @ factor @ explained - np.linalg.slogdet(inner)[1])
            if (part_scale, offset_scale) == (_PART_SCALES[0], _OFFSET_SCALES[0]):
                least = evidence
            if evidence > most:
                best, most = factor @ np.linalg.solve(inner, factor.T), evidence
    return best, float(most - least)


def _trusted_covariance(information: Array) -> Array:
    """Return the covariance of a body's change that its errors keep to.

    Wider than that of `_posterior`: how far bodies are off is known as little as how far this one is, and a body that
    seems right, because the likeliest deviations are small, would be sure of it by these.
    """
    unknowns = len(information)
    factor = _factor(unknowns, SIZE_SIGMA, _TRUSTED_PART_SIGMA, _TRUSTED_OFFSET_SIGMA_M)
    covariance: Array = factor @ np.linalg.solve(np.eye(unknowns) + factor.T @ information @ factor, factor.T)
    covariance[: len(PARTS), : len(PARTS)] += _COMMON_SIGMA**2
    return covariance


def _factor(unknowns: int, size: float, part: float, offset_m: float) -> Array:
    """Return the Cholesky factor of the covariance of usual deviations."""
    sizes = len(PARTS)
    factor: Array = np.diag(np.full(unknowns, offset_m))
    factor[:sizes, :sizes] = np.linalg.cholesky(np.full((sizes, sizes), size**2) + part**2 * np.eye(sizes))
    return factor
