"""Detection of left and right labels that are exchanged throughout a take, by the shape of the body.

A body whose left and right labels are exchanged looks like a mirror image. Groups of markers that are rigid enough
(trunk and head; hips and legs) are fitted to a standing body and to its mirror image, whichever way the performer faces
or walks. A mirrored recording cannot be told apart from exchanged labels.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.skeleton import Skeleton
from ..geometry.arrays import Array, IntArray
from ..geometry.rigid_transform import rigid_misfits_m2
from .exchanged_throughout import other_sides, places_standing
from .marker_set import Marker


@dataclass(frozen=True)
class SideSettings:
    """Settings of `exchanged_sides`.

    Chosen on the CMU subjects 05, 14, 127, 135 and eight marker sets: in takes without errors the evidence is at most
    -0.22.
    """

    samples: int = 600  # largest number of frames that are checked
    fewest: int = 4  # fewest markers in a group: three fit their mirror image just as well
    skin_m: float = 0.02  # tolerance for the distance of markers from their usual positions
    evidence: float = 0.3  # sum over groups of the mean log ratios of misfits above which sides are exchanged
    against: float = 0.1  # largest evidence that a single group may have against an exchange


_S = SideSettings()
_GROUPS = (
    ("root", "lowerback", "upperback", "thorax", "lowerneck", "upperneck", "head", "clavicle", "humerus"),
    ("root", "femur", "tibia", "foot", "toes"),
)


def exchanged_sides(points_m: Array, markers: Sequence[Marker], skeleton: Skeleton) -> list[tuple[int, int]]:
    """Return all pairs of left and right markers if their labels are exchanged in the whole take, else an empty list.

    Args:
        points_m: Trajectories (F, M, 3), NaN where hidden.
        markers: Markers of the trajectories.
        skeleton: The performer's skeleton.
    """
    places_m, partners = places_standing(markers, skeleton), _partners(markers)
    frames = np.unique(np.linspace(0, len(points_m) - 1, _S.samples).astype(int))
    evidence = []
    for names in _GROUPS:
        joints_of = {side + name for name in names for side in ("", "l", "r")}
        on_group = np.array([marker.joint in joints_of for marker in markers])
        group = np.flatnonzero(on_group & on_group[partners])
        if len(group) < _S.fewest:
            continue
        seen = points_m[frames][:, group]
        seen = seen[np.isfinite(seen[..., 0]).sum(axis=1) >= _S.fewest]
        if len(seen):
            own, mirrored = (
                rigid_misfits_m2(places_m[columns], seen) + _S.skin_m**2 for columns in (group, partners[group])
            )
            evidence.append(float(np.mean(0.5 * np.log(own / mirrored))))
    if sum(evidence) < _S.evidence or min(evidence) < -_S.against:
        return []
    return [(int(marker), int(other)) for marker, other in enumerate(partners) if marker < other]


def _partners(markers: Sequence[Marker]) -> IntArray:
    """Return the index (M,) of each marker's counterpart on the other side, or its own if there is none."""
    other, itself = other_sides(markers), np.arange(len(markers))
    return np.where((other >= 0) & (other[other] == itself), other, itself)
