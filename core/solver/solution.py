"""Examples, solutions and the state of the solver between frames."""

from dataclasses import dataclass, field

from ..body.pose_notes import NoteKind
from ..geometry.arrays import Array, FloatArray, IntArray
from .gaussian_conditioning import Expectation
from .lagged_history import LaggedHistory
from .motion_prior import PriorEstimate
from .subject_model import RootPose


@dataclass(frozen=True)
class Examples:
    """Database frames closest to a query, closest first."""

    frames: IntArray  # (K,) indices
    distances: Array  # (K,) Eq. 2 distances, up to a constant
    poses: FloatArray  # (K, D) float32
    markers_m: FloatArray  # (K, M, 3) float32, with the root at rest


@dataclass(frozen=True)
class Solution:
    """A solved pose."""

    pose: Array  # (J - 1, 3) relative to the reference pose
    root: RootPose
    markers_m: Array  # (M, 3) the subject's markers in the world
    neighbours: int  # number of neighbours, K, of the local model; 1 for the nearest example
    dimensions: int  # number of dimensions, B, of the local model
    nearest_m: float  # RMS distance of the observed markers from those of the closest example; NaN without markers
    iterations: int  # steps of Levenberg-Marquardt or Gauss-Newton
    uncertainty_rad: Array | None = None  # (J - 1,) of joints, uncalibrated; None for methods other than "best"
    tilt_rad: float = 0.0  # angle between the vertical in the body's axes and that in its examples' axes
    prior_led: bool = False  # the learned prior had more weight than the neighbours
    reinitialised: bool = False  # the pose was also solved without history, which is expensive
    begun: NoteKind | None = None  # why the pose without history was used


@dataclass(frozen=True)
class SolverState:
    """The motion solved so far; `PoseSolver.initial_state` is the first state.

    States are immutable, so several continuations of one state are independent.
    """

    time_s: float = 0.0  # time of the last frame
    learned: PriorEstimate | None = None  # learned prior for the last frame, if it was given
    root: RootPose | None = None  # root of the last frame
    markers_m: Array | None = None  # (M, 3) markers expected in the world, from the last solution
    pose: Array | None = None  # (D,) pose of the last frame
    previous_pose: Array | None = None  # (D,) pose of the frame before
    found: IntArray | None = None  # frames found by the last search, from which the next may start
    observed: LaggedHistory = field(default_factory=LaggedHistory)  # earlier observed markers
    solved: LaggedHistory = field(default_factory=LaggedHistory)  # earlier solved poses
    reinitialise_failed_s: float = float("-inf")  # time of the last failed re-initialisation
    compared_s: float = float("-inf")  # time of the last comparison with the whole database
    evidence: float = 0.0  # evidence against the current trajectory, see `TrajectoryCheck`
    expectation: Expectation | None = None  # prior for the last frame, with its markers; for the method "best"

    @property
    def continued_pose(self) -> Array | None:
        """Continued pose 2 q_{t-1} - q_{t-2} of Eq. 2 and 8."""
        if self.pose is None:
            return None
        before = self.pose if self.previous_pose is None else self.previous_pose
        return 2.0 * self.pose - before


@dataclass(frozen=True)
class Estimate:
    """A method's pose (D,), root, size of its model, expectation, uncertainty (J - 1,), and more; see `Solution`."""

    pose: Array
    root: RootPose
    neighbours: int
    dimensions: int = 0
    iterations: int = 0
    expectation: Expectation | None = None
    uncertainty_rad: Array | None = None
    prior_led: bool = False
    tilt_rad: float = 0.0
