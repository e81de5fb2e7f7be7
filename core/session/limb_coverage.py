"""Marker coverage of the body: how many markers each limb has, and which limbs no marker determines."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..body.body_parts import PART_JOINTS, PARTS
from ..body.motion import Motion
from ..body.scene_pose import DOUBTFUL_PART_DEG, PerformerPose
from ..body.skeleton import forward_kinematics
from ..body.standard_skeleton import JOINT_NAMES, SPINE_JOINTS
from ..geometry.arrays import Array, evenly
from ..markers.marker_set import MarkerSet

# A limb is determined by any marker beyond its hinge: one on the hand shows how the elbow bends, one on the foot how
# the knee does.
_LIMBS = {"arm": ("radius", "wrist", "hand", "fingers", "thumb"), "leg": ("tibia", "foot", "toes")}
LIMBS = {
    f"{side} {limb}": tuple(side[0] + joint for joint in joints)
    for side in ("left", "right")
    for limb, joints in _LIMBS.items()
}
_HELD = LIMBS | {"trunk": (*SPINE_JOINTS[1:], *(side + joint for side in "lr" for joint in ("clavicle", "humerus")))}


@dataclass(frozen=True)
class CoverageSettings:
    """Settings for the coverage."""

    samples: int = 50  # number of frames that are checked for unused markers
    farthest_m: float = 0.5  # largest distance from the body at which an unused marker may belong to it
    open_error: float = 1.1  # least expected error of an open limb, relative to that of a doubtful one


_S = CoverageSettings()


@dataclass(frozen=True)
class LimbCoverage:
    """Markers of one part of the body.

    Args:
        limb: One of `body_parts.PARTS`.
        markers: Number of its markers that were used and located at least once.
        known: Number of these whose position the marker set gives.
        placed: Number of these that were placed from the motion.
        left_out: Number of markers of the take near this part that were not used.
        distance_m: Median distance between located and solved markers, NaN if there are none.
        distance_95_m: 95th percentile of these distances.
    """

    limb: str
    markers: int
    known: int
    placed: int
    left_out: int
    distance_m: float
    distance_95_m: float

    def facts(self) -> dict[str, Any]:
        """Return the row for the `solve` command's JSON object."""
        return {
            "limb": self.limb,
            "markers": self.markers,
            "known": self.known,
            "placed": self.placed,
            "left_out": self.left_out,
            "distance_mm": 1e3 * self.distance_m,
            "distance_95_mm": 1e3 * self.distance_95_m,
        }


def parts_of(marker_set: MarkerSet) -> dict[str, list[int]]:
    """Return the indices of the markers on each part of the body that carries any; the hips belong to the torso."""
    joints = [JOINT_NAMES.index(marker.joint) for marker in marker_set.markers]
    joints = [PART_JOINTS["torso"][0] if joint == 0 else joint for joint in joints]
    parts = {part: [i for i, joint in enumerate(joints) if joint in own] for part, own in PART_JOINTS.items()}
    return {part: markers for part, markers in parts.items() if markers}


def limb_coverage(marker_set: MarkerSet, distances_m: Array) -> tuple[LimbCoverage, ...]:
    """Return the coverage of the parts that carry markers.

    Args:
        distances_m: Distances (F, M) between located and solved markers, NaN where one was not located.
    """
    found = []
    for part, carried in parts_of(marker_set).items():
        members = [i for i in carried if np.isfinite(distances_m[:, i]).any()]
        own = distances_m[:, members]
        seen = own[np.isfinite(own)]
        if len(seen):
            placed = sum(marker_set.markers[i].placed for i in members)
            median_m, most_m = np.percentile(seen, (50.0, 95.0)).tolist()
            found.append(LimbCoverage(part, len(members), len(members) - placed, placed, 0, median_m, most_m))
    return tuple(found)


def with_left_out(limbs: Sequence[LimbCoverage], left_out: Mapping[str, int]) -> tuple[LimbCoverage, ...]:
    """Return the coverage completed with the numbers of unused markers near each part."""
    by_part = {limb.limb: limb for limb in limbs}
    nothing = LimbCoverage("", 0, 0, 0, 0, np.nan, np.nan)
    return tuple(
        replace(by_part.get(part, nothing), limb=part, left_out=left_out.get(part, 0))
        for part in PART_JOINTS
        if part in by_part or left_out.get(part)
    )


def near_limbs(motion: Motion, points_m: Array) -> dict[str, int]:
    """Return how many of the markers (F, N, 3) are nearest to each part of a moving body; distant ones do not count."""
    shown = evenly(motion.frames, _S.samples)
    if len(points_m) != motion.frames or points_m.shape[1] == 0:
        return {}
    places = forward_kinematics(motion.skeleton, motion.rotations[shown], motion.root_positions_m[shown])[0]
    apart_m = np.linalg.norm(points_m[shown, :, None] - places[:, None], axis=-1)
    seen = np.isfinite(apart_m[..., 0]).any(axis=0)
    apart_m = np.nanmedian(apart_m[:, seen], axis=0)
    part_of = {joint: part for part, joints in PART_JOINTS.items() for joint in joints} | {0: "torso"}
    nearest = apart_m.argmin(axis=1)
    return Counter(part_of[int(j)] for j, row in zip(nearest, apart_m, strict=True) if row[j] < _S.farthest_m)


def coverage_text(marker_set: MarkerSet, shown: Sequence[str], lacking: Sequence[str]) -> str:
    """Return a sentence on how many of a take's markers were used, and on the limbs that none of them determines."""
    used = [marker for marker in marker_set.markers if marker.name in shown]
    placed = sum(marker.placed for marker in used)
    counts = [(placed, "placed from the motion"), (len(shown) - len(used), "left out")]
    text = f"{len(used) - placed} of {len(shown)} markers known"
    text += "".join(f", {count} {what}" for count, what in counts if count)
    return text + (f"; no marker determines the {', the '.join(lacking)}" if lacking else "")


def open_limbs(marker_set: MarkerSet, names: Sequence[str]) -> list[str]:
    """Return the limbs, and the trunk, that the complete set determines but its markers `names` do not."""
    carried = {marker.joint for marker in marker_set.markers}
    shown = {marker.joint for marker in marker_set.markers if marker.name in names}
    return [limb for limb, joints in _HELD.items() if carried & set(joints) and not shown & set(joints)]


def doubted(pose: PerformerPose, limbs: Sequence[str]) -> PerformerPose:
    """Return a pose in which open limbs are doubtful; if no errors are known, only its confidence is lower."""
    if not len(pose.part_errors_deg):
        return replace(pose, confidence=pose.confidence * max(0.0, 1.0 - len(limbs) / len(LIMBS)))
    joints = {joint for limb in limbs for joint in _HELD[limb]}
    is_open = [not joints.isdisjoint(part) for part in PARTS.values()]
    least_deg = np.where(is_open, _S.open_error * DOUBTFUL_PART_DEG, 0.0)
    return pose.with_part_errors(np.maximum(pose.part_errors_deg, least_deg))
