"""Naming tracked trajectories by votes of frames that show a standing body."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..body.calibration_poses import standing, t_pose
from ..body.standard_skeleton import default_skeleton
from ..errors import TakeError, counted
from ..geometry.arrays import Array, IntArray
from ..geometry.gated_assignment import assign
from ..markers.marker_set import MarkerSet
from ..markers.marker_take import MarkerTake
from .template_labelling import label_by_template, similarity


@dataclass(frozen=True)
class NamingSettings:
    """Settings of `name_trajectories`."""

    samples: int = 25  # number of frames that vote
    fewest_votes: float = 0.3  # share of these frames in which most markers must have been recognised


_S = NamingSettings()


def name_trajectories(take: MarkerTake, marker_set: MarkerSet) -> MarkerTake:
    """Return the take with the order and the names of the marker set.

    In frames spread over the take, the points are labelled by a standing body and by one in the T pose, with the set's
    usual offsets; each frame votes for the names that it finds.

    Raises:
        TakeError: The number of markers differs from the set's, or the take does not look like the set.
        MarkerSetError: The set has no offsets to tell its markers apart.
    """
    count = len(marker_set)
    if len(take.names) != count:
        raise TakeError(
            f"has {counted(len(take.names), 'marker')}, but the marker set {marker_set.name} has {count}",
            where=take.name,
            advice="choose the marker set that was worn",
        )
    templates, chosen = _templates(marker_set), _samples(take)
    votes = np.zeros((count, count))
    for row in take.positions_m[chosen]:
        _vote(votes, row, templates)
    rows, columns = assign(-votes, np.inf)
    if np.median(votes[rows, columns]) < _S.fewest_votes * len(chosen):
        raise TakeError(
            f"the markers' positions do not fit the marker set {marker_set.name}",
            where=take.name,
            advice="track without a marker set, or correct the set's offset_m",
        )
    order = rows[np.argsort(columns)]
    single = take.single.select(markers=order.tolist()) if take.single is not None else None
    return replace(take, names=marker_set.names, positions_m=take.positions_m[:, order], single=single)


def misfit_of_names_m(take: MarkerTake, marker_set: MarkerSet) -> float:
    """Return the median over frames of the RMS distance between a take's markers and the set's on a body scaled to fit.

    The body stands or holds the T pose, whichever fits better.
    """
    misfits = []
    for row in take.positions_m[_samples(take)]:
        seen = np.isfinite(row[:, 0])
        if np.sum(seen) > 3:
            misfits.append(min(_misfit_m(template[seen], row[seen]) for template in _templates(marker_set)))
    return float(np.median(misfits)) if misfits else np.inf


def _misfit_m(template: Array, points: Array) -> float:
    away = points - similarity(template, points).apply(template)
    return float(np.sqrt(np.mean(np.sum(away**2, axis=1))))


def _templates(marker_set: MarkerSet) -> list[Array]:
    """Return the set's markers (M, 3) on a body in the T pose and on a standing one."""
    skeleton = default_skeleton()
    return [marker_set.positions_on(skeleton, pose(skeleton)) for pose in (t_pose, standing)]


def _samples(take: MarkerTake) -> IntArray:
    return np.unique(np.linspace(0, take.frames - 1, _S.samples).astype(np.int64))


def _vote(votes: Array, row: Array, templates: list[Array]) -> None:
    seen = np.flatnonzero(np.isfinite(row).all(axis=1))
    best = max(
        (label_by_template(row[seen], template) for template in templates), key=lambda labels: np.sum(labels >= 0)
    )
    known = best >= 0
    votes[seen[known], best[known]] += 1.0


def match_trajectories(own: Array, other: Array) -> tuple[IntArray, IntArray]:
    """Match trajectories (F, M, 3) to (F, N, 3) with the smallest sum of median distances."""
    costs = [[_median_distance(mine, theirs) for theirs in other.swapaxes(0, 1)] for mine in own.swapaxes(0, 1)]
    return assign(costs, np.inf)


def _median_distance(a: Array, b: Array) -> float:
    distance = np.linalg.norm(a - b, axis=1)
    seen = np.isfinite(distance)
    return float(np.median(distance[seen])) if seen.any() else 1e3  # far larger than any real distance


def compare_takes(take: MarkerTake, truth: MarkerTake) -> dict[str, Any]:
    """Return the distances to the true trajectories, paired so that they fit best over the whole take."""
    frames = min(take.frames, truth.frames)
    own, other = take.positions_m[:frames], truth.positions_m[:frames]
    # turn truth given in the left camera's frame (x right, y down, z forward) into world axes
    turned = other * np.array([1.0, -1.0, -1.0])
    if np.nanmedian(np.abs(own[..., 2] - turned[..., 2])) < np.nanmedian(np.abs(own[..., 2] - other[..., 2])):
        other = turned
    rows, columns = match_trajectories(own, other)
    distance = np.linalg.norm(own[:, rows] - other[:, columns], axis=2)
    return {
        "truth_frames": frames,
        "truth_pairs": {take.names[r]: truth.names[c] for r, c in zip(rows, columns, strict=True)},
        "distance_median_mm": 1000.0 * float(np.nanmedian(distance)),
        "distance_p95_mm": 1000.0 * float(np.nanpercentile(distance, 95)),
    }
