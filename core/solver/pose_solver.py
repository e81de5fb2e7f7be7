"""From labelled markers to poses, frame by frame: search, local model, synthesis, and the alternatives to them."""

from collections.abc import Callable
from copy import copy

import numpy as np
from numpy.typing import NDArray

from ..database.store import Database
from ..errors import DatabaseError
from . import conditional, local_model, synthesis
from .history import MarkerHistory, PoseHistory
from .observation import Observation
from .root import root_from_torso
from .search.choose import choose_search
from .search.exhaustive import Query
from .settings import SolveSettings
from .solution import Examples, Fitted, Solution
from .subject_model import RootPose, SubjectModel

Array = NDArray[np.float64]
FloatArray = NDArray[np.float32]
IntArray = NDArray[np.int64]

_ROOT_PASSES = 2  # the root needs the pose's torso markers and the pose needs the root
_FIRST_ROOT_PASSES = 4  # at the start nothing is known about either
_TORSO_EXAMPLES = 8  # closest examples whose mean torso the root is laid on
_SPARE_CANDIDATES = 2  # candidates kept, per example wanted, for the second look under a better root
_KERNEL = 0.2  # of the largest distance: where an example's weight in "best" has fallen to 1/e
_HISTORY_SHARE = 0.3  # what a squared distance of earlier markers counts in that weight, against the present ones
_BROAD_SAMPLES = 4096  # frames that the covariance of the whole database is taken over
_COMPONENTS = 30  # principal ones of earlier poses that "best" goes by
_FIT_STEPS = 4  # of Gauss-Newton at most: most starts are so close that one is enough
_SYNTHESIS_PASSES = 2  # the same between synthesis and root


class PoseSolver:
    """Solves one frame after another for one subject with one database."""

    def __init__(self, subject: SubjectModel, database: Database, settings: SolveSettings) -> None:
        if database.frames < 2:
            raise DatabaseError("has fewer than two frames", where=str(database.path), advice="import more motion")
        self.subject = subject
        self.settings = settings
        self._poses = database.poses.reshape(database.frames, -1)
        self._markers = subject.database_markers(database)
        self._clips = database.clip_of_frame.astype(np.int64)
        self._search = choose_search(settings.search, database, self._markers, self._poses)
        self._history = MarkerHistory(database, self._markers, settings.best_history_s)
        self._pose_history = PoseHistory(database, self._principal_components(), settings.best_history_s)
        self._frame_s = 1.0 / database.fps
        self._typical_markers = np.mean(self._markers[:: max(1, len(self._markers) // 2048)], axis=0, dtype=np.float64)
        methods: dict[str, Callable[[PoseSolver, Observation, RootPose, Examples], Fitted]] = {
            "best": PoseSolver._conditional,
            "local-pca": PoseSolver._local_pca,
            "lwr": PoseSolver._locally_weighted,
            "nearest": PoseSolver._nearest,
        }
        self._method = methods[settings.method]
        if settings.method == "best":
            broad = self._broad_covariance()
            # what neighbours leave open, and how the pose varies about the motion that goes on
            self._floor = settings.best_broad_share * broad
            self._floor[np.diag_indices_from(broad)] += settings.best_pose_floor_rad**2
            size = self._poses.shape[1]
            self._change = settings.best_change_share * broad[:size, :size]
            self._change[np.diag_indices(size)] += settings.best_change_rad**2
        self.reset()

    def reset(self) -> None:
        """Forget the motion so far."""
        self._last: Array | None = None
        self._before_last: Array | None = None
        self._root: RootPose | None = None
        self._last_markers: Array | None = None
        self._time_s = 0.0
        self._expected: tuple[conditional.Prior, Array, RootPose, Observation] | None = None
        self._history.reset()
        self._pose_history.reset()
        self._search.reset()

    def continue_from(self, other: "PoseSolver") -> None:
        """Take over the motion so far of another solver of the same subject and database, but not its search."""
        self._last, self._before_last = other._last, other._before_last
        self._root, self._last_markers = other._root, other._last_markers
        self._time_s = other._time_s
        self._history.continue_from(other._history)
        self._pose_history.continue_from(other._pose_history)

    def branch(self) -> "PoseSolver":
        """Return a solver that came the same way and goes its own from here.

        What is large is shared, so the search is: what it remembers of its last query tells it where to begin only.
        """
        result = copy(self)
        result._history, result._pose_history = copy(self._history), copy(self._pose_history)
        result._history.continue_from(self._history)
        result._pose_history.continue_from(self._pose_history)
        return result

    def without_past(self) -> "PoseSolver":
        """Return a solver that knows of the motion so far only where the root is."""
        result = self.branch()
        result.reset()
        result._root = self._root
        return result

    def closest_m(self, observation: Observation) -> float:
        """Return the RMS distance of observed markers to the closest example's, metres; NaN when the root is not seen.

        It is what `step` would begin with; nothing is fitted, and the motion does not go on.
        """
        in_space = self._in_space(observation)
        located = self._locate(in_space)
        return self._nearest_distance(in_space, *located) if located is not None else float("nan")

    def surprise(self) -> float:
        """Return how unlikely the last frame's markers were after all before: minus the logarithm of their density.

        In metres, as `control_residual` has them. 0 where nothing was expected, and of methods other than "best".
        """
        if self._expected is None:
            return 0.0
        prior, pose, root, observation = self._expected
        root_sigma = (self.settings.root_sigma_m, self.settings.root_sigma_rad)
        return conditional.surprise(prior, self.subject, observation, pose, root, root_sigma)

    @property
    def visited(self) -> int:
        """Frames that the searches so far computed the distance of."""
        return self._search.visited

    def predicted_markers_m(self) -> Array | None:
        """Return the markers (M, 3) of the last synthesized pose in the world, None at the start."""
        return self._last_markers

    def step(
        self, observation: Observation, time_s: float | None = None, assumed_m: Array | None = None
    ) -> Solution | None:
        """Return the pose of the next frame; None when nothing tells yet where the body is.

        Args:
            observation: what was seen.
            time_s: when; default a frame of the database after the last.
            assumed_m: (M, 3) where the markers of a first frame are thought to be that only one camera shows.
        """
        if self._last_markers is None:
            self._last_markers = assumed_m
        self._time_s = self._time_s + self._frame_s if time_s is None else time_s
        if self._last is None:
            if self._advance(observation) is None:
                return None
            self._before_last = None
        # the first frame is solved twice: the second time its own pose, not a typical one, tells where the torso is
        solution = self._advance(observation)
        self._history.remember(self._time_s, self._in_space(observation).points_m)
        if solution is not None:
            self._pose_history.remember(self._time_s, solution.pose.ravel())
        return solution

    def _in_space(self, observation: Observation) -> Observation:
        """Return the observation with what the root and the search need: three torso markers located in space."""
        torso = self.subject.torso & observation.located
        if torso.sum() >= 3 or self._last_markers is None:
            return observation
        return observation.lifted(self._last_markers)

    def _advance(self, observation: Observation) -> Solution | None:
        in_space = self._in_space(observation)
        located = self._locate(in_space)
        if located is None:
            return None
        root, examples = located
        fitted = self._method(self, observation, root, examples)
        markers = self.subject.markers(fitted.pose.reshape(-1, 3), fitted.root)
        self._before_last, self._last, self._root, self._last_markers = self._last, fitted.pose, fitted.root, markers
        return Solution(
            fitted.pose.reshape(-1, 3),
            fitted.root,
            markers,
            fitted.neighbours,
            fitted.dimensions,
            self._nearest_distance(in_space, root, examples),
            fitted.iterations,
        )

    @property
    def _continued_pose(self) -> Array | None:
        """2 q_{t-1} - q_{t-2} of Eq. 2 and 8."""
        if self._last is None:
            return None
        before = self._last if self._before_last is None else self._before_last
        return 2.0 * self._last - before

    def _locate(self, observation: Observation) -> tuple[RootPose, Examples] | None:
        """Find the root and the closest examples, each from the other in turn."""
        continued = self._continued_pose
        local = self._typical_markers if continued is None else self.subject.markers(continued.reshape(-1, 3))
        root = self._root
        frames: IntArray | None = None
        for _ in range(_ROOT_PASSES if continued is not None else _FIRST_ROOT_PASSES):
            root = self._root_under(observation, local, root)
            if root is None:
                return None
            # while the motion is followed the root moves little from here on: the search need not start again
            frames, distances = self._ranked(observation, root, continued, None if continued is None else frames)
            local = np.mean(self._markers[frames[:_TORSO_EXAMPLES]], axis=0, dtype=np.float64)
        if root is None or frames is None:
            return None
        frames = frames[: self._wanted]
        return root, Examples(frames, distances[: self._wanted], self._poses[frames], self._markers[frames])

    def _root_under(self, observation: Observation, local: Array, previous: RootPose | None) -> RootPose | None:
        """Return z_t from the torso markers, given the pose's markers (M, 3) in the root's frame."""
        return root_from_torso(observation, local, self.subject.torso, self.subject.joints, previous)

    def _settled_root(self, observation: Observation, pose: Array, root: RootPose) -> RootPose:
        """Return z_t under the pose (D,) that has been found."""
        return self._root_under(observation, self.subject.markers(pose.reshape(-1, 3)), root) or root

    @property
    def _wanted(self) -> int:
        """K, or the largest of its candidates."""
        return self.settings.best_neighbours if self.settings.method == "best" else self.settings.neighbours[-1]

    def _ranked(
        self, observation: Observation, root: RootPose, continued: Array | None, candidates: IntArray | None
    ) -> tuple[IntArray, Array]:
        """Return frames, of the candidates or of all, by Eq. 2, closest first, and their distances.

        The observed markers are compared in the root's rest (T of Eq. 2).
        """
        settings = self.settings
        best = settings.method == "best"
        metres_per_radian = settings.best_query_pose_m_per_rad if best else settings.query_pose_m_per_rad
        query = Query(
            root.to_root_frame(observation.points_m),
            continued,
            settings.query_alpha,
            (1.0 - settings.query_alpha) * metres_per_radian**2,
        )
        if candidates is None:
            return self._search.nearest(query, self._wanted * _SPARE_CANDIDATES)
        return self._search.nearest_among(query, candidates)

    def _nearest_distance(self, observation: Observation, root: RootPose, examples: Examples) -> float:
        seen = observation.located
        if not np.any(seen):
            return float("nan")
        differences = root.to_root_frame(observation.points_m[seen]) - examples.markers_m[0][seen]
        return float(np.sqrt(np.mean(np.sum(differences**2, axis=-1))))

    def _nearest(self, observation: Observation, root: RootPose, examples: Examples) -> Fitted:
        """Return the closest example."""
        pose = examples.poses[0].astype(np.float64)
        return Fitted(pose, self._settled_root(observation, pose, root), 1)

    def _locally_weighted(self, observation: Observation, root: RootPose, examples: Examples) -> Fitted:
        """Return the mean of the nearby examples by their distance (Atkeson et al. 1997, tricube kernel)."""
        count = min(self.settings.lwr_neighbours, len(examples.poses) - 1)
        distances = np.sqrt(np.maximum(examples.distances[: count + 1], 0.0))
        weights = (1.0 - (distances[:count] / max(distances[count], 1e-12)) ** 3) ** 3
        weights += 1e-9  # all equally far: all count
        pose = weights @ examples.poses[:count] / weights.sum()
        return Fitted(pose, self._settled_root(observation, pose, root), count)

    def _local_pca(self, observation: Observation, root: RootPose, examples: Examples) -> Fitted:
        """Return the pose of least energy in the local model (Eq. 9), and the root under it, each in turn."""
        settings = self.settings
        seen = observation.located
        poses = examples.poses.astype(np.float64)
        model = local_model.cross_validate(
            poses,
            examples.markers_m[:, seen].reshape(len(poses), -1).astype(np.float64),
            self._clips[examples.frames],
            settings.neighbours,
            settings.dimensions,
            settings.marker_sigma_m**2 / max(settings.control_alpha, 1e-9),
            settings.validation_examples,
        ).model
        weights = model.weights(poses[0])
        iterations = 0
        for fitting_pass in range(_SYNTHESIS_PASSES):
            if fitting_pass > 0:
                root = self._settled_root(observation, model.pose(weights), root)
            problem = synthesis.SynthesisProblem(
                model,
                self.subject,
                root,
                observation,
                self._continued_pose,
                settings.control_alpha / settings.marker_sigma_m**2,
                settings.smoothness_beta / settings.pose_sigma_rad**2,
            )
            weights, taken = synthesis.solve(problem, weights)
            iterations += taken
        pose = model.pose(weights)
        root = self._settled_root(observation, pose, root)
        return Fitted(pose, root, model.neighbours, model.dimensions, iterations)

    def _conditional(self, observation: Observation, root: RootPose, examples: Examples) -> Fitted:
        """Return the pose expected for the markers, fitted to them together with the root."""
        settings = self.settings
        history = self._history.of_frames(examples.frames).reshape(len(examples.frames), -1)
        observed = self._history.observed(self._time_s, root).ravel()
        pose_history = self._pose_history.of_frames(examples.frames).reshape(len(examples.frames), -1)
        solved = self._pose_history.observed(self._time_s).ravel()
        known = np.isfinite(observed)
        away = history[:, known] - observed[known]
        distances = np.maximum(examples.distances, 0.0)
        distances += settings.query_alpha * _HISTORY_SHARE * np.einsum("kh,kh->k", away, away)
        weights = np.exp(-distances / (_KERNEL * distances.max() + 1e-12))
        weights /= weights.sum()
        samples = np.concatenate((examples.poses, history, pose_history), axis=1)
        prior = conditional.neighbours_prior(samples, weights, self._floor)
        sigmas = (settings.best_history_sigma_m, settings.best_history_sigma_rad)
        variances = np.repeat(np.square(sigmas), (len(observed), len(solved)))
        prior = conditional.conditioned(prior, np.concatenate((observed, solved)), variances)
        start = prior.mean
        if self._last is not None and self._before_last is not None:
            start = expected = self._last + settings.best_momentum * (self._last - self._before_last)
            prior = conditional.continued_prior(prior, expected, self._change)
        self._expected = (prior, start, root, observation)
        pose, root, steps = conditional.fit_to_markers(
            prior,
            self.subject,
            observation,
            start,
            root,
            settings.best_marker_sigma_m**2,
            (settings.root_sigma_m, settings.root_sigma_rad),
            _FIT_STEPS,
        )
        return Fitted(pose, root, len(weights), iterations=steps)

    @property
    def _broad_frames(self) -> IntArray:
        """Frames that stand for the whole database."""
        return np.arange(0, len(self._poses), max(1, len(self._poses) // _BROAD_SAMPLES))

    def _principal_components(self) -> Array:
        """Return the directions (D, C) in which poses vary most over the whole database."""
        poses = self._poses[self._broad_frames].astype(np.float64)
        _, directions = np.linalg.eigh(np.cov(poses.T, ddof=0))
        return np.asarray(directions[:, : -_COMPONENTS - 1 : -1])

    def _broad_covariance(self) -> Array:
        """Return the covariance of pose, earlier markers and earlier poses over the whole database."""
        frames = self._broad_frames
        history = self._history.of_frames(frames).reshape(len(frames), -1)
        pose_history = self._pose_history.of_frames(frames).reshape(len(frames), -1)
        samples = np.concatenate((self._poses[frames].astype(np.float64), history, pose_history), axis=1)
        return np.asarray(np.cov(samples.T, ddof=0))
