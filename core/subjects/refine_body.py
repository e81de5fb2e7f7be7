"""Correction of a calibrated performer's bones and marker offsets from a take's motion.

Poses that were solved with wrong bones have absorbed the error and say little about it. Instead, single frames are
solved without history: the database's examples predict a pose with its covariance, and the deviations of the markers
from that prediction (the innovation) reveal the body. The model is Gaussian and linear about the current body. The
prior variances of the corrections are learned from the take (empirical Bayes), so that a correct body is left as it is.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..database.store import Database
from ..errors import SubjectError
from ..geometry.arrays import Array, evenly
from ..markers.marker_set import FEWEST_TORSO
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from ..solver.observation import Observation
from ..solver.pose_solver import PoseSolver
from ..solver.settings import BestSettings, SolveSettings
from ..solver.subject_model import SubjectModel
from ..system.progress import Progress, no_progress
from .body_change import PARTS, SIGMAS, linear_model, observed_positions, part_lengths_m, sized

_WITHOUT_HISTORY = SolveSettings(best=BestSettings(prior_share=0.0))  # the learned prior needs half a second of history


@dataclass(frozen=True)
class RefineSettings:
    """Settings of the refinement."""

    rounds: int = 4
    interval_s: float = 0.25  # time between the frames used
    most_frames: int = 240  # largest number of frames used, one minute of a take; spread over a longer one
    fewest_frames: int = 3
    farthest_m: float = 0.12  # distance from the closest example beyond which a frame's motion is not in the database
    root_sigma: tuple[float, float] = (0.5, 0.3)  # m, rad; large: examples do not tell where the body is
    marker_sigma_m: float = 0.01
    nearest_share: float = 0.3  # error of the predicted markers as a fraction of the distance to the closest example
    frames_per_s: float = 1.2  # number of frames with independent errors; nearby frames repeat each other's
    # candidates for the standard deviations of part sizes and of offsets, relative to those of `ChangeSigmas`
    part_scales: tuple[float, ...] = (0.05, 0.2, 0.35, 0.5, 0.75, 1.0)
    offset_scales: tuple[float, ...] = (0.05, 0.2, 0.35, 0.5)
    # prior standard deviations with which 95 % of the errors are within twice the reported standard deviations: chosen
    # with correct and wrong bodies on five takes, confirmed on five others
    trusted_part_sigma: float = 0.08
    trusted_offset_sigma_m: float = 0.015
    common_sigma: float = 0.02  # error common to all bones: any take makes them too short by about this much


SETTINGS = RefineSettings()


@dataclass(frozen=True)
class Refinement:
    """A corrected body.

    Args:
        subject: Subject with corrected bones and offsets.
        whole: Relative change of the total length of all bones, which is known better than that of a part.
        whole_sigma: Standard deviation of `whole`.
        sizes: Relative change of the length of each part's bones, by part.
        size_sigmas: Standard deviations of `sizes`, by part.
        offset_sigmas_m: Standard deviation of each marker's offset along its most uncertain axis, by marker.
        frames: Number of frames used.
        evidence: Log likelihood ratio of the corrected body to the given one.
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
    """Normal equations for part sizes and offsets: matrix (N, N), vector (N,), and the number of frames used."""

    information: Array
    vector: Array
    frames: int


def refine_body(take: MarkerTake, start: Subject, database: Database, progress: Progress = no_progress) -> Refinement:
    """Correct a subject's bones and offsets with a take's motion.

    Args:
        take: Labelled take of motion similar to the database's.
        start: Calibrated body.
        database: Database with motion like the take's.

    Raises:
        SubjectError: Too few frames are similar to the database's motion.
        TakeError: The take lacks torso markers.
    """
    step = max(round(SETTINGS.interval_s * take.fps), 1)
    observed = observed_positions(take, start.marker_set)
    observed = observed[np.isfinite(observed[:, start.marker_set.torso, 0]).sum(axis=1) >= FEWEST_TORSO]
    seconds = min(len(observed) / take.fps, SETTINGS.interval_s * SETTINGS.most_frames)
    observed = observed[::step]
    observed = observed[evenly(len(observed), SETTINGS.most_frames)]
    change = np.zeros(len(PARTS) + 3 * len(start.marker_set))
    subject = start
    for round_ in range(SETTINGS.rounds):

        def report(share: float, round_: int = round_) -> None:
            progress((round_ + share) / SETTINGS.rounds, "correcting the body")

        found = _evidence(observed, subject, database, report)
        if found.frames < SETTINGS.fewest_frames:
            raise SubjectError(
                f"only {found.frames} of {len(observed)} frames are near motion of the database",
                where=take.name,
                advice="choose a database with such motion, or leave the subject as it is",
            )
        # the evidence is about changes relative to the current body; convert it to changes relative to the initial one
        slope = np.append(1.0 / (1.0 + change[: len(PARTS)]), np.ones(len(change) - len(PARTS)))
        weight = SETTINGS.frames_per_s * seconds / len(observed)
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


def _evidence(observed: Array, subject: Subject, database: Database, report: Callable[[float], None]) -> _Evidence:
    """Return the evidence of markers (F, M, 3) about the subject's body; `report` receives the fraction done."""
    solver = PoseSolver(SubjectModel(subject, database.mean_rotations), database, _WITHOUT_HISTORY)
    model = solver.subject
    unknowns = len(PARTS) + 3 * len(subject.marker_set)
    information, vector, frames = np.zeros((unknowns, unknowns)), np.zeros(unknowns), 0
    root_variances = np.square(np.repeat(SETTINGS.root_sigma, 3))
    for index, points_m in enumerate(observed):
        report(index / len(observed))
        observation = Observation.of_points(points_m)
        solution, state = solver.step(solver.initial_state, observation, 0.0, limit_m=SETTINGS.farthest_m)
        if solution is None or state.expectation is None or solution.nearest_m > SETTINGS.farthest_m:
            continue
        expectation = state.expectation
        pose = expectation.prior.mean.reshape(-1, 3)
        seen = np.isfinite(points_m[:, 0])
        markers, jacobian = model.markers_and_jacobian(pose, expectation.root)
        by_root, by_pose = np.split(jacobian[seen].reshape(-1, jacobian.shape[-1]), [6], axis=1)
        spread = by_pose @ expectation.prior.covariance @ by_pose.T + (by_root * root_variances) @ by_root.T
        nearest_m = SETTINGS.nearest_share * solution.nearest_m
        spread[np.diag_indices_from(spread)] += SETTINGS.marker_sigma_m**2 + nearest_m**2
        by_part, by_offset, _ = linear_model(model.rotations(pose, expectation.root)[None], subject)
        columns = np.concatenate((by_part, by_offset), axis=-1)[0][seen].reshape(-1, unknowns)
        innovation = (points_m - markers)[seen].reshape(-1, 1)
        whitened = np.linalg.solve(np.linalg.cholesky(spread), np.hstack((columns, innovation)))
        information += whitened[:, :-1].T @ whitened[:, :-1]
        vector += whitened[:, :-1].T @ whitened[:, -1]
        frames += 1
    return _Evidence(information, vector, frames)


def _posterior(information: Array, vector: Array) -> tuple[Array, float]:
    """Return the covariance of a body's change under the likeliest prior, and the evidence for that prior.

    Priors are compared by the likelihood of the take, integrated over all bodies (type II maximum likelihood; MacKay
    1992, "Bayesian interpolation"). The evidence is the log likelihood ratio to the prior with the smallest variances.
    """
    best: Array = np.zeros_like(information)
    most, least = -np.inf, 0.0
    for part_scale in SETTINGS.part_scales:
        for offset_scale in SETTINGS.offset_scales:
            factor = _factor(
                len(vector), part_scale * SIGMAS.size, part_scale * SIGMAS.part, offset_scale * SIGMAS.offset_m
            )
            # scaled by the prior standard deviations, so that the matrix stays well conditioned even where they are
            # small
            inner = np.eye(len(vector)) + factor.T @ information @ factor
            explained = np.linalg.solve(inner, factor.T @ vector)
            evidence = 0.5 * (vector @ factor @ explained - np.linalg.slogdet(inner)[1])
            if (part_scale, offset_scale) == (SETTINGS.part_scales[0], SETTINGS.offset_scales[0]):
                least = evidence
            if evidence > most:
                best, most = factor @ np.linalg.solve(inner, factor.T), evidence
    return best, float(most - least)


def _trusted_covariance(information: Array) -> Array:
    """Return a covariance of a body's change that states the actual errors.

    It is wider than that of `_posterior`, because the likeliest prior is itself uncertain: one with small standard
    deviations would make a body that seems correct look certain.
    """
    unknowns = len(information)
    factor = _factor(unknowns, SIGMAS.size, SETTINGS.trusted_part_sigma, SETTINGS.trusted_offset_sigma_m)
    covariance: Array = factor @ np.linalg.solve(np.eye(unknowns) + factor.T @ information @ factor, factor.T)
    covariance[: len(PARTS), : len(PARTS)] += SETTINGS.common_sigma**2
    return covariance


def _factor(unknowns: int, size: float, part: float, offset_m: float) -> Array:
    """Return the Cholesky factor (N, N) of the prior covariance for given standard deviations."""
    sizes = len(PARTS)
    factor: Array = np.diag(np.full(unknowns, offset_m))
    factor[:sizes, :sizes] = np.linalg.cholesky(np.full((sizes, sizes), size**2) + part**2 * np.eye(sizes))
    return factor
