"""Interface of the methods that find a frame's pose from its closest examples."""

from dataclasses import dataclass
from typing import Protocol

from .observation import Observation
from .solution import Estimate, Examples, SolverState
from .subject_model import RootPose


@dataclass(frozen=True)
class FrameProblem:
    """One frame to solve."""

    state: SolverState  # motion up to the last frame, with the time of this one
    observation: Observation
    root: RootPose  # initial estimate of the root
    examples: Examples  # closest examples for this root


class Method(Protocol):
    """A method prepared for one subject and one database.

    Attributes:
        examples: Number of closest examples that are searched for it.
        fits_markers: Whether the method fits poses to the markers.
        query_pose_m_per_rad: Marker distance that counts as much as a radian of pose in the search, metres.
        others_distance: Factor of the squared distances of other bodies' frames if the database contains frames of the
            subject.
        longest_s: Longest lag at which the method uses earlier markers or poses; 0 if it uses none.
    """

    examples: int
    fits_markers: bool
    query_pose_m_per_rad: float
    others_distance: float
    longest_s: float

    def estimate(self, problem: FrameProblem) -> Estimate:
        """Return the pose for a frame."""
