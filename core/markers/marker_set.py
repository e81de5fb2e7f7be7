"""Marker sets: markers, their joints and offsets."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from ..body.skeleton import Skeleton, marker_positions
from ..errors import MarkerSetError
from ..geometry.arrays import Array, IntArray, Mask
from ..system.assets import MARKER_SETS
from ..system.files import is_file, read_toml
from ..system.schema import About, Schema, Table

_FARTHEST_M = 10.0  # largest distance of a marker from its joint: no bone is longer
FEWEST_TORSO = 3  # fewest markers that determine the root: three points fix a rigid body
# joints from the torso outwards; for limbs, those of either side
_TRUNK, _BESIDE = ("root", "lowerback", "upperback", "thorax"), ("clavicle", "lowerneck", "femur", "humerus")
_NEAR_TORSO = (*_TRUNK, *_BESIDE, "upperneck", "head")


class PointKind(Enum):
    """Kind of the points in a set."""

    MARKERS = "markers"  # fixed to the body, accurate to millimetres
    # found in images by a neural network, near joints, with errors of centimetres that last for many frames
    KEYPOINTS = "keypoints"


@dataclass(frozen=True)
class Marker:
    """A marker of a set; offsets are metres in the rest pose's axes, None until the subject is calibrated."""

    name: Annotated[str, About("unique in the set")]
    joint: Annotated[str, About("joint of the standard skeleton that carries the marker")]
    offset_m: Annotated[
        tuple[float, float, float] | None,
        About("from the joint in the rest pose: left, up, forward", "m", -_FARTHEST_M, _FARTHEST_M),
    ] = None
    torso: Annotated[bool, About("whether it is used to find the root; at least three markers must be")] = False
    text: Annotated[str, About("its name in messages")] = ""
    also: Annotated[tuple[str, ...], About("other names that capture systems give it")] = ()
    placed: Annotated[bool, About("whether its offset was found from a take's motion, not taken from a set")] = False


@dataclass(frozen=True)
class MarkerSet:
    """Set of markers worn together, in a fixed order."""

    name: Annotated[str, About("name of the set; by default the file's", optional=True)]
    markers: Annotated[tuple[Marker, ...], About("the markers, in order", key="marker")]
    points: Annotated[
        PointKind, About("what its points are: markers on the body, or keypoints that a network finds in images")
    ] = PointKind.MARKERS

    def __post_init__(self) -> None:
        names = [marker.name for marker in self.markers]
        if not names or len(set(names)) != len(names):
            raise MarkerSetError(
                "needs markers with unique names",
                where=f"marker set {self.name}",
                advice="give each marker a name of its own",
            )
        if sum(marker.torso for marker in self.markers) < FEWEST_TORSO:
            raise MarkerSetError(
                f"needs at least {FEWEST_TORSO} markers with torso = true to find the root",
                where=f"marker set {self.name}",
                advice="mark more of the markers on the torso",
            )
        for marker in self.markers:
            if marker.offset_m is not None and not np.all(np.abs(marker.offset_m) < _FARTHEST_M):  # false for NaN, too
                raise MarkerSetError(
                    f"offset_m must be three numbers below {_FARTHEST_M:g}", where=f"marker {marker.name}",
                    advice="give it in metres",
                )  # fmt: skip

    def __len__(self) -> int:
        return len(self.markers)

    @property
    def names(self) -> tuple[str, ...]:
        """Marker names in order."""
        return tuple(marker.name for marker in self.markers)

    @property
    def texts(self) -> tuple[str, ...]:
        """Descriptions of the markers for messages, in order."""
        return tuple(marker.text or marker.name for marker in self.markers)

    @property
    def torso(self) -> Mask:
        """Mask (M,) of markers used to find the root."""
        return np.array([marker.torso for marker in self.markers])

    @property
    def offsets_m(self) -> Array:
        """Offsets (M, 3); MarkerSetError if a marker has none yet."""
        missing = [marker.name for marker in self.markers if marker.offset_m is None]
        if missing:
            raise MarkerSetError(
                "has no offset for " + ", ".join(missing),
                where=f"marker set {self.name}",
                advice="calibrate the subject, or give offset_m",
            )
        return np.array([marker.offset_m for marker in self.markers], dtype=np.float64)

    def joint_indices(self, skeleton: Skeleton) -> IntArray:
        """Return the index (M,) of each marker's joint in the skeleton."""
        return np.array([skeleton.index(marker.joint) for marker in self.markers], dtype=np.int64)

    def positions_on(self, skeleton: Skeleton, rotations: Array, root_position_m: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
        """Return the markers' world positions (..., M, 3) on a posed skeleton, metres.

        Args:
            rotations: Local joint rotations (..., J, 4).
            root_position_m: World position (..., 3) of the root.
        """
        return marker_positions(skeleton, self.joint_indices(skeleton), self.offsets_m, rotations, root_position_m)

    def with_offsets(self, offsets_m: Array) -> "MarkerSet":
        """Return the set with new offsets (M, 3)."""
        rows = np.asarray(offsets_m, dtype=np.float64)
        markers = [
            replace(m, offset_m=(float(o[0]), float(o[1]), float(o[2])))
            for m, o in zip(self.markers, rows, strict=True)
        ]
        return replace(self, markers=tuple(markers))

    def subset(self, names: Sequence[str]) -> "MarkerSet":
        """Return the set with only the markers in `names`."""
        return replace(self, markers=tuple(marker for marker in self.markers if marker.name in names))

    def worn(self, names: Sequence[str]) -> "MarkerSet":
        """Return the set with only the markers in `names`, however few of these are on the torso.

        If fewer than three torso markers are left, markers on the bones next to the torso help to find the root.

        Raises:
            MarkerSetError: Fewer than three markers are on or next to the torso.
        """
        kept = [marker for marker in self.markers if marker.name in names]
        lacking = FEWEST_TORSO - sum(marker.torso for marker in kept)
        ranks = {marker.name: _torso_rank(marker.joint) for marker in kept if not marker.torso}
        near = sorted((name for name, rank in ranks.items() if rank < len(_NEAR_TORSO)), key=lambda name: ranks[name])
        more = near[: max(lacking, 0)]
        return replace(
            self, markers=tuple(replace(marker, torso=marker.torso or marker.name in more) for marker in kept)
        )


def _torso_rank(joint: str) -> int:
    """Return the rank of a joint in the order from the torso outwards, 0 for the closest."""
    near = [rank for rank, name in enumerate(_NEAR_TORSO) if joint in (name, "l" + name, "r" + name)]
    return near[0] if near else len(_NEAR_TORSO)


def marker_set_names() -> tuple[str, ...]:
    """Return the names of the shipped marker sets."""
    return tuple(sorted(path.stem for path in MARKER_SETS.glob("*.toml")))


def load_marker_set(name_or_path: str | Path) -> MarkerSet:
    """Return a shipped marker set by its name, or the one in a TOML file."""
    path = MARKER_SETS / f"{name_or_path}.toml"
    if not is_file(path):
        path = Path(name_or_path)
    if not is_file(path):
        raise MarkerSetError(
            f"there is no marker set or file {str(name_or_path)!r}",
            advice="shipped sets: " + ", ".join(marker_set_names()),
        )
    return marker_set_from(read_toml(path), where=str(path))


def marker_set_from(table: Table, where: str) -> MarkerSet:
    """Return the marker set from a file's tables; MarkerSetError if they are invalid."""
    return MARKER_SET.read({"name": Path(where).stem, **table}, where)


MARKER_SET = Schema(
    MarkerSet,
    "Marker set",
    "Markers that are worn together; most sets have no offsets before calibration.",
    MarkerSetError,
    "check the file",
)
