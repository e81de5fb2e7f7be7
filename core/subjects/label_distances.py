"""Check of labels by the distances between markers: how long these are, and how much they vary.

Distances cannot tell left from right, because a body and its mirror image have the same distances.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..body.standard_skeleton import default_skeleton
from ..database.store import Database
from ..geometry.arrays import Array, evenly, mean_of_known
from ..markers.label_matching import match_labels
from ..markers.marker_set import MarkerSet, PointKind
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from ..solver.subject_model import SubjectModel


@dataclass(frozen=True)
class DistanceSettings:
    """Settings of the check, chosen on simulated and recorded takes; costs are in nats per distance."""

    frames: int = 200  # largest number of the take's frames, and of the database's poses, that are measured
    fewest_frames: int = 5  # fewest frames in which a distance must be visible
    fewest: int = 8  # fewest markers for which the check is made
    placed_m: float = 0.03  # standard deviation of a marker's position from its usual one
    spread_m: float = 0.01  # spread of a distance due to skin and noise alone
    spread_log: float = 0.5  # prior standard deviation of the log ratio of a distance's spread to the database's
    capped: float = 8.0  # largest cost of one distance
    contradicted: float = 2.4  # mean cost of a distance above which the labels are wrong


_S = DistanceSettings()


class Distances(NamedTuple):
    """Distances between all pairs of markers over time: means and standard deviations (M, M), NaN if unknown."""

    mean_m: Array
    spread_m: Array


def distances_of(points_m: Array) -> Distances:
    """Return the distances between trajectories (F, M, 3)."""
    points_m = points_m[evenly(len(points_m), _S.frames)]
    count = points_m.shape[1]
    mean_m, spread_m = np.full((count, count), np.nan), np.full((count, count), np.nan)
    for marker in range(count):
        apart_m = np.linalg.norm(points_m - points_m[:, marker : marker + 1], axis=-1)
        shown = np.isfinite(apart_m).sum(axis=0) >= min(_S.fewest_frames, len(points_m))
        mean_m[marker, shown] = np.nanmean(apart_m[:, shown], axis=0)
        spread_m[marker, shown] = np.nanstd(apart_m[:, shown], axis=0)
    return Distances(mean_m, spread_m)


def usual_distances(marker_set: MarkerSet, database: Database) -> Distances:
    """Return the distances between a set's markers on the default skeleton in the poses of a database."""
    skeleton = default_skeleton()
    model = SubjectModel(Subject("", skeleton, marker_set), database.reference_pose_of(skeleton, ""))
    return distances_of(model.database_markers(database, evenly(database.frames, _S.frames)).astype(np.float64))


def contradiction(take: MarkerTake, marker_set: MarkerSet, database: Database) -> float:
    """Return how far the distances between a take's markers contradict their labels; above 1 they are wrong.

    Args:
        take: Take in any axes and unit.
        marker_set: Marker set whose names the labels match.
    """
    label_of = match_labels(take.names, marker_set).label_of
    if len(label_of) < _S.fewest or marker_set.points is PointKind.KEYPOINTS:  # keypoint errors change distances
        return 0.0
    worn = marker_set.subset(list(label_of))
    own = distances_of(take.positions_m[:, [take.names.index(label_of[name]) for name in worn.names]])
    costs = _label_costs(own, usual_distances(worn, database))
    return float(np.nanmean(costs)) / _S.contradicted if np.isfinite(costs).any() else 0.0


def _label_costs(own: Distances, usual: Distances) -> Array:
    """Return the mean cost (M,) of each marker's distances."""
    ratios = own.mean_m / np.maximum(usual.mean_m, 1e-9)
    ratios = ratios[np.isfinite(ratios) & ~np.eye(len(ratios), dtype=bool)]
    # the scale is the body's size, or a different unit of length
    scale = float(np.median(ratios)) if np.any(ratios > 0.0) else 1.0
    mean_m, spread_m = own.mean_m / scale, own.spread_m / scale
    variance = usual.spread_m**2 + 2.0 * _S.placed_m**2
    looser = np.maximum(np.log((spread_m + _S.spread_m) / (usual.spread_m + _S.spread_m)), 0.0) / _S.spread_log
    costs = np.minimum(0.5 * ((mean_m - usual.mean_m) ** 2 / variance + looser**2), _S.capped)
    costs += 0.5 * np.log(variance / (2.0 * _S.placed_m**2))  # else a varying pair would explain any distance
    np.fill_diagonal(costs, np.nan)
    return mean_of_known(costs)
