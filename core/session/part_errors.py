"""Expected errors of the joints and parts of a body, and reasons for large ones."""

import numpy as np

from ..body.body_parts import PART_JOINTS, PARTS
from ..body.pose_notes import PoseNote
from ..body.scene_pose import PerformerPose, doubtful_parts
from ..body.standard_skeleton import JOINT_NAMES
from ..geometry.arrays import Array, Mask
from ..solver.solution import Solution
from ..solver.subject_model import SubjectModel

# Expected errors of parts whose computed standard deviation is 1 degree, 1 m from the closest example; 95 % of the
# errors are within twice these. Scales and powers were fitted to 64 CMU takes that were not in the database, with and
# without other takes of their performers.
_ERRORS_DEG = {"torso": 6.2, "head": 7.7, "arm": 6.7, "hand": 13.0, "leg": 9.1, "foot": 12.4}
_SIGMA_POWER, _NEAREST_POWER, _NEAREST_M = 0.8, 0.3, 0.01
# The same for joints of either side, fitted to 80 frames from each of 28 CMU takes (solved with databases without the
# take, its performer or its behaviour, or with the built-in motion only) and from ten takes of another studio; half of
# the takes had 3 mm of noise and a tenth of their markers hidden. CMU's clavicles and fingers do not move, so they have
# their parts' values.
_JOINT_ERRORS_DEG = {
    "lowerback": 6.7, "upperback": 5.7, "thorax": 7.1, "lowerneck": 9.6, "upperneck": 9.1, "head": 6.8,
    "lclavicle": 6.7, "lhumerus": 11.6, "lradius": 7.8, "lwrist": 11.8, "lhand": 18.2, "lfingers": 13.0, "lthumb": 22.7,
    "lfemur": 9.8, "ltibia": 10.0, "lfoot": 10.9, "ltoes": 14.8,
}  # fmt: skip
_FAR_M = 0.03  # distance between solved and located marker above which the marker does not fit


class PartErrors:
    """Expected errors of the parts and joints of one subject's body."""

    def __init__(self, subject: SubjectModel) -> None:
        carried = subject.skeleton.is_ancestor[subject.joints] & ~subject.torso[:, None]
        self._markers: list[Mask] = [carried[:, joints].any(axis=1) for joints in PART_JOINTS.values()]
        # weights (P, J - 1) that average over the joints of each part
        self._means = np.zeros((len(PARTS), len(subject.skeleton) - 1))
        for row, joints in zip(self._means, PART_JOINTS.values(), strict=True):
            row[np.array(joints) - 1] = 1.0 / len(joints)
        self._scales = np.array([_ERRORS_DEG[part.split()[-1]] for part in PARTS])
        self._joint_scales = np.array([_JOINT_ERRORS_DEG[_unsided(name)] for name in JOINT_NAMES[1:]])

    def expected_deg(self, solution: Solution) -> Array:
        """Return the expected errors (P,) of parts, degrees; empty for methods other than "best"."""
        variances = _variances(solution)
        return self._scales * _expected(self._means @ variances, solution) if len(variances) else variances

    def expected_joints_deg(self, solution: Solution) -> Array:
        """Return the expected errors (J - 1,) of joints, degrees; empty for methods other than "best"."""
        variances = _variances(solution)
        return self._joint_scales * _expected(variances, solution) if len(variances) else variances

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
                reason = "its marker is hidden" if is_one else "its markers are hidden"
            elif not fits[markers].all():
                reason = "its marker does not fit" if is_one else "its markers do not fit"
            else:
                reason = "its motion is not in the database"
            notes.append(PoseNote.uncertain(part, reason))
        return notes


def _variances(solution: Solution) -> Array:
    """Return the variances (J - 1,) of joints, square radians; empty if unknown."""
    if solution.sigmas_rad is None or not np.isfinite(solution.nearest_m):
        return np.empty(0)
    return np.asarray(np.add.reduce(np.square(solution.sigmas_rad), axis=-1))


def _expected(variances: Array, solution: Solution) -> Array:
    """Return the expected errors for given variances, before the scale of each part or joint."""
    nearest = (solution.nearest_m + _NEAREST_M) ** _NEAREST_POWER
    return np.asarray(np.degrees(np.sqrt(variances)) ** _SIGMA_POWER * nearest)


def _unsided(joint: str) -> str:
    """Return the name of a right joint's counterpart on the left; other names are returned unchanged."""
    return "l" + joint[1:] if joint[0] == "r" else joint


def doubtful_joints(errors_deg: Array) -> list[int]:
    """Return the joints of parts with large expected errors (P,)."""
    return [joint for part in doubtful_parts(errors_deg) for joint in PART_JOINTS[part]]
