"""Interface of the methods that find a frame's pose from its closest examples."""

from dataclasses import dataclass
from typing import Protocol

from .observation import Observation
from .solution import Estimate, Examples, SolverState
from .subject_model import RootPose


@dataclass(frozen=True)
class FrameProblem:
    """One frame as a method gets it.

    Args:
        state: motion up to the last frame, with the time of this one.
        root: first estimate of the root.
        examples: closest examples under that root.
    """

    state: SolverState
    observation: Observation
    root: RootPose
    examples: Examples


class Method(Protocol):
    """A method prepared for one subject and one database.

    Attributes:
        examples: number of closest examples to search.
        fits_markers: whether its poses are fitted to the markers, more closely than an example is.
        query_pose_m_per_rad: metres of marker distance that a radian of pose counts in its search.
        others_distance: factor of the distances of other bodies' frames, where the database has the subject's.
        longest_s: longest time looked back at markers and solved poses.
    """

    examples: int
    fits_markers: bool
    query_pose_m_per_rad: float
    others_distance: float
    longest_s: float

    def estimate(self, problem: FrameProblem) -> Estimate:
        """Return the pose of a frame."""
