"""Check of the body's size in a take, to detect a wrong unit of length."""

from dataclasses import dataclass

import numpy as np

from ..body.body_size import HUMAN, stature_m
from ..body.calibration_poses import standing
from ..body.standard_skeleton import default_skeleton
from ..errors import TakeError
from ..geometry.arrays import Array
from ..markers.marker_set import MarkerSet
from ..markers.marker_take import MarkerTake


@dataclass(frozen=True)
class HumanSizeSettings:
    """Settings of the check."""

    samples: int = 200  # largest number of frames that are checked
    same_unit: float = 1.6  # largest ratio to the default size after a change of unit for which the unit is blamed


_S = HumanSizeSettings()
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
    """Raise TakeError for a take in which the body does not have a human size.

    The torso hardly bends, so the distances between its markers give the size. Takes with fewer than two of them pass.

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


def _scale(take: MarkerTake, marker_set: MarkerSet) -> float:
    """Return the size of the torso relative to the default body, NaN if unknown."""
    worn = [
        marker
        for marker in marker_set.markers
        if marker.torso and marker.offset_m is not None and marker.name in take.names
    ]
    if len(worn) < 2:
        return float("nan")
    skeleton = default_skeleton()
    usual = marker_set.subset([marker.name for marker in worn]).positions_on(skeleton, standing(skeleton))
    step = max(1, take.frames // _S.samples)
    places = take.positions_m[::step, [take.names.index(marker.name) for marker in worn]]
    first, second = np.triu_indices(len(worn), 1)
    apart = np.linalg.norm(places[:, first] - places[:, second], axis=-1)
    known = np.isfinite(apart).any(axis=0)
    if not known.any():
        return float("nan")
    expected: Array = np.linalg.norm(usual[first] - usual[second], axis=-1)
    return float(np.nanmedian(apart[:, known], axis=0).sum() / expected[known].sum())


def _length(metres: float) -> str:
    """Return a length as text in a suitable unit."""
    for unit, name in ((1e3, "km"), (1.0, "m"), (1e-2, "cm")):
        if metres >= unit:
            return f"{metres / unit:.2g} {name}"
    return f"{1e3 * metres:.2g} mm"
