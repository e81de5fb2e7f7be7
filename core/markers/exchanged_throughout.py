"""Detection of two labels on one limb that are exchanged throughout a take, by the distances to other markers.

No trajectory jumps in such a take. But the distances to other markers on the limb match neither the marker set's nor
those on the other limb, while with the two labels swapped they match both.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..body.calibration_poses import standing
from ..body.skeleton import Skeleton, marker_positions
from ..body.standard_skeleton import mirrored_name
from ..geometry.arrays import Array, IntArray, Mask
from .marker_set import Marker


@dataclass(frozen=True)
class ThroughoutSettings:
    """Settings of `exchanged_throughout`; chosen on marker sets of many vendors."""

    nearer_usual_m: float = 0.03  # smallest decrease of the summed difference from the usual distances by swapping
    nearer_other_m: float = 0.08  # the same for the distances on the other limb, where markers are worn symmetrically


_S = ThroughoutSettings()


def exchanged_throughout(
    points_m: Array, markers: Sequence[Marker], skeleton: Skeleton, neighbours: Mask
) -> list[tuple[int, int]]:
    """Return the pairs of markers that have each other's labels in all frames.

    Args:
        points_m: Trajectories (F, M, 3), NaN where hidden.
        markers: Markers (M) of the trajectories.
        neighbours: Mask (M, M) of pairs of markers on the same or on neighbouring bones.
    """
    apart_m = _usual_distances(points_m)
    places_m = places_standing(markers, skeleton)
    usual_m = np.linalg.norm(places_m[:, None] - places_m, axis=-1)
    other = other_sides(markers)
    sided = (other >= 0) & (other != np.arange(len(markers)))
    found: dict[tuple[int, int], float] = {}
    for a, b in combinations(np.flatnonzero(sided).tolist(), 2):
        if not neighbours[a, b] or other[a] == b:
            continue
        others = sided & ~np.isin(np.arange(len(markers)), (a, b, other[a], other[b]))
        gains = [
            _gain(apart_m, expected_m, a, b, neighbours[a] & others)
            + _gain(apart_m, expected_m, b, a, neighbours[b] & others)
            for expected_m in (usual_m, apart_m[np.ix_(other, other)])
        ]
        if gains[0] > _S.nearer_usual_m and gains[1] > _S.nearer_other_m:
            found[a, b] = sum(gains)
    pairs: list[tuple[int, int]] = []
    for pair in sorted(found, key=found.__getitem__, reverse=True):
        if not set(pair) & {marker for earlier in pairs for marker in earlier}:
            pairs.append(pair)
    return pairs


def _gain(apart_m: Array, expected_m: Array, marker: int, instead: int, near: Mask) -> float:
    """Return how much closer a marker's distances come to the expected ones with the trajectory of another marker."""
    expected = expected_m[marker, near]
    return float(np.nansum(np.abs(apart_m[marker, near] - expected) - np.abs(apart_m[instead, near] - expected)))


def _usual_distances(points_m: Array) -> Array:
    """Return the median distances (M, M) between trajectories; NaN for two that are never visible together."""
    count = points_m.shape[1]
    found = np.full((count, count), np.nan)
    for a, b in combinations(range(count), 2):
        apart = np.linalg.norm(points_m[:, a] - points_m[:, b], axis=-1)
        if np.isfinite(apart).any():
            found[a, b] = found[b, a] = np.nanmedian(apart)
    return found


def places_standing(markers: Sequence[Marker], skeleton: Skeleton) -> Array:
    """Return the positions (M, 3) of markers on a standing body."""
    joints = np.array([skeleton.index(marker.joint) for marker in markers])
    return marker_positions(skeleton, joints, _offsets_m(markers), standing(skeleton), np.zeros(3))


def _offsets_m(markers: Sequence[Marker]) -> Array:
    """Return the offsets (M, 3) of markers, zero where they are unknown."""
    return np.array([marker.offset_m or (0.0, 0.0, 0.0) for marker in markers])


def other_sides(markers: Sequence[Marker]) -> IntArray:
    """Return the index (M,) of the marker nearest to each marker's mirrored position; -1 if its joint carries none."""
    offsets_m = _offsets_m(markers)
    mirrored = offsets_m * [-1.0, 1.0, 1.0]
    found = []
    for marker, place in zip(markers, mirrored, strict=True):
        there = [i for i, each in enumerate(markers) if each.joint == mirrored_name(marker.joint)]
        found.append(min(there, key=lambda i: float(np.linalg.norm(offsets_m[i] - place)), default=-1))
    return np.array(found)
