"""Settings of the solver and of its methods."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from ..errors import SettingsError

METHODS = ("best", "local-pca", "lwr", "nearest")
SEARCHES = ("auto", "exhaustive", "cells", "graph")


def _check_positive(settings: object, *names: str) -> None:
    for name in names:
        if not getattr(settings, name) > 0.0:
            raise SettingsError(f"{name} must be positive")


def _check_shares(settings: object, *names: str) -> None:
    for name in names:
        if not 0.0 <= getattr(settings, name) <= 1.0:
            raise SettingsError(f"{name} must lie between 0 and 1")


def _check_ascending(settings: object, *names: str) -> None:
    for name in names:
        values = getattr(settings, name)
        if not values or list(values) != sorted(set(values)) or values[0] < 1:
            raise SettingsError(f"{name} must be ascending whole numbers from 1")


@dataclass(frozen=True)
class NearestSettings:
    """Settings of "nearest".

    Args:
        examples: frames searched for.
        query_pose_m_per_rad: metres of marker distance that a radian of pose counts in the search.
    """

    examples: int = 300
    query_pose_m_per_rad: float = 0.1

    def __post_init__(self) -> None:
        _check_positive(self, "examples", "query_pose_m_per_rad")


@dataclass(frozen=True)
class LwrSettings(NearestSettings):
    """Settings of "lwr".

    Args:
        neighbours: examples that locally weighted regression interpolates.
    """

    neighbours: int = 16


@dataclass(frozen=True)
class LocalPcaSettings:
    """Settings of "local-pca"; the defaults are the paper's where it names them.

    Args:
        control_alpha: weight of the markers in the synthesis (Eq. 9).
        smoothness_beta: weight of the smoothness term (Eq. 9).
        marker_sigma_m: marker distance that costs as much as one standard deviation of the prior; the paper gives
            no units for its terms, this and the next two set ours.
        pose_sigma_rad: change of velocity, over all joints, that costs as much as one standard deviation.
        query_pose_m_per_rad: metres of marker distance that a radian of pose counts in the search.
        neighbours: candidates for K, ascending.
        dimensions: candidates for B, ascending.
        validation_examples: nearest examples that the cross-validation is scored on.
    """

    control_alpha: float = 0.8
    smoothness_beta: float = 0.2
    marker_sigma_m: float = 0.003
    pose_sigma_rad: float = 0.3
    query_pose_m_per_rad: float = 0.1
    neighbours: tuple[int, ...] = (30, 60, 150, 300)
    dimensions: tuple[int, ...] = (7, 12, 25, 35)
    validation_examples: int = 24

    def __post_init__(self) -> None:
        _check_shares(self, "control_alpha", "smoothness_beta")
        _check_positive(self, "marker_sigma_m", "pose_sigma_rad", "query_pose_m_per_rad")
        _check_ascending(self, "neighbours", "dimensions")


@dataclass(frozen=True)
class BestSettings:
    """Settings of "best", see `gaussian_conditioning`.

    Args:
        neighbours, marker_sigma_m: K, and the standard deviation of a marker coordinate beside its noise.
        query_pose_m_per_rad: metres of marker distance that a radian of pose counts in the search.
        others_distance: factor of the squared distances of other bodies' frames, where the database has the subject's:
            people move more like themselves.
        broad_share: share of the whole database's covariance added to the neighbours'.
        pose_floor_rad: standard deviation granted to every joint angle beside these.
        history_s: ascending times looked back at markers and solved poses.
        history_sigma_m, history_sigma_rad: standard deviations with which an example's earlier markers and pose stand
            for the performer's.
        momentum: expected share of the last change of pose in the next.
        change_share: share of the whole database's covariance with which the pose varies about that expectation.
        change_rad: standard deviation of each joint angle beside that.
        known_marker_sigma_m, known_momentum, known_change_share: the same for a body that the database knows, with a
            marker located in space: its neighbours are closer.
        root_sigma_m, root_sigma_rad: standard deviations of the root about the torso markers' estimate.
        prior_share: weight of the learned prior (see `motion_prior`), 0 for none.
        prior_file: its file, "" for the shipped one.
    """

    neighbours: int = 300
    marker_sigma_m: float = 0.002
    query_pose_m_per_rad: float = 1.0
    others_distance: float = 4.0
    broad_share: float = 0.02
    pose_floor_rad: float = 0.003
    history_s: tuple[float, ...] = (0.1, 0.25)
    history_sigma_m: float = 0.05
    history_sigma_rad: float = 0.15
    momentum: float = 0.5
    change_share: float = 0.03
    change_rad: float = 0.03
    known_marker_sigma_m: float = 0.001
    known_momentum: float = 0.8
    known_change_share: float = 0.2
    root_sigma_m: float = 0.03
    root_sigma_rad: float = 0.1
    prior_share: float = 1.0
    prior_file: str = ""

    def __post_init__(self) -> None:
        _check_positive(self, "marker_sigma_m", "known_marker_sigma_m", "known_change_share", "query_pose_m_per_rad")
        _check_positive(self, "others_distance")
        if not self.prior_share >= 0.0:
            raise SettingsError("prior_share must not be negative")
        lags = self.history_s
        if not lags or list(lags) != sorted(set(lags)) or not lags[0] > 0.0:
            raise SettingsError("history_s must be ascending times above 0")

    def for_known_body(self) -> "BestSettings":
        """Return the settings for a body that the database knows."""
        return replace(
            self,
            marker_sigma_m=self.known_marker_sigma_m,
            momentum=self.known_momentum,
            change_share=self.known_change_share,
        )


@dataclass(frozen=True)
class SolveSettings:
    """Settings of the solver.

    Args:
        method: "best" (the most accurate), "local-pca" (the paper's), "lwr" or "nearest".
        query_alpha: weight of the markers against continuity in the search (Eq. 2).
        search: "auto", "exhaustive", "cells" or "graph" (the paper's), see `choose_search`.
    """

    method: str = "best"
    query_alpha: float = 0.8
    search: str = "auto"
    best: BestSettings = field(default_factory=BestSettings)
    local_pca: LocalPcaSettings = field(default_factory=LocalPcaSettings)
    lwr: LwrSettings = field(default_factory=LwrSettings)
    nearest: NearestSettings = field(default_factory=NearestSettings)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise SettingsError(f"there is no method {self.method!r}", advice="methods: " + ", ".join(METHODS))
        if self.search not in SEARCHES:
            raise SettingsError(f"there is no search {self.search!r}", advice="searches: " + ", ".join(SEARCHES))
        _check_shares(self, "query_alpha")

    @classmethod
    def of_table(cls, table: Mapping[str, Any]) -> "SolveSettings":
        """Return the settings of a table, as takes and requests store them.

        Raises:
            SettingsError: an unknown setting, or a value out of range.
        """
        groups: dict[str, dict[str, Any]] = {group: {} for group in _GROUPS}
        own: dict[str, Any] = {}
        for key, stored in table.items():
            value = tuple(stored) if isinstance(stored, list) else stored
            if key in ("method", "query_alpha", "search"):
                own[key] = value
            elif key not in _FIELDS_OF_KEY:
                raise SettingsError(f"there is no setting {key!r}")
            for group, name, convert in _FIELDS_OF_KEY.get(key, ()):
                groups[group][name] = convert(value)
        return cls(**own, **{group: _GROUPS[group](**values) for group, values in groups.items()})

    def table(self) -> dict[str, Any]:
        """Return the settings that differ from the defaults, for takes."""
        usual = SolveSettings()
        own = {name: getattr(self, name) for name in ("method", "query_alpha", "search")}
        result = {name: value for name, value in own.items() if value != getattr(usual, name)}
        for key, places in _FIELDS_OF_KEY.items():
            for group, name, convert in places:
                value = getattr(getattr(self, group), name)
                if convert is _same and value != getattr(getattr(usual, group), name):
                    result.setdefault(key, value)
        return result


def _same(value: Any) -> Any:
    return value


def _largest(values: Any) -> int:
    return int(max(values, default=0))


_GROUPS: dict[str, Callable[..., Any]] = {
    "best": BestSettings,
    "local_pca": LocalPcaSettings,
    "lwr": LwrSettings,
    "nearest": NearestSettings,
}


def _stored_keys() -> dict[str, list[tuple[str, str, Callable[[Any], Any]]]]:
    """Return the group, field and conversion of each key of a stored table.

    Stored tables have no groups.
    """
    result: dict[str, list[tuple[str, str, Callable[[Any], Any]]]] = {}
    for setting in fields(BestSettings):
        key = setting.name if setting.name.startswith("root_") else f"best_{setting.name}"
        result[key] = [("best", setting.name, _same)]
    for setting in fields(LocalPcaSettings):
        result[setting.name] = [("local_pca", setting.name, _same)]
    result["query_pose_m_per_rad"] += [(group, "query_pose_m_per_rad", _same) for group in ("lwr", "nearest")]
    result["neighbours"] += [(group, "examples", _largest) for group in ("lwr", "nearest")]
    result["lwr_neighbours"] = [("lwr", "neighbours", _same)]
    return result


_FIELDS_OF_KEY = _stored_keys()
