"""Settings of the solver and of its methods."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any

from ..errors import SettingsError
from ..system.schema import About, check_ranges

METHODS = ("best", "local-pca", "lwr", "nearest")
SEARCHES = ("auto", "exhaustive", "cells", "graph")


def _check_ascending(settings: object, *names: str) -> None:
    for name in names:
        values = getattr(settings, name)
        if not values or list(values) != sorted(set(values)):
            raise SettingsError(f"{name} must be numbers in ascending order without repetitions")


_QUERY = About("marker distance that counts as much as a radian of pose in the search", "m", above=0.0)


@dataclass(frozen=True)
class NearestSettings:
    """Settings of "nearest"."""

    examples: Annotated[int, About("number of examples to search for", "", 1)] = 300
    query_pose_m_per_rad: Annotated[float, _QUERY] = 0.1

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class LwrSettings(NearestSettings):
    """Settings of "lwr"."""

    neighbours: Annotated[int, About("number of examples that locally weighted regression averages", "", 1)] = 16


@dataclass(frozen=True)
class LocalPcaSettings:
    """Settings of "local-pca".

    The defaults are the paper's where it gives them. It gives no units for its terms: the two standard deviations and
    `query_pose_m_per_rad` define ours.
    """

    control_alpha: Annotated[float, About("weight of the markers in the synthesis (Eq. 9)", "", 0.0, 1.0)] = 0.8
    smoothness_beta: Annotated[float, About("weight of the smoothness term (Eq. 9)", "", 0.0, 1.0)] = 0.2
    marker_sigma_m: Annotated[
        float, About("marker distance that costs as much as one standard deviation of the prior", "m", above=0.0)
    ] = 0.003
    pose_sigma_rad: Annotated[float, About("change of all joint velocities that costs as much", "rad", above=0.0)] = 0.3
    query_pose_m_per_rad: Annotated[float, _QUERY] = 0.1
    neighbours: Annotated[tuple[int, ...], About("candidates for K, ascending", "", 1)] = (30, 60, 150, 300)
    dimensions: Annotated[tuple[int, ...], About("candidates for B, ascending", "", 1)] = (7, 12, 25, 35)
    validation_examples: Annotated[int, About("number of nearest examples used for cross-validation", "", 1)] = 24

    def __post_init__(self) -> None:
        check_ranges(self)
        _check_ascending(self, "neighbours", "dimensions")


@dataclass(frozen=True)
class BestSettings:
    """Settings of "best", see `gaussian_conditioning`.

    Frames of other bodies count as farther away by the factor `others_distance`, because people move more like
    themselves. The settings known_... are for a body that is in the database, in frames that locate a marker:
    neighbours of such a body are closer.
    """

    neighbours: Annotated[int, About("number of neighbours, K", "", 1)] = 300
    marker_sigma_m: Annotated[
        float, About("standard deviation of a marker coordinate in addition to its noise", "m", above=0.0)
    ] = 0.002
    query_pose_m_per_rad: Annotated[float, _QUERY] = 1.0
    others_distance: Annotated[
        float, About("factor of the squared distances of other bodies' frames, for known subjects", above=0.0)
    ] = 4.0
    broad_share: Annotated[float, About("factor of the database's covariance that is added to the neighbours'")] = 0.02
    pose_floor_rad: Annotated[float, About("standard deviation added to every joint angle", "rad")] = 0.003
    history_s: Annotated[
        tuple[float, ...], About("ages of the earlier markers and poses that are compared, ascending", "s", above=0.0)
    ] = (0.1, 0.25)
    history_sigma_m: Annotated[
        float, About("standard deviation of the performer's earlier markers from an example's", "m")
    ] = 0.05
    history_sigma_rad: Annotated[
        float, About("standard deviation of the performer's earlier pose from an example's", "rad")
    ] = 0.15
    momentum: Annotated[float, About("next change of pose that is expected, as a share of the last one")] = 0.5
    change_share: Annotated[
        float, About("factor of the database's covariance that gives the pose's covariance about that expectation")
    ] = 0.03
    change_rad: Annotated[float, About("standard deviation of each joint angle in addition to that", "rad")] = 0.03
    known_marker_sigma_m: Annotated[float, About("`marker_sigma_m` of a known body", "m", above=0.0)] = 0.001
    known_momentum: Annotated[float, About("`momentum` of a known body")] = 0.8
    known_change_share: Annotated[float, About("`change_share` of a known body", above=0.0)] = 0.2
    root_sigma_m: Annotated[
        float, About("standard deviation of the root's position from the torso markers' estimate", "m")
    ] = 0.03
    root_sigma_rad: Annotated[float, About("the same for its rotation", "rad")] = 0.1
    prior_share: Annotated[float, About("weight of the learned prior (see `motion_prior`), 0 for none", "", 0.0)] = 1.0
    prior_file: Annotated[str, About("file of the learned prior; empty for the shipped one")] = ""

    def __post_init__(self) -> None:
        check_ranges(self)
        _check_ascending(self, "history_s")

    def for_known_body(self) -> "BestSettings":
        """Return the settings for a body that is in the database."""
        return replace(
            self,
            marker_sigma_m=self.known_marker_sigma_m,
            momentum=self.known_momentum,
            change_share=self.known_change_share,
        )


@dataclass(frozen=True)
class SolveSettings:
    """Settings of the solver."""

    method: Annotated[
        str, About('"best" (the most accurate), "local-pca" (the paper\'s), "lwr" or "nearest"', choices=METHODS)
    ] = "best"
    query_alpha: Annotated[
        float, About("weight of the markers relative to continuity in the search (Eq. 2)", "", 0.0, 1.0)
    ] = 0.8
    search: Annotated[str, About('see `choose_search`; "graph" is the paper\'s', choices=SEARCHES)] = "auto"
    best: BestSettings = field(default_factory=BestSettings)
    local_pca: LocalPcaSettings = field(default_factory=LocalPcaSettings)
    lwr: LwrSettings = field(default_factory=LwrSettings)
    nearest: NearestSettings = field(default_factory=NearestSettings)

    def __post_init__(self) -> None:
        check_ranges(self)

    @classmethod
    def of_table(cls, table: Mapping[str, Any]) -> "SolveSettings":
        """Return the settings from a table, as takes and requests store them.

        Raises:
            SettingsError: A setting is unknown, or a value is out of range.
        """
        groups: dict[str, dict[str, Any]] = {group: {} for group in _GROUPS}
        own: dict[str, Any] = {}
        for key, stored in table.items():
            value = tuple(stored) if isinstance(stored, list) else stored
            if key in ("method", "query_alpha", "search"):
                own[key] = value
            elif key not in _FIELDS_OF_KEY:
                raise SettingsError(f"there is no setting {key!r}", advice="check its spelling, or remove it")
            for group, name, convert in _FIELDS_OF_KEY.get(key, ()):
                groups[group][name] = convert(value)
        return cls(**own, **{group: _GROUPS[group](**values) for group, values in groups.items()})

    def table(self) -> dict[str, Any]:
        """Return the settings that differ from the defaults, for storing in takes."""
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
    """Return the group, the field and the conversion of each key in a stored table.

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
