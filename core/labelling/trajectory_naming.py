"""Names of tracked trajectories, voted on by standing bodies over the take."""

from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..body.calibration_poses import standing, t_pose
from ..body.skeleton import marker_positions
from ..body.standard_skeleton import default_skeleton
from ..errors import TakeError
from ..geometry.arrays import Array, IntArray
from ..geometry.rigid_transform import kabsch
from ..markers.marker_set import MarkerSet
from ..markers.marker_take import MarkerTake
from .template_labelling import label_by_template

_SAMPLES = 25
_FEWEST_VOTES = 0.3  # share of the sampled frames in which most markers must have been recognised


def name_trajectories(take: MarkerTake, marker_set: MarkerSet) -> MarkerTake:
    """Return the take in the order and under the names of the marker set.

    In frames spread over the take the points are placed over the markers of a standing body and of one in the T pose
    (with the set's usual offsets); every frame that fits votes.

    Raises:
        TakeError: the take has another number of markers than the set, or does not look like it.
        MarkerSetError: the set has no offsets to tell its markers apart.
    """
    count = len(marker_set)
    if len(take.names) != count:
        raise TakeError(f"has {len(take.names)} markers, the marker set {marker_set.name} has {count}", where=take.name)
    templates, chosen = _templates(marker_set), _samples(take)
    votes = np.zeros((count, count))
    for row in take.positions_m[chosen]:
        _vote(votes, row, templates)
    rows, columns = linear_sum_assignment(-votes)
    if np.median(votes[rows, columns]) < _FEWEST_VOTES * len(chosen):
        raise TakeError(
            f"the markers are not where the marker set {marker_set.name} has them",
            where=take.name,
            advice="track without a marker set, or correct the set's offset_m",
        )
    order = rows[np.argsort(columns)]
    single = take.single.select(markers=order.tolist()) if take.single is not None else None
    return replace(take, names=marker_set.names, positions_m=take.positions_m[:, order], single=single)


def misfit_of_names_m(take: MarkerTake, marker_set: MarkerSet) -> float:
    """Return the median distance of a take's markers from a standing body's.

    The body may be of any size: RMS distances in a frame are from the nearer of two poses, turned and scaled to fit.
    """
    misfits = []
    for row in take.positions_m[_samples(take)]:
        seen = np.isfinite(row[:, 0])
        if np.sum(seen) > 3:
            misfits.append(min(_misfit_m(template[seen], row[seen]) for template in _templates(marker_set)))
    return float(np.median(misfits)) if misfits else np.inf


def _misfit_m(template: Array, points: Array) -> float:
    turn, _ = kabsch(template, points)
    turned, centred = (template - template.mean(axis=0)) @ turn.T, points - points.mean(axis=0)
    scale = np.sum(turned * centred) / np.sum(turned * turned)
    return float(np.sqrt(np.mean(np.sum((centred - scale * turned) ** 2, axis=1))))


def _templates(marker_set: MarkerSet) -> list[Array]:
    """Return the set's markers (M, 3) on a body in the T pose and on one that stands."""
    skeleton = default_skeleton()
    joints, offsets = marker_set.joint_indices(skeleton), marker_set.offsets_m
    return [marker_positions(skeleton, joints, offsets, pose(skeleton), np.zeros(3)) for pose in (t_pose, standing)]


def _samples(take: MarkerTake) -> IntArray:
    return np.unique(np.linspace(0, take.frames - 1, _SAMPLES).astype(np.int64))


def _vote(votes: Array, row: Array, templates: list[Array]) -> None:
    seen = np.flatnonzero(np.isfinite(row).all(axis=1))
    best = np.full(len(seen), -1, dtype=np.int64)
    for template in templates:
        labels = label_by_template(row[seen], template)
        if np.sum(labels >= 0) > np.sum(best >= 0):
            best = labels
    known = best >= 0
    votes[seen[known], best[known]] += 1.0


def match_trajectories(own: Array, other: Array) -> tuple[IntArray, IntArray]:
    """Match trajectories (F, M, 3) to (F, N, 3): least sum of median distances."""
    cost = np.array(
        [[_median_distance(own[:, i], other[:, j]) for j in range(other.shape[1])] for i in range(own.shape[1])]
    )
    rows, columns = linear_sum_assignment(cost)
    return rows.astype(np.int64), columns.astype(np.int64)


def _median_distance(a: Array, b: Array) -> float:
    distance = np.linalg.norm(a - b, axis=1)
    seen = np.isfinite(distance)
    return float(np.median(distance[seen])) if seen.any() else 1e3
