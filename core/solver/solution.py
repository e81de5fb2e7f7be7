"""Examples, solutions and the state of the solver between frames."""

from dataclasses import dataclass, field

from ..geometry.arrays import Array, FloatArray, IntArray
from .gaussian_conditioning import Expectation
from .lagged_history import LaggedHistory
from .motion_prior import PriorEstimate
from .subject_model import RootPose


@dataclass(frozen=True)
class Examples:
    """Database frames closest to a query, closest first.

    Args:
        frames: (K,) frame indices.
        distances: (K,) Eq. 2 distances, up to a constant.
        poses: (K, D) float32, their poses.
        markers_m: (K, M, 3) float32, their markers with the root at rest.
    """

    frames: IntArray
    distances: Array
    poses: FloatArray
    markers_m: FloatArray


@dataclass(frozen=True)
class Solution:
    """A solved pose.

    Args:
        pose: (J - 1, 3) relative to the mean rotations.
        markers_m: (M, 3) the subject's markers in the world.
        neighbours, dimensions: K and B of the local model; 1 and 0 for the nearest example.
        nearest_m: RMS distance of the observed markers to those of the closest example, metres; NaN when none.
        iterations: of Levenberg-Marquardt or Gauss-Newton.
        sigmas_rad: (J - 1, 3) standard deviations of the pose, uncalibrated; None of other methods than "best".
        reinitialised: The pose was also solved without history, which is expensive.
    """

    pose: Array
    root: RootPose
    markers_m: Array
    neighbours: int
    dimensions: int
    nearest_m: float
    iterations: int
    sigmas_rad: Array | None = None
    reinitialised: bool = False


@dataclass(frozen=True)
class SolverState:
    """The motion solved so far; `PoseSolver.initial_state` begins one.

    Keeping a state keeps the way back to it: two states that follow from one do not know of each other.

    Args:
        time_s: of the last frame.
        learned: learned prior of the last frame's markers, where it was known beforehand.
        root: of the last frame, None at the start.
        markers_m: (M, 3) expected in the world, those of the last solution; None at the start.
        pose, previous_pose: (D,) of the last two frames.
        found: frames of the last search, from which the next may begin.
        observed: earlier observed markers.
        solved: earlier solved poses.
        reinitialise_failed_s: Time of the last failed re-initialisation.
        compared_s: time of the last comparison with the whole database.
        evidence: Evidence against the current trajectory, see `TrajectoryCheck`.
        expectation: markers expected in the last frame; None at the start, and of other methods than "best".
    """

    time_s: float = 0.0
    learned: PriorEstimate | None = None
    root: RootPose | None = None
    markers_m: Array | None = None
    pose: Array | None = None
    previous_pose: Array | None = None
    found: IntArray | None = None
    observed: LaggedHistory = field(default_factory=LaggedHistory)
    solved: LaggedHistory = field(default_factory=LaggedHistory)
    reinitialise_failed_s: float = float("-inf")
    compared_s: float = float("-inf")
    evidence: float = 0.0
    expectation: Expectation | None = None

    @property
    def continued_pose(self) -> Array | None:
        """2 q_{t-1} - q_{t-2} of Eq. 2 and 8."""
        if self.pose is None:
            return None
        before = self.pose if self.previous_pose is None else self.previous_pose
        return 2.0 * self.pose - before


@dataclass(frozen=True)
class Estimate:
    """A method's pose (D,), root, size of its model, expectation, and deviations (D,)."""

    pose: Array
    root: RootPose
    neighbours: int
    dimensions: int = 0
    iterations: int = 0
    expectation: Expectation | None = None
    sigmas_rad: Array | None = None
