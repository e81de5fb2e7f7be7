"""Search for labels without history, spread over several frames."""

from ..geometry.arrays import Array, IntArray, Mask
from .initial_labelling import InitialLabeller, InitialLabels
from .labeller import Labeller

# limits on the number of array elements processed in one frame
WORK = 1_000_000  # takes about 2.5 ms
WORK_UNHURRIED = 200_000  # while there is no evidence against the labels
WORK_ALONE = 5_500_000  # without a tracked body


class LabelSearch:
    """Search for the labels of one frame's points, spread over the following frames.

    The labels found are carried over to the latest frame by tracking the points.

    Args:
        points_m: Points (N, 3) of the frame that is searched.
        torso: Markers (M,) on the torso.

    Attributes:
        found: Labels of that frame's points; None if the points do not look like a body.
    """

    def __init__(self, initial: InitialLabeller, points_m: Array, torso: Mask) -> None:
        self.found: InitialLabels | None = None
        self.points_m = points_m
        self._search, self._is_done = initial.search(points_m), False
        self._later: list[tuple[Array, float]] = []
        self._torso = torso

    def follow(self, points_m: Array, elapsed_s: float) -> None:
        """Add the points (N, 3) of the next frame."""
        self._later.append((points_m, elapsed_s))

    def advance(self, work: float) -> bool:
        """Do one frame's share of the work; return whether the search is finished."""
        while not self._is_done and work > 0.0:
            try:
                work -= next(self._search)
            except StopIteration as end:
                self.found, self._is_done = end.value, True
        return self._is_done

    def labellings(self) -> list[tuple[IntArray, float]]:
        """Return all labels (N,) found for the points that were searched, with costs, likeliest first."""
        return [(self.found.labels, self.found.cost), *self.found.alternatives] if self.found else []

    def carry(self, labels: IntArray) -> tuple[Labeller, IntArray]:
        """Return a labeller that has tracked labels (N,) to the latest frame, and the labels of that frame's points."""
        labeller = Labeller(self._torso)
        labeller.begin(self.points_m, labels)
        for points_m, elapsed_s in self._later:
            labels = labeller.follow(points_m, elapsed_s)
        return labeller, labels
