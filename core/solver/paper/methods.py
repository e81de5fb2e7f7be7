"""The paper's method, local-pca, and the methods with which it is compared: lwr and nearest."""

import numpy as np

from ...geometry.arrays import Array, IntArray
from ..method import FrameProblem
from ..observation import Observation
from ..root import root_from_torso
from ..settings import LocalPcaSettings, LwrSettings, NearestSettings
from ..solution import Estimate, Examples
from ..subject_model import RootPose, SubjectModel
from . import local_model, synthesis

_SYNTHESIS_PASSES = 2  # number of alternations: the synthesis depends on the root, and the root on its torso


def _settle_root(subject: SubjectModel, observation: Observation, pose: Array, root: RootPose) -> RootPose:
    """Return the root z_t that fits a pose (D,) to the torso markers; the given root if they are too few."""
    return root_from_torso(observation, subject.markers(pose.reshape(-1, 3)), subject, root) or root


class NearestMethod:
    """Method that returns the closest example."""

    fits_markers = False
    others_distance = 1.0
    longest_s = 0.0

    def __init__(self, settings: NearestSettings, subject: SubjectModel) -> None:
        self._subject = subject
        self.examples = settings.examples
        self.query_pose_m_per_rad = settings.query_pose_m_per_rad

    def estimate(self, problem: FrameProblem) -> Estimate:
        """Return the closest example's pose."""
        pose = problem.examples.poses[0].astype(np.float64)
        return Estimate(pose, _settle_root(self._subject, problem.observation, pose, problem.root), 1)


class LwrMethod(NearestMethod):
    """Method that averages the nearby examples, weighted by distance (Atkeson et al. 1997, tricube kernel)."""

    def __init__(self, settings: LwrSettings, subject: SubjectModel) -> None:
        super().__init__(settings, subject)
        self._neighbours = settings.neighbours

    def estimate(self, problem: FrameProblem) -> Estimate:
        """Return the weighted mean of the nearby examples."""
        examples = problem.examples
        count = min(self._neighbours, len(examples.poses) - 1)
        distances = np.sqrt(np.maximum(examples.distances[: count + 1], 0.0))
        weights = (1.0 - (distances[:count] / max(distances[count], 1e-12)) ** 3) ** 3
        weights += 1e-9  # so that examples at equal distances all count
        pose = weights @ examples.poses[:count] / weights.sum()
        return Estimate(pose, _settle_root(self._subject, problem.observation, pose, problem.root), count)


class LocalPcaMethod:
    """The paper's method: the pose of least energy in a local model (Eq. 9)."""

    fits_markers = True
    others_distance = 1.0
    longest_s = 0.0

    def __init__(self, settings: LocalPcaSettings, subject: SubjectModel, clips: IntArray) -> None:
        self._settings, self._subject, self._clips = settings, subject, clips
        self.examples = settings.neighbours[-1]
        self.query_pose_m_per_rad = settings.query_pose_m_per_rad

    def estimate(self, problem: FrameProblem) -> Estimate:
        """Return the pose of least energy in the local model and its root, which are found in alternation."""
        settings, observation, root = self._settings, problem.observation, problem.root
        model = self._local_model(problem.examples, observation)
        weights = model.weights(problem.examples.poses[0].astype(np.float64))
        iterations = 0
        for fitting_pass in range(_SYNTHESIS_PASSES):
            if fitting_pass > 0:
                root = _settle_root(self._subject, observation, model.pose(weights), root)
            task = synthesis.SynthesisProblem(
                model,
                self._subject,
                root,
                observation,
                problem.state.continued_pose,
                settings.control_alpha / settings.marker_sigma_m**2,
                settings.smoothness_beta / settings.pose_sigma_rad**2,
            )
            weights, taken = synthesis.solve(task, weights)
            iterations += taken
        pose = model.pose(weights)
        root = _settle_root(self._subject, observation, pose, root)
        return Estimate(pose, root, model.neighbours, model.dimensions, iterations)

    def _local_model(self, examples: Examples, observation: Observation) -> local_model.LocalModel:
        settings, poses = self._settings, examples.poses.astype(np.float64)
        return local_model.cross_validate(
            poses,
            examples.markers_m[:, observation.located].reshape(len(poses), -1).astype(np.float64),
            self._clips[examples.frames],
            settings.neighbours,
            settings.dimensions,
            settings.marker_sigma_m**2 / max(settings.control_alpha, 1e-9),
            settings.validation_examples,
        ).model
