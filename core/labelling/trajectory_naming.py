"""Names of tracked trajectories, voted on by standing bodies over the take."""

from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..body.calibration_poses import standing, t_pose
from ..body.skeleton import marker_positions
from ..body.standard_skeleton import default_skeleton
from ..errors import TakeError
from ..geometry.arrays import Array, IntArray
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
    skeleton = default_skeleton()
    joints, offsets = marker_set.joint_indices(skeleton), marker_set.offsets_m
    templates = [
        marker_positions(skeleton, joints, offsets, pose(skeleton), np.zeros(3)) for pose in (t_pose, standing)
    ]
    votes = np.zeros((count, count))
    chosen = np.unique(np.linspace(0, take.frames - 1, _SAMPLES).astype(int))
    for row in take.positions_m[chosen]:
        _vote(votes, row, templates)
    rows, columns = linear_sum_assignment(-votes)
    if np.median(votes[rows, columns]) < _FEWEST_VOTES * len(chosen):
        raise TakeError(
            f"the markers are not where the marker set {marker_set.name} has them",
            where=take.name,
            advice="track without --marker-set, or correct the set's offset_m",
        )
    order = rows[np.argsort(columns)]
    single = take.single.select(markers=order.tolist()) if take.single is not None else None
    return replace(take, names=marker_set.names, positions_m=take.positions_m[:, order], single=single)


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
