"""Props: rigid objects with markers of their own (sword, stick, camera).

Cameras recognise a prop by the distances between its markers, so its pattern must not fit itself in another pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np

from ..errors import PropError, counted
from ..geometry.arrays import Array
from ..geometry.point_patterns import match_rigid_pattern, place_pattern, planarity_m
from ..system.assets import PROPS
from ..system.files import is_file, read_toml, write_toml
from ..system.schema import About, Schema, Table, Via

FEWEST_MARKERS = 3
MOST_MARKERS = 12


@dataclass(frozen=True)
class _PropMarker:
    """One marker of a prop, as stored in a prop file."""

    name: Annotated[str, About("unique in the prop")]
    position_m: Annotated[Array, About("in the prop's own frame, y along it", "m", -10.0, 10.0, shape=(3,))]


@dataclass(frozen=True)
class _PropFile:
    """Definition of a prop, as stored in a file."""

    name: Annotated[str, About("name of the prop")]
    marker: Annotated[tuple[_PropMarker, ...], About("its markers")]
    residual_m: Annotated[float, About("RMS distance between observed and rigid markers", "m", 0.0, 10.0)] = 0.0


PROP = Schema(
    _PropFile,
    "Prop",
    f"A rigid object with {FEWEST_MARKERS} to {MOST_MARKERS} markers, not on a line and not in a pattern that fits "
    "itself in another position.",
    PropError,
    "calibrate the prop again",
    kind="perfanim prop",
)


@dataclass(frozen=True)
class PatternRules:
    """Requirements that a prop's marker pattern must meet so that cameras can find its pose."""

    planarity_m: float = 0.01  # RMS distance from the nearest line below which the roll is unknown
    apart_m: float = 0.02  # distance below which two markers look like one blob
    alike_m: float = 0.008  # RMS distance between two poses of the pattern below which they are confused
    alike_span_m: float = 0.02  # tolerance of distances in the search for such poses


RULES = PatternRules()


@dataclass(frozen=True)
class Prop:
    """A rigid object with M markers.

    Raises:
        PropError: There are too few or too many markers, or they are on a line, too close to each other, or in a
            pattern that fits itself in another pose; the message says which.
    """

    name: str
    names: tuple[str, ...]  # unique
    positions_m: Array  # (M, 3) in the prop's own frame, in which it stands upright: y along it
    residual_m: float = 0.0  # RMS distance between observed and rigid markers in the calibration

    def __post_init__(self) -> None:
        places = np.asarray(self.positions_m, dtype=np.float64)
        object.__setattr__(self, "positions_m", places)
        object.__setattr__(self, "names", tuple(self.names))
        if places.shape != (len(self.names), 3) or not np.all(np.isfinite(places)):
            raise PropError(
                "every marker needs three finite numbers as its position_m",
                where=self._where,
                advice="give them in metres",
            )
        if not FEWEST_MARKERS <= len(places) <= MOST_MARKERS:
            raise PropError(
                f"has {counted(len(places), 'marker')}",
                where=self._where,
                advice=f"use {FEWEST_MARKERS} to {MOST_MARKERS}",
            )
        if not self.name or len(set(self.names)) != len(self.names):
            raise PropError(
                "needs a name, and markers with unique names",
                where=self._where,
                advice="name the prop and each of its markers",
            )
        self._check_apart()
        if planarity_m(places) < RULES.planarity_m:
            raise PropError(
                "its markers lie on a line, so its roll is unknown",
                where=self._where,
                advice="move one of them at least 3 cm off the line",
            )
        self._check_unlike()

    @property
    def _where(self) -> str:
        return f"prop {self.name}"

    @property
    def spans_m(self) -> Array:
        """Distances (M, M) between the markers."""
        return np.linalg.norm(self.positions_m[:, None] - self.positions_m[None], axis=-1)

    def _check_apart(self) -> None:
        spans = self.spans_m + np.diag(np.full(len(self.names), np.inf))
        first, second = np.unravel_index(int(np.argmin(spans)), spans.shape)
        if spans[first, second] < RULES.apart_m:
            raise PropError(
                f"{self.names[first]} and {self.names[second]} are {1e3 * spans[first, second]:.0f} mm apart, "
                "so the cameras see one blob",
                where=self._where,
                advice=f"put them at least {1e3 * RULES.apart_m:.0f} mm apart",
            )

    def _check_unlike(self) -> None:
        """Raise PropError for a pattern that coincides with itself after a rotation of the prop."""
        count = len(self.names)
        for way in match_rigid_pattern(
            self.positions_m, self.spans_m, np.full((count, count), RULES.alike_span_m), count
        ):
            exchanged = np.flatnonzero(way != np.arange(count))
            if len(exchanged) and place_pattern(self.positions_m, self.positions_m[way])[2] < RULES.alike_m:
                exchanged_names = ", ".join(self.names[marker] for marker in exchanged)
                raise PropError(
                    f"looks the same in another orientation, with {exchanged_names} exchanged",
                    where=self._where,
                    advice="move one of them by 3 cm or more, so that no distance between two markers occurs twice",
                )


def prop_names() -> tuple[str, ...]:
    """Return the names of the shipped props."""
    return tuple(sorted(path.stem for path in PROPS.glob("*.toml")))


def load_prop(name_or_path: str | Path) -> Prop:
    """Return a shipped prop by its name, or the one in a TOML file.

    Raises:
        PropError: There is no such prop, or its markers are unsuitable.
        FormatError: The file cannot be read, or is not TOML.
    """
    path = PROPS / f"{name_or_path}.toml"
    if not is_file(path):
        path = Path(name_or_path)
    if not is_file(path):
        advice = f"calibrate it; shipped props: {', '.join(prop_names())}"
        raise PropError(f"there is no prop or file {str(name_or_path)!r}", advice=advice)
    return prop_from(read_toml(path), str(path))


def prop_from(table: Table, where: str) -> Prop:
    """Return the prop from the tables of its definition; PropError if these are of another version."""
    return _prop(PROP.read(table, where), where)


def prop_tables(prop: Prop) -> dict[str, Any]:
    """Return the tables of a definition, the inverse of `prop_from`."""
    return PROP.table(_prop_file(prop))


def _prop(file: _PropFile, _where: str) -> Prop:
    places = np.array([marker.position_m for marker in file.marker]).reshape(-1, 3)
    return Prop(file.name, tuple(marker.name for marker in file.marker), places, file.residual_m)


def _prop_file(prop: Prop) -> _PropFile:
    return _PropFile(prop.name, tuple(map(_PropMarker, prop.names, prop.positions_m)), prop.residual_m)


PropTables: TypeAlias = Annotated[Prop, Via(_PropFile, _prop, _prop_file)]


def save_prop(prop: Prop, path: str | Path) -> None:
    """Write a prop's definition as TOML; FormatError if it cannot be written."""
    write_toml(path, prop_tables(prop))


def check_distinct(props: Sequence[Prop]) -> None:
    """Raise PropError if props have the same name or the same pattern of markers."""
    if len({prop.name for prop in props}) < len(props):
        raise PropError("two props have the same name", advice="give each a name of its own in its file")
    for first in props:
        for second in props:
            if first is second or len(first.names) > len(second.names):
                continue
            tolerances = np.full((len(second.names), len(second.names)), RULES.alike_span_m)
            for way in match_rigid_pattern(second.positions_m, first.spans_m, tolerances, len(first.names)):
                if place_pattern(first.positions_m, second.positions_m[way])[2] < RULES.alike_m:
                    raise PropError(
                        f"{first.name} and {second.name} carry the same pattern of markers",
                        advice="move a marker of one of them by 3 cm or more",
                    )
