"""Up axis of a take's world, found from the moving body."""

from dataclasses import dataclass

import numpy as np

from ..body.calibration_poses import standing
from ..body.standard_skeleton import default_skeleton
from ..errors import TakeError
from ..geometry.arrays import Array
from ..geometry.rigid_transform import mean_vertical
from ..markers.marker_set import FEWEST_TORSO, MarkerSet
from ..markers.marker_take import MarkerTake

TURNS = {  # rotation to a world with y up from one with this axis up
    "y": np.eye(3),
    "z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    "-y": np.diag([1.0, -1.0, -1.0]),
    "-z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "x": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "-x": np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
}


@dataclass(frozen=True)
class UpAxisSettings:
    """Weights of the evidence, chosen on CMU and Bandai takes and on bodies that crawl, sit, lie down and get up."""

    samples: int = 60  # largest number of frames that are checked
    fewest: int = 4  # fewest markers in a frame that show the posture of the whole body
    body: float = 0.7  # weight of the mean cosine between the axis and the up direction of a body fitted to all markers
    trunk: float = 0.3  # the same for the torso markers: the torso is upright in a seated body, too
    moves: float = 0.7  # weight per metre of the body's top moving further along the axis than its bottom
    most_moves_m: float = 0.5
    usual: float = 0.2  # evidence for y and z, the up axes of most programs
    outliers: float = 5.0  # percentage of extreme values that is ignored at either end


_S = UpAxisSettings()
_USUAL = ("y", "z")


def axis_up(take: MarkerTake, marker_set: MarkerSet) -> str:
    """Return the axis, one of `TURNS`, that points up in a take with the set's names.

    A body stands or sits upright for most of a take, with its head above its feet. When it lies down, crawls or turns
    over for a while, its head moves up and down, while its lowest point stays on the floor.

    Raises:
        TakeError: Too few markers are visible at once.
    """
    names = [name for name in marker_set.names if name in take.names]
    worn = marker_set.subset(names)
    rows = take.positions_m[:, [take.names.index(name) for name in worn.names]]
    seen = np.isfinite(rows[..., 0])
    whole = np.flatnonzero(seen.sum(axis=1) >= _S.fewest)
    if not seen.any():
        return "y"  # there is nothing to turn
    if not len(whole):
        raise TakeError(
            "too few markers are seen at once to find the vertical", where=take.name, advice="say which axis points up"
        )
    chosen = whole[np.unique(np.linspace(0, len(whole) - 1, _S.samples).astype(int))]
    rows = rows[chosen]
    template, torso = _usual_places(worn), worn.torso
    body = mean_vertical(template, rows, _S.fewest)
    trunk = mean_vertical(template[torso], rows[:, torso], FEWEST_TORSO)
    evidence = {}
    for name, (_, axis, _) in TURNS.items():
        posture = _S.body * float(body @ axis) + _S.trunk * float(trunk @ axis)
        evidence[name] = posture + _S.moves * _top_moves_m(rows @ axis) + _S.usual * (name in _USUAL)
    return max(evidence, key=lambda name: evidence[name])


def _usual_places(marker_set: MarkerSet) -> Array:
    """Return the markers (M, 3) on a standing body; markers without a usual offset are placed at their joints."""
    skeleton = default_skeleton()
    offsets = np.array([marker.offset_m or (0.0, 0.0, 0.0) for marker in marker_set.markers])
    return marker_set.with_offsets(offsets).positions_on(skeleton, standing(skeleton))


def _top_moves_m(heights: Array) -> float:
    """Return how much further up and down the body's top moves than its bottom, from marker heights (F, M)."""
    shares = (_S.outliers, 100.0 - _S.outliers)
    top, bottom = (np.ptp(np.percentile(ends, shares)) for ends in (np.nanmax(heights, 1), np.nanmin(heights, 1)))
    return float(np.clip(top - bottom, -_S.most_moves_m, _S.most_moves_m))
