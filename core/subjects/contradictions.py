"""Contradictions between the markers of a solved take and the bones of a skeleton or the offsets of a marker set."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..body.scene_pose import PerformerPose
from ..geometry.arrays import evenly
from ..markers.marker_set import MarkerSet, PointKind
from ..markers.source_noise import noise_of
from ..markers.subject import Subject
from .body_change import PARTS, SIGMAS, part_lengths_m
from .from_motion import body_of_poses, well_solved
from .pose_calibration import LIMITS
from .refinement_text import PART_WORDS


@dataclass(frozen=True)
class ContradictionSettings:
    """Settings of the check."""

    frames: int = 60  # number of frames, spread over the take
    share: float = 0.1  # change of a part's length above which the bones are wrong; correct skeletons reach 0.055
    sigmas: float = 3.0  # change, in standard deviations among people, above which labels are wrong instead
    moved_m: float = 0.13  # distance from the usual position above which a label is wrong; worn markers reach 0.126


_S = ContradictionSettings()
_LONG = ("thighs", "shanks", "arms")  # parts whose lengths even a few markers determine


def contradicted_bones(poses: Sequence[PerformerPose], subject: Subject) -> str:
    """Return in words how the bone lengths fitted to a take contradict the subject's, or "" if they do not.

    Poses solved with wrong bones have absorbed part of the error, so the true difference is larger than the one stated.

    Args:
        poses: Solved poses, with the markers that were used.
        subject: Performer with these markers.
    """
    used = [poses[i] for i in np.flatnonzero(well_solved(poses, subject))]
    used = [used[i] for i in evenly(len(used), _S.frames)]
    if not used or subject.marker_set.points is PointKind.KEYPOINTS:  # keypoints are centimetres away from joints
        return ""
    rotations = np.array([pose.rotations for pose in used])
    observed_m = np.array([pose.observed_m for pose in used])
    fitted = body_of_poses(rotations, observed_m, subject, noise_of(subject.marker_set.points))
    before_m, after_m = part_lengths_m(subject.skeleton), part_lengths_m(fitted.skeleton)
    shares = (after_m - before_m) / np.maximum(before_m, 1e-9)
    shares[[part not in _LONG for part in PARTS]] = 0.0
    most = int(np.argmax(np.abs(shares)))
    if not _S.share < abs(shares[most]) < _S.sigmas * np.hypot(SIGMAS.size, SIGMAS.part):
        return ""
    name, more, less = PART_WORDS[tuple(PARTS)[most]]
    change = f"{name} at least {100.0 * abs(shares[most]):.0f} % {more if shares[most] > 0.0 else less}"
    return f"the skeleton contradicts the markers: {change} in the take"


def moved_markers(subject: Subject, usual: MarkerSet) -> dict[str, float]:
    """Return the distances (m) of markers from their usual positions, the farthest first; small ones are left out.

    A marker may be worn anywhere along a thigh, for instance, so the distance along the bone does not count.
    """
    skeleton, places = subject.skeleton, {marker.name: marker for marker in usual.markers}
    moved = {}
    for marker in subject.marker_set.markers:
        at = places.get(marker.name)
        if marker.placed or at is None or at.joint != marker.joint or at.offset_m is None or marker.offset_m is None:
            continue
        tip_m = skeleton.tips_m[skeleton.index(marker.joint)]
        length_m = float(np.linalg.norm(tip_m))
        way = tip_m / max(length_m, 1e-9)
        change_m = np.subtract(marker.offset_m, at.offset_m)
        along_m, usual_m = float(way @ np.asarray(marker.offset_m)), float(way @ np.asarray(at.offset_m))
        beyond_m = along_m - np.clip(along_m, min(0.0, usual_m), max(length_m, usual_m))
        moved[marker.name] = float(np.linalg.norm(change_m - (along_m - usual_m - beyond_m) * way))
    return {name: m for name, m in sorted(moved.items(), key=lambda row: -row[1]) if m >= LIMITS.odd_marker_m}


def contradicted_places(moved_m: Mapping[str, float]) -> str:
    """Return in words which of the `moved_markers` are too far away to be labelled correctly, or ""."""
    far = [f"{name} is {1e3 * m:.0f} mm" for name, m in moved_m.items() if m > _S.moved_m]
    labels = "the label" if len(far) == 1 else "these labels"
    return f"{', '.join(far)} away from the usual position on the body: check {labels}" if far else ""
