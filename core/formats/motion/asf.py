"""Acclaim skeletons: ASF files, as written by the CMU Motion Capture Database.

A bone of an ASF file starts at the end of its parent's bone; here it becomes the joint of the same name at its start.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ...body.skeleton import MOST_JOINTS, Skeleton
from ...body.standard_skeleton import JOINT_NAMES
from ...errors import FormatError
from ...geometry import rotations as rot
from ...geometry.arrays import Array
from ...system.file_content import decode_text, with_decimal_points
from ...system.files import read_bytes, reading

_METRES_PER_INCH = 0.0254
ROOT = "root"
_SECTIONS = ("units", "root", "bonedata", "hierarchy")
_CHANNELS = frozenset(("tx", "ty", "tz", "rx", "ry", "rz", "l"))


@dataclass(frozen=True)
class AsfBone:
    """One bone of an ASF file, in the file's units except for angles (radians).

    Args:
        direction: Unit direction (3,) in the rest pose.
        axis: Rest-from-bone-frame quaternion (4,).
        axis_order: Order of the rotations about fixed axes, e.g. "XYZ" (x first).
        channels: Degrees of freedom in the order of the AMC values, e.g. ("rx", "rz").
    """

    name: str
    direction: Array
    length: float
    axis: Array
    axis_order: str
    channels: tuple[str, ...]


@dataclass(frozen=True)
class AsfFile:
    """Contents of an ASF file.

    Args:
        bones: Bones by name, without the root.
        root: The root as a bone without length; its channels are the file's `order`.
        root_position: Rest position (3,) in the file's unit.
        root_orientation: Rest orientation (4,).
        skeleton: Joints that can move, see `read_asf`.
    """

    path: str
    metres_per_unit: float
    degrees: bool
    bones: dict[str, AsfBone]
    parents: dict[str, str]
    root: AsfBone
    root_position: Array
    root_orientation: Array
    skeleton: Skeleton


def read_asf(path: Path | str) -> AsfFile:
    """Return the contents of an ASF file, with its skeleton in metres.

    Joints have the file's bone names. Bones without degrees of freedom that the standard skeleton lacks (CMU's
    lhipjoint, rhipjoint) are folded into their children's offsets.

    Raises:
        FormatError: The file is not ASF or is damaged; names file and line.
    """
    return parse_asf(read_bytes(path), str(path))


def parse_asf(content: bytes, where: str) -> AsfFile:
    """Parse the bytes of an ASF file; `where` names it in errors."""
    with reading(where):
        return _Parser(content, where).parse()


Line = tuple[int, list[str]]


class _Parser:
    def __init__(self, content: bytes, where: str) -> None:
        self.where = where
        text = with_decimal_points(decode_text(content, where, "ASF skeleton").encode()).decode()
        if "\x00" in text or ":bonedata" not in text:
            raise FormatError("is not an ASF skeleton (no :bonedata section)", where=where, advice="export it as ASF")
        self.lines = text.splitlines()
        self.sections = self._split()
        self.factor = 1.0
        self.metres = 1.0
        self.line = 0

    def _split(self) -> dict[str, list[range]]:
        """Return the line ranges of each section; a section may occur several times."""
        starts = [number for number, line in enumerate(self.lines) if line.lstrip().startswith(":")]
        sections: dict[str, list[range]] = {name: [] for name in _SECTIONS}
        for start, stop in pairwise((*starts, len(self.lines))):
            name = self._words(start)[0][1:].lower()
            if name in sections:
                sections[name].append(range(start, stop))
        return sections

    def _words(self, number: int) -> list[str]:
        return self.lines[number].split("#", 1)[0].replace("(", " ( ").replace(")", " ) ").split()

    def _error(self, what: str) -> FormatError:
        where = f"{self.where}, line {self.line}" if self.line else self.where
        return FormatError(what, where=where, advice="repair the file, or export it again")

    def _lines(self, section: str) -> Iterator[list[str]]:
        if not self.sections[section]:
            raise self._error(f"has no :{section} section")
        for numbers in self.sections[section]:
            for number in numbers:
                words = self._words(number)[1 if number == numbers.start else 0 :]
                self.line = number + 1
                if words:
                    yield words
        self.line = 0

    def parse(self) -> AsfFile:
        degrees = self._units()
        root, position, orientation = self._root()
        bones = self._bones()
        parents = self._hierarchy(bones)
        skeleton = _skeleton_of(bones, parents, root, self.metres, self.where)
        return AsfFile(self.where, self.metres, degrees, bones, parents, root, position, orientation, skeleton)

    def _units(self) -> bool:
        units = {words[0].lower(): words[1] for words in self._lines("units")} if self.sections["units"] else {}
        length = float(units.get("length", "1"))
        if not length > 0.0 or not np.isfinite(length):
            raise self._error(f"has a length unit of {length}")
        self.metres = _METRES_PER_INCH / length
        degrees = units.get("angle", "deg").lower().startswith("deg")
        self.factor = np.pi / 180.0 if degrees else 1.0
        return degrees

    def _numbers(self, words: list[str], count: int) -> Array:
        if len(words) < count:
            raise self._error(f"needs {count} numbers, has {len(words)}")
        numbers = np.array([float(word) for word in words[:count]])
        if not np.all(np.isfinite(numbers)):
            raise self._error("holds a number that is not finite")
        return numbers

    def _rotation(self, angles: Array, order: str) -> Array:
        if sorted(order) != ["X", "Y", "Z"]:
            raise self._error(f"has the unknown axis order {order!r}")
        return fixed_axis_rotation(angles * self.factor, order)

    def _root(self) -> tuple[AsfBone, Array, Array]:
        fields = {words[0].lower(): words[1:] for words in self._lines("root")}
        order = (fields.get("axis") or ["XYZ"])[-1].upper()
        channels = self._channels(fields.get("order", ["tx", "ty", "tz", "rx", "ry", "rz"]))
        position = self._numbers(fields.get("position", ["0"] * 3), 3)
        orientation = self._rotation(self._numbers(fields.get("orientation", ["0"] * 3), 3), order)
        bone = AsfBone(ROOT, np.zeros(3), 0.0, rot.identity(), order, channels)
        return bone, position, orientation

    def _channels(self, words: list[str]) -> tuple[str, ...]:
        channels = tuple(word.lower() for word in words)
        unknown = [channel for channel in channels if channel not in _CHANNELS]
        if unknown or len(set(channels)) != len(channels):
            raise self._error(f"has unknown or repeated degrees of freedom {' '.join(words)}")
        return channels

    def _bones(self) -> dict[str, AsfBone]:
        bones: dict[str, AsfBone] = {}
        fields: dict[str, Line] = {}
        for words in self._lines("bonedata"):
            keyword = words[0].lower()
            if keyword == "begin":
                fields = {}
            elif keyword == "end":
                bone = self._bone(fields)
                if bone.name in bones or bone.name == ROOT:
                    raise self._error(f"lists the bone {bone.name!r} twice")
                bones[bone.name] = bone
            else:
                fields[keyword] = (self.line, words[1:])
        if not 0 < len(bones) <= MOST_JOINTS:
            raise self._error(f"has {len(bones)} bones, not 1 to {MOST_JOINTS}")
        return bones

    def _bone(self, fields: dict[str, Line]) -> AsfBone:
        missing = [key for key in ("name", "direction", "length") if key not in fields or not fields[key][1]]
        if missing:
            raise self._error(f"has a bone without {', '.join(missing)}")
        end = self.line
        self.line, words = fields["direction"]
        direction = self._numbers(words, 3)
        size = float(np.linalg.norm(direction))
        self.line, words = fields["length"]
        length = float(self._numbers(words, 1)[0])
        self.line, words = fields.get("axis", (end, ["0", "0", "0", "XYZ"]))
        order = words[3].upper() if len(words) > 3 else "XYZ"
        axis = self._rotation(self._numbers(words, 3), order)
        self.line, words = fields.get("dof", (end, []))
        channels = self._channels(words)
        self.line = end
        unit = direction / size if size > 0.0 else direction
        return AsfBone(fields["name"][1][0], unit, length, axis, order, channels)

    def _hierarchy(self, bones: dict[str, AsfBone]) -> dict[str, str]:
        parents: dict[str, str] = {}
        for words in self._lines("hierarchy"):
            if words[0].lower() in ("begin", "end") and len(words) == 1:
                continue
            for name in (words[0], *words[1:]):
                if name != ROOT and name not in bones:
                    raise self._error(f"names the unknown bone {name!r} in its hierarchy")
            for child in words[1:]:
                if child in parents or child == ROOT:
                    raise self._error(f"gives {child!r} a second parent")
                parents[child] = words[0]
        return parents


def fixed_axis_rotation(angles: Array, order: str) -> Array:
    """Return rotations by angles (..., n), radians, about fixed axes in the given order."""
    return rot.from_euler(angles[..., ::-1], order[::-1])


def _skeleton_of(
    bones: dict[str, AsfBone], parents: dict[str, str], root: AsfBone, metres: float, where: str
) -> Skeleton:
    order = _parents_first(parents, where)
    kept = [name for name in order if name in JOINT_NAMES or any(c[0] == "r" for c in bones[name].channels)]
    if set(kept) <= set(JOINT_NAMES):
        kept.sort(key=JOINT_NAMES.index)
    kept = [ROOT, *kept]
    links = [_link(name, parents, bones, kept) for name in kept[1:]]
    tips = [bones[name].direction * bones[name].length * metres for name in kept[1:]]
    described = [root, *(bones[name] for name in kept[1:])]
    return Skeleton(
        names=tuple(kept),
        parents=np.array([-1, *(kept.index(parent) for parent, _ in links)]),
        offsets_m=np.array([np.zeros(3), *(offset * metres for _, offset in links)]),
        tips_m=np.array([np.zeros(3), *tips]),
        angle_axes=np.array([bone.axis for bone in described]),
        angle_orders=tuple(_angle_order(bone) for bone in described),
    )


def _link(name: str, parents: dict[str, str], bones: dict[str, AsfBone], kept: list[str]) -> tuple[str, Array]:
    """Return the nearest kept ancestor and the offset from its joint."""
    offset = np.zeros(3)
    ancestor = parents[name]
    while ancestor != ROOT:
        offset = offset + bones[ancestor].direction * bones[ancestor].length
        if ancestor in kept:
            break
        ancestor = parents[ancestor]
    return ancestor, offset


def _parents_first(parents: dict[str, str], where: str) -> list[str]:
    order: dict[str, None] = {}
    waiting = list(parents)
    while waiting:
        ready = [name for name in waiting if parents[name] == ROOT or parents[name] in order]
        if not ready:
            what = f"has bones that are not connected to the root: {', '.join(waiting[:5])}"
            raise FormatError(what, where=where, advice="repair the file, or export it again")
        order[ready[0]] = None
        waiting.remove(ready[0])
    return list(order)


def _angle_order(bone: AsfBone) -> str:
    """Return the joint's axes in `rotations.from_euler` order: the fixed axes reversed."""
    axes = {channel[1].upper() for channel in bone.channels if channel[0] == "r"}
    return "".join(axis for axis in reversed(bone.axis_order) if axis in axes)
