"""Expected errors of the joints and parts of a body, and reasons for large ones."""

import numpy as np

from ..body.body_parts import PART_JOINTS, PARTS
from ..body.pose_notes import PoseNote
from ..body.scene_pose import PerformerPose
from ..body.standard_skeleton import JOINT_NAMES
from ..geometry.arrays import Array, Mask
from ..solver.solution import Solution
from ..solver.subject_model import SubjectModel

# Expected error of a joint, divided by its computed uncertainty: 95 % of the errors are within twice the expected ones.
# Those of clavicles and fingers, which hardly move in CMU's takes, are small: they say nothing about real fingers.
# Found on 120 frames from each of 17 takes of CMU (with databases without the performer, without the take, or with the
# built-in motion only) and eight takes of another studio, with exact, noisy, flickering and hidden markers.
_JOINT_SCALES = {
    "lowerback": 1.1, "upperback": 1.5, "thorax": 1.6, "lowerneck": 1.0, "upperneck": 1.2, "head": 1.2,
    "lclavicle": 0.6, "lhumerus": 1.4, "lradius": 0.8, "lwrist": 2.7, "lhand": 2.5, "lfingers": 0.3, "lthumb": 2.5,
    "lfemur": 1.5, "ltibia": 1.1, "lfoot": 1.6, "ltoes": 1.6,
}  # fmt: skip
# expected error of a part, relative to the mean of its joints', found on the same takes: joints rarely err together
_PART_SCALE = 0.84
_FROM = {0: "", 1: " from the camera", 2: " from both cameras"}
_FAR_M = 0.03  # distance between solved and located marker above which the marker does not fit


class PartErrors:
    """Expected errors of the parts and joints of one subject's body.

    Args:
        cameras: Number of cameras that may show the markers; 0 if unknown.
    """

    def __init__(self, subject: SubjectModel, cameras: int = 0) -> None:
        self._hidden = "hidden" + _FROM.get(cameras, " from all cameras")
        carried = subject.skeleton.is_ancestor[subject.joints] & ~subject.torso[:, None]
        self._markers: list[Mask] = [carried[:, joints].any(axis=1) for joints in PART_JOINTS.values()]
        # weights (P, J - 1) that average over the joints of each part
        self._means = np.zeros((len(PARTS), len(subject.skeleton) - 1))
        for row, joints in zip(self._means, PART_JOINTS.values(), strict=True):
            row[np.array(joints) - 1] = 1.0 / len(joints)
        self._scales = np.array([_JOINT_SCALES[_unsided(name)] for name in JOINT_NAMES[1:]])

    def expected_deg(self, joints_deg: Array) -> Array:
        """Return the expected errors (P,) of parts with these expected errors of joints, degrees."""
        return _PART_SCALE * self._means @ joints_deg if len(joints_deg) else joints_deg

    def expected_joints_deg(self, solution: Solution) -> Array:
        """Return the expected errors (J - 1,) of joints, degrees; empty for methods other than "best"."""
        if solution.uncertainty_rad is None:
            return np.empty(0)
        return np.asarray(self._scales * np.degrees(solution.uncertainty_rad))

    def notes(self, pose: PerformerPose) -> list[PoseNote]:
        """Return notes on the doubtful parts of a pose, each with the likely reason."""
        if pose.doubtful or not (parts := pose.doubtful_parts):
            return []
        fits = ~(np.linalg.norm(pose.markers_m - pose.observed_m, axis=1) > _FAR_M)
        notes = []
        for part, markers in zip(PARTS, self._markers, strict=True):
            if part not in parts:
                continue
            is_one = np.sum(markers) == 1
            if markers.any() and not (pose.seen & markers).any():
                reason = f"its marker is {self._hidden}" if is_one else f"its markers are {self._hidden}"
            elif not fits[markers].all():
                reason = "its marker does not fit" if is_one else "its markers do not fit"
            else:
                reason = "its motion is not in the database"
            notes.append(PoseNote.uncertain(part, reason))
        return notes


def _unsided(joint: str) -> str:
    """Return the name of a right joint's counterpart on the left; other names are returned unchanged."""
    return "l" + joint[1:] if joint[0] == "r" else joint
