"""What can be set about solving."""

from dataclasses import dataclass

from ..errors import SettingsError

METHODS = ("best", "local-pca", "lwr", "nearest")
SEARCHES = ("auto", "exhaustive", "cells", "graph")


@dataclass(frozen=True)
class SolveSettings:
    """Settings of the solver; the defaults are the paper's where it names them.

    Args:
        method: "best" (the most accurate), "local-pca" (the paper's), "lwr" or "nearest".
        query_alpha: weight of the markers against continuity in the search (Eq. 2).
        control_alpha: weight of the markers in the synthesis (Eq. 9).
        smoothness_beta: weight of the smoothness term (Eq. 9).
        marker_sigma_m: marker distance that costs as much as one standard deviation of the prior; the paper gives
            no units for its terms, this and the next two set ours.
        pose_sigma_rad: change of velocity, over all joints, that costs as much as one standard deviation.
        query_pose_m_per_rad: how many metres of marker distance a radian of pose counts in the search.
        neighbours: candidates for K, ascending.
        dimensions: candidates for B, ascending.
        validation_examples: nearest examples that the cross-validation is scored on.
        lwr_neighbours: examples that locally weighted regression interpolates.
        best_neighbours, best_marker_sigma_m: K and the standard deviation of a marker coordinate in "best".
        best_query_pose_m_per_rad: `query_pose_m_per_rad` of "best".
        best_broad_share: share of the covariance of the whole database that "best" adds to its neighbours'.
        best_pose_floor_rad: standard deviation granted to every joint angle beside these.
        best_history_s: how long ago "best" also looks where the markers were and which pose it solved.
        best_history_sigma_m, best_history_sigma_rad: standard deviations with which an example's earlier markers and
            pose stand for the performer's.
        best_momentum: share of the last change of pose that "best" expects to go on.
        best_change_share: share of the covariance of the whole database with which the pose varies about that
            expectation.
        best_change_rad: standard deviation of each joint angle beside that.
        search: "auto", "exhaustive", "cells" or "graph" (the paper's), see `choose_search`.
        root_sigma_m, root_sigma_rad: how far "best" may move the root from where the torso markers put it.
    """

    method: str = "best"
    query_alpha: float = 0.8
    control_alpha: float = 0.8
    smoothness_beta: float = 0.2
    marker_sigma_m: float = 0.003
    pose_sigma_rad: float = 0.3
    query_pose_m_per_rad: float = 0.1
    neighbours: tuple[int, ...] = (30, 60, 150, 300)
    dimensions: tuple[int, ...] = (7, 12, 25, 35)
    validation_examples: int = 24
    lwr_neighbours: int = 16
    best_neighbours: int = 300
    best_marker_sigma_m: float = 0.002
    best_query_pose_m_per_rad: float = 2.0
    best_broad_share: float = 0.02
    best_pose_floor_rad: float = 0.003
    best_history_s: tuple[float, ...] = (0.1, 0.25)
    best_history_sigma_m: float = 0.05
    best_history_sigma_rad: float = 0.15
    best_momentum: float = 0.8
    best_change_share: float = 0.1
    best_change_rad: float = 0.03
    root_sigma_m: float = 0.03
    root_sigma_rad: float = 0.1
    search: str = "auto"

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise SettingsError(f"there is no method {self.method!r}", advice="methods: " + ", ".join(METHODS))
        if self.search not in SEARCHES:
            raise SettingsError(f"there is no search {self.search!r}", advice="searches: " + ", ".join(SEARCHES))
        for name in ("query_alpha", "control_alpha", "smoothness_beta"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise SettingsError(f"{name} must lie between 0 and 1")
        for name in (
            "marker_sigma_m",
            "pose_sigma_rad",
            "query_pose_m_per_rad",
            "best_marker_sigma_m",
            "best_query_pose_m_per_rad",
        ):
            if not getattr(self, name) > 0.0:
                raise SettingsError(f"{name} must be positive")
        lags = self.best_history_s
        if not lags or list(lags) != sorted(set(lags)) or not lags[0] > 0.0:
            raise SettingsError("best_history_s must be ascending times above 0")
        for name in ("neighbours", "dimensions"):
            values = getattr(self, name)
            if not values or list(values) != sorted(set(values)) or values[0] < 1:
                raise SettingsError(f"{name} must be ascending whole numbers from 1")
