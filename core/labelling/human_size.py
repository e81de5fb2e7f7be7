"""Size of the body in a take: its likely height, and a check to detect a wrong unit of length."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.body_size import HUMAN, stature_m
from ..body.calibration_poses import standing
from ..body.standard_skeleton import DEFAULT_HEIGHT_M, JOINT_NAMES, default_skeleton
from ..errors import TakeError
from ..geometry.arrays import Array, Mask
from ..markers.marker_set import Marker, MarkerSet
from ..markers.marker_take import MarkerTake


@dataclass(frozen=True)
class HumanSizeSettings:
    """Settings of the check and of the height."""

    fewest_pairs: int = 4  # fewest distances on limbs that determine the body's height
    # median deviation of the log ratios of distances to those of the default body above which the distances contradict
    # each other: at most 0.23 in takes from eight systems, 0.55 where a hand has the elbow's label
    contradiction: float = 0.35
    # the same from which a body network's points are not a person's: 0.04 of a man in four cameras
    shape: float = 0.2
    shortest_pair_m: float = 0.2  # distance on the default body below which a pair of markers is not used
    largest: float = 95.0  # percentile of a distance over time that represents its largest value
    # largest log ratio, positive or negative, of a standing performer's height to the default
    standing_range: float = 0.16
    samples: int = 200  # largest number of frames that are checked
    same_unit: float = 1.6  # largest ratio to the default size in the likely unit at which that unit is named


_S = HumanSizeSettings()
_FEET = ("foot", "toes")
# ratio to the default size -> unit of the numbers, unit that the file states
_MISTAKES = {
    1e-3: ("metres", "millimetres"),
    1e-2: ("metres", "centimetres"),
    1e-1: ("centimetres", "millimetres"),
    1e1: ("millimetres", "centimetres"),
    1e2: ("centimetres", "metres"),
    1e3: ("millimetres", "metres"),
    1.0 / 25.4: ("inches", "millimetres"),
    1.0 / 2.54: ("inches", "centimetres"),
    25.4: ("millimetres", "inches"),
}


def check_human_size(take: MarkerTake, marker_set: MarkerSet) -> None:
    """Raise TakeError for a take in which the body is not of human size.

    The torso hardly bends, so the distances between its markers determine the size. Takes with fewer than two torso
    markers pass.

    Args:
        take: Take with the marker names of the set.

    Raises:
        TakeError: The body is too small or too large for a person; the message states its size and the likely unit.
    """
    scale = _scale(take, marker_set)
    size_m = scale * stature_m(default_skeleton())
    if not np.isfinite(scale) or HUMAN.shortest_m <= size_m <= HUMAN.largest_m:
        return
    factor = min(_MISTAKES, key=lambda known: abs(np.log(scale / known)))
    told, advice = "", "check its unit of length"
    if abs(np.log(scale / factor)) < np.log(_S.same_unit):
        numbers, called = _MISTAKES[factor]
        told, advice = (
            f" (the numbers seem to be {numbers}, the file calls them {called})",
            f"give {numbers} as its unit",
        )
    raise TakeError(f"the body is {_length(size_m)} tall{told}", where=take.name, advice=advice)


def likely_height_m(take: MarkerTake, marker_set: MarkerSet) -> float:
    """Return the performer's height, estimated from distances between markers.

    Distances on the same or on neighbouring bones of the limbs hardly depend on the pose. If too few are known, or if
    they contradict each other because labels are wrong, the largest distances of the feet from torso and head are used
    instead; if the performer then seems to sit, the height is the default.

    Args:
        take: Take with the marker names of the set.
    """
    worn = _worn(take, marker_set)
    first, second = np.triu_indices(len(worn), 1)
    high = np.array([marker.torso or marker.joint == "head" for marker in worn], dtype=bool)
    low = np.array([marker.joint[1:] in _FEET for marker in worn], dtype=bool)
    apart_m, most_m, usual_m = _distances(take, marker_set, worn)
    known = (usual_m > _S.shortest_pair_m) & np.isfinite(apart_m)
    on_limbs = known & _on_near_bones(worn) & ~(high[first] & high[second])
    standing_up = known & ((high[first] & low[second]) | (low[first] & high[second]))
    logs = np.log(np.maximum(apart_m[on_limbs], 1e-9) / usual_m[on_limbs])
    if len(logs) >= _S.fewest_pairs and _spread(logs) < _S.contradiction:
        ratio = float(np.exp(np.median(logs)))
    else:
        ratio = float(np.median(most_m[standing_up] / usual_m[standing_up])) if standing_up.any() else 1.0
        ratio = ratio if abs(np.log(ratio)) < _S.standing_range else 1.0
    return float(np.clip(DEFAULT_HEIGHT_M * ratio, HUMAN.shortest_m, HUMAN.tallest_m))


def has_human_shape(take: MarkerTake, marker_set: MarkerSet) -> bool:
    """Return whether the distances between markers of one bone or two neighbouring ones are those of a person.

    Args:
        take: Take with the marker names of the set.
    """
    worn = _worn(take, marker_set)
    apart_m, _, usual_m = _distances(take, marker_set, worn)
    known = (usual_m > _S.shortest_pair_m) & np.isfinite(apart_m) & _on_near_bones(worn)
    logs = np.log(np.maximum(apart_m[known], 1e-9) / usual_m[known])
    return len(logs) < _S.fewest_pairs or _spread(logs) < _S.shape


def _on_near_bones(worn: Sequence[Marker]) -> Mask:
    """Return which pairs of markers are on the same or on neighbouring bones."""
    own = np.array([JOINT_NAMES.index(marker.joint) for marker in worn], dtype=np.int64)
    above = default_skeleton().parents[own]
    first, second = np.triu_indices(len(worn), 1)
    return np.asarray((own[first] == own[second]) | (above[first] == own[second]) | (own[first] == above[second]))


def _spread(logs: Array) -> float:
    """Return the median deviation of values."""
    return float(np.median(np.abs(logs - np.median(logs))))


def _scale(take: MarkerTake, marker_set: MarkerSet) -> float:
    """Return the size of the torso relative to the default body's, NaN if unknown."""
    apart_m, _, usual_m = _distances(take, marker_set, [marker for marker in _worn(take, marker_set) if marker.torso])
    known = np.isfinite(apart_m)
    return float(apart_m[known].sum() / usual_m[known].sum()) if known.any() else float("nan")


def _worn(take: MarkerTake, marker_set: MarkerSet) -> list[Marker]:
    """Return the markers of the set that are in the take and have an offset."""
    return [marker for marker in marker_set.markers if marker.offset_m is not None and marker.name in take.names]


def _distances(take: MarkerTake, marker_set: MarkerSet, worn: Sequence[Marker]) -> tuple[Array, Array, Array]:
    """Return each pair's median and largest distance, NaN if never visible together, and that on the default body."""
    skeleton, first, second = default_skeleton(), *np.triu_indices(len(worn), 1)
    found = np.full((2, len(first)), np.nan)
    if not len(first):
        return *found, found[0]
    usual = marker_set.subset([marker.name for marker in worn]).positions_on(skeleton, standing(skeleton))
    step = max(1, take.frames // _S.samples)
    places = take.positions_m[::step, [take.names.index(marker.name) for marker in worn]]
    apart = np.linalg.norm(places[:, first] - places[:, second], axis=-1)
    known = np.isfinite(apart).any(axis=0)
    found[:, known] = np.nanpercentile(apart[:, known], (50.0, _S.largest), axis=0)
    return *found, np.linalg.norm(usual[first] - usual[second], axis=-1)


def _length(metres: float) -> str:
    """Return a length as text in a suitable unit."""
    for unit, name in ((1e3, "km"), (1.0, "m"), (1e-2, "cm")):
        if metres >= unit:
            return f"{metres / unit:.2g} {name}"
    return f"{1e3 * metres:.2g} mm"
