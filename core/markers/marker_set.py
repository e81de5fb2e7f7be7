"""Marker sets: markers, their joints and offsets."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..body.skeleton import Skeleton
from ..errors import MarkerSetError
from ..geometry.arrays import Array, IntArray, Mask
from ..system.assets import MARKER_SETS
from ..system.files import is_file, read_toml
from ..system.schema import Key, Schema

_FARTHEST_M = 10.0  # from its joint; Skeleton's bones are no longer
_MINIMUM_TORSO_MARKERS = 3
MARKER_KEYS = (
    Key("name", "unique in the set", str),
    Key("joint", "that carries it, of the standard skeleton", str),
    Key(
        "offset_m",
        "from the joint in the rest pose: left, up, forward",
        float,
        (3,),
        "m",
        -_FARTHEST_M,
        _FARTHEST_M,
        optional=True,
    ),
    Key("torso", "whether it serves to find the root; three markers or more do", bool, optional=True),
    Key("text", "its name in messages", str, optional=True),
    Key("also", "other names that systems write for it", str, (None,), optional=True),
)
MARKER_SET_KEYS = (
    Key("name", "of the set; the file's name if left out", str, optional=True),
    Key("marker", "the markers, in order", MARKER_KEYS, (None,), optional=True),
)
MARKER_SET = Schema(
    "Marker set",
    "Markers that are worn together, before calibration mostly without offsets.",
    MARKER_SET_KEYS,
    MarkerSetError,
    "check the file",
)


@dataclass(frozen=True)
class Marker:
    """One marker.

    Args:
        offset_m: (3) joint origin to marker in the rest pose in the joint's axes (x left, y up, z forward), metres;
            None until the subject is calibrated.
        torso: whether it serves to find the root.
        text: its name in messages ("left foot"); empty: `name`.
        also: other names that systems write for it.
    """

    name: str
    joint: str
    offset_m: tuple[float, float, float] | None = None
    torso: bool = False
    text: str = ""
    also: tuple[str, ...] = ()


@dataclass(frozen=True)
class MarkerSet:
    """Markers worn together, in a fixed order."""

    name: str
    markers: tuple[Marker, ...]

    def __post_init__(self) -> None:
        names = [marker.name for marker in self.markers]
        if not names or len(set(names)) != len(names):
            raise MarkerSetError("needs markers with unique names", where=f"marker set {self.name}")
        if sum(marker.torso for marker in self.markers) < _MINIMUM_TORSO_MARKERS:
            raise MarkerSetError(
                f"needs at least {_MINIMUM_TORSO_MARKERS} markers with torso = true to find the root",
                where=f"marker set {self.name}",
            )
        for marker in self.markers:
            if marker.offset_m is not None and not np.all(np.abs(marker.offset_m) < _FARTHEST_M):  # nor NaN
                raise MarkerSetError(
                    f"offset_m must be three numbers below {_FARTHEST_M:g}", where=f"marker {marker.name}",
                    advice="give metres",
                )  # fmt: skip

    def __len__(self) -> int:
        return len(self.markers)

    @property
    def names(self) -> tuple[str, ...]:
        """Marker names in order."""
        return tuple(marker.name for marker in self.markers)

    @property
    def texts(self) -> tuple[str, ...]:
        """Names of the markers in messages, in order."""
        return tuple(marker.text or marker.name for marker in self.markers)

    @property
    def torso(self) -> Mask:
        """(M,) true for markers that serve to find the root."""
        return np.array([marker.torso for marker in self.markers])

    @property
    def offsets_m(self) -> Array:
        """(M, 3) offsets; MarkerSetError when a marker has none yet."""
        missing = [marker.name for marker in self.markers if marker.offset_m is None]
        if missing:
            raise MarkerSetError(
                "no offset for " + ", ".join(missing),
                where=f"marker set {self.name}",
                advice="calibrate the subject, or give offset_m",
            )
        return np.array([marker.offset_m for marker in self.markers], dtype=np.float64)

    def joint_indices(self, skeleton: Skeleton) -> IntArray:
        """(M,) index of each marker's joint in the skeleton."""
        return np.array([skeleton.index(marker.joint) for marker in self.markers], dtype=np.int64)

    def with_offsets(self, offsets_m: Array) -> "MarkerSet":
        """Return the set with new offsets (M, 3)."""
        rows = np.asarray(offsets_m, dtype=np.float64)
        markers = [
            replace(m, offset_m=(float(o[0]), float(o[1]), float(o[2])))
            for m, o in zip(self.markers, rows, strict=True)
        ]
        return replace(self, markers=tuple(markers))

    def subset(self, names: Sequence[str]) -> "MarkerSet":
        """Return the set without the markers that are not in `names`."""
        return replace(self, markers=tuple(marker for marker in self.markers if marker.name in names))


def marker_set_names() -> tuple[str, ...]:
    """Names of the shipped marker sets."""
    return tuple(sorted(path.stem for path in MARKER_SETS.glob("*.toml")))


def load_marker_set(name_or_path: str | Path) -> MarkerSet:
    """Return a shipped marker set by its name, or one from a TOML file."""
    path = MARKER_SETS / f"{name_or_path}.toml"
    if not is_file(path):
        path = Path(name_or_path)
    if not is_file(path):
        raise MarkerSetError(
            f"there is no marker set or file {str(name_or_path)!r}",
            advice="shipped sets: " + ", ".join(marker_set_names()),
        )
    return marker_set_from(read_toml(path), where=str(path))


def marker_set_from(table: Mapping[str, Any], where: str) -> MarkerSet:
    """Return the marker set of a file's tables, held against `MARKER_SET`."""
    MARKER_SET.check(table, where)
    return MarkerSet(table.get("name", Path(where).stem), tuple(map(_marker, table.get("marker", ()))))


def _marker(row: Mapping[str, Any]) -> Marker:
    offset = row.get("offset_m")
    place = None if offset is None else (float(offset[0]), float(offset[1]), float(offset[2]))
    also = tuple(row.get("also", ()))
    return Marker(row["name"], row["joint"], place, row.get("torso", False), row.get("text", ""), also)


def marker_set_table(marker_set: MarkerSet) -> dict[str, Any]:
    """Return the TOML table of a marker set, `marker_set_from`'s inverse."""
    rows = []
    for marker in marker_set.markers:
        row: dict[str, Any] = {"name": marker.name, "joint": marker.joint}
        if marker.also:
            row["also"] = list(marker.also)
        if marker.text:
            row["text"] = marker.text
        if marker.offset_m is not None:
            row["offset_m"] = list(marker.offset_m)
        rows.append(row | {"torso": marker.torso})
    return {"name": marker_set.name, "marker": rows}
