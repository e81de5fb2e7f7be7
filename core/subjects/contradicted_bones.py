"""Whether the markers of a solved take contradict the bones of a skeleton that was given."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.scene_pose import PerformerPose
from ..geometry.arrays import evenly
from ..markers.marker_set import PointKind
from ..markers.source_noise import noise_of
from ..markers.subject import Subject
from .body_change import PARTS, part_lengths_m
from .from_motion import body_of_poses
from .refinement_text import PART_WORDS


@dataclass(frozen=True)
class ContradictionSettings:
    """Settings of the check."""

    frames: int = 60  # number of frames, spread over the take
    share: float = 0.1  # relative change of a part's bones; right skeletons with usual marker places show up to 0.055


_S = ContradictionSettings()


def contradicted_bones(poses: Sequence[PerformerPose], subject: Subject) -> str:
    """Return in words how the bones of a take's body contradict those of its subject, or "" if they do not.

    Poses that were solved with wrong bones have absorbed part of the error, so the true difference is larger.

    Args:
        poses: Solved poses, with the markers that were used.
        subject: Performer with these markers.
    """
    used = [poses[i] for i in evenly(len(poses), _S.frames) if np.isfinite(poses[i].observed_m).any()]
    if not used or subject.marker_set.points is PointKind.KEYPOINTS:  # keypoints are centimetres away from joints
        return ""
    rotations = np.array([pose.rotations for pose in used])
    observed_m = np.array([pose.observed_m for pose in used])
    fitted = body_of_poses(rotations, observed_m, subject, noise_of(subject.marker_set.points))
    before_m, after_m = part_lengths_m(subject.skeleton), part_lengths_m(fitted.skeleton)
    shares = (after_m - before_m) / np.maximum(before_m, 1e-9)  # hips may have no length
    most = int(np.argmax(np.abs(shares)))
    if abs(shares[most]) <= _S.share:
        return ""
    name, more, less = PART_WORDS[tuple(PARTS)[most]]
    change = f"{name} at least {100.0 * abs(shares[most]):.0f} % {more if shares[most] > 0.0 else less}"
    return f"the skeleton contradicts the markers: {change} in the take"
