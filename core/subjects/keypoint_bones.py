"""Bone lengths from the distances between keypoints at joints.

Poses are not used, because those solved with wrong bones absorb the errors of the bones. The distance between the ends
of a bone needs no pose; its median over the frames is used. Left and right bones are assumed to be equal.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..body.calibration_poses import standing
from ..body.skeleton import forward_kinematics
from ..geometry.arrays import Array
from ..markers.subject import Subject
from .body_change import PARTS, part_covariance, sized


@dataclass(frozen=True)
class KeypointBoneSettings:
    """Settings of `sized_by_distances`."""

    at_joint_m: float = 0.02  # largest usual offset of a keypoint that stands for its joint
    distance_sigma_m: float = 0.013  # mean length of both sides; keypoints are 1 to 3 cm off at each end
    trunk_sigma_m: float = 0.03  # the same for the trunk, which bends
    fewest_frames: int = 10


SETTINGS = KeypointBoneSettings()
# part of the body, and the joints at either end of its bone, or of the trunk's side
_SPANS = (
    ("thighs", "femur", "tibia"),
    ("shanks", "tibia", "foot"),
    ("arms", "humerus", "radius"),
    ("trunk", "femur", "humerus"),
)


def sized_by_distances(subject: Subject, points_m: Array) -> Subject:
    """Return the subject with the likeliest bones for the distances between its keypoints.

    Args:
        points_m: Keypoints (F, M, 3) of the subject's set, NaN where hidden.
    """
    skeleton, parts = subject.skeleton, list(PARTS)
    at_rest = forward_kinematics(skeleton, standing(skeleton), np.zeros(3))[0]
    information = np.linalg.inv(part_covariance(len(parts)))
    vector = np.zeros(len(parts))
    spans = [(part, (side + one, side + other)) for part, one, other in _SPANS for side in "lr"]
    for part, ends in [*spans, ("hips", ("lfemur", "rfemur"))]:
        columns = [_at_joint(subject, joint) for joint in ends]
        if None in columns:
            continue
        apart = np.linalg.norm(points_m[:, columns[0]] - points_m[:, columns[1]], axis=-1)
        apart = apart[np.isfinite(apart)]
        if len(apart) < SETTINGS.fewest_frames:
            continue
        usual_m = float(np.linalg.norm(np.subtract(*(at_rest[skeleton.index(joint)] for joint in ends))))
        sigma_m = SETTINGS.trunk_sigma_m if part == "trunk" else SETTINGS.distance_sigma_m
        sides = 1.0 if part == "hips" else 2.0
        weight = (usual_m / sigma_m) ** 2 / sides
        information[parts.index(part), parts.index(part)] += weight
        vector[parts.index(part)] += weight * (float(np.median(apart)) / usual_m - 1.0)
    return replace(subject, skeleton=sized(skeleton, np.linalg.solve(information, vector)))


def _at_joint(subject: Subject, joint: str) -> int | None:
    """Return the index of the keypoint that stands for a joint, or None."""
    marked = [
        (float(np.linalg.norm(marker.offset_m)), place)
        for place, marker in enumerate(subject.marker_set.markers)
        if marker.joint == joint and marker.offset_m is not None
    ]
    near_m, place = min(marked, default=(np.inf, None))
    return place if near_m < SETTINGS.at_joint_m else None
