"""Acclaim motion: ASF skeletons and AMC motion, as written by the CMU Motion Capture Database.

A bone of an ASF file starts at the end of its parent's bone; here it is the joint of the same name at its start.
The values of an AMC file are angles about fixed axes, first about the first letter of the bone's axis order, in a
frame C that the ASF file gives for each bone: the joint's rotation relative to rest is C R(values) C^-1.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .. import rotations as rot
from ..errors import FormatError
from ..files import read_bytes
from ..motion import Motion
from ..product_skeleton import JOINT_NAMES
from ..skeleton import Skeleton
from .numbers import parse_numbers

Array = NDArray[np.float64]

CMU_FPS = 120.0
_METRES_PER_INCH = 0.0254
_ROOT = "root"
_CHANNELS = frozenset(("tx", "ty", "tz", "rx", "ry", "rz", "l"))


@dataclass(frozen=True)
class AsfBone:
    """One bone of an ASF file, in the file's units except for angles (radians).

    Args:
        name: bone name.
        direction: (3,) unit direction in the rest pose.
        length: length in the file's unit.
        axis: (4,) rest-from-bone-frame quaternion.
        axis_order: order of the rotations about fixed axes, e.g. "XYZ" (first x).
        channels: degrees of freedom in the order of the AMC values, e.g. ("rx", "rz").
    """

    name: str
    direction: Array
    length: float
    axis: Array
    axis_order: str
    channels: tuple[str, ...]


@dataclass(frozen=True)
class AsfFile:
    """What an ASF file says.

    Args:
        path: where it was read.
        metres_per_unit: length of the file's unit.
        degrees: whether angles are degrees.
        bones: by name, without the root.
        parents: parent's name by bone name.
        root: the root as a bone of no length; its channels are the file's `order`.
        root_position: (3,) rest position in the file's unit.
        root_orientation: (4,) rest orientation.
        skeleton: the joints that can move, see `read_asf`.
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


def read_asf(path: Path | str) -> Skeleton:
    """Return the skeleton of an ASF file in metres (value * 0.0254 / its `length` unit).

    Joints carry the file's bone names. Bones without degrees of freedom that the product's skeleton does not have
    (CMU's lhipjoint, rhipjoint) are folded into their children's offsets. Angle frames and orders are the file's.

    Raises:
        FormatError: not an ASF file, or damaged; names file and line.
    """
    return read_asf_file(path).skeleton


def read_asf_file(path: Path | str) -> AsfFile:
    """Return everything an ASF file says; see `read_asf`."""
    return parse_asf(read_bytes(path), str(path))


def parse_asf(content: bytes, where: str) -> AsfFile:
    """Return the description held in the bytes of an ASF file; `where` names it in errors."""
    return _AsfParser(content, where).parse()


Line = tuple[int, list[str]]


class _AsfParser:
    def __init__(self, content: bytes, where: str) -> None:
        self.where = where
        text = content.decode("utf-8", errors="replace")
        if "\x00" in text or ":bonedata" not in text:
            raise FormatError("is not an ASF skeleton (no :bonedata section)", where=where)
        self.sections = self._split(text)
        self.factor = 1.0
        self.metres = 1.0
        self.line = 0

    def _split(self, text: str) -> dict[str, list[Line]]:
        sections: dict[str, list[Line]] = {}
        current: list[Line] = []
        for number, raw in enumerate(text.splitlines(), start=1):
            words = raw.split("#", 1)[0].replace("(", " ( ").replace(")", " ) ").split()
            if words and words[0].startswith(":"):
                current = sections.setdefault(words[0][1:].lower(), [])
                words = words[1:]
            if words:
                current.append((number, words))
        return sections

    def parse(self) -> AsfFile:
        try:
            return self._parse()
        except (ValueError, IndexError, KeyError) as error:
            raise self._error(f"is damaged ({error})") from error

    def _error(self, what: str) -> FormatError:
        return FormatError(what, where=f"{self.where}, line {self.line}" if self.line else self.where)

    def _lines(self, section: str) -> Iterator[list[str]]:
        if section not in self.sections:
            raise self._error(f"has no :{section} section")
        for number, words in self.sections[section]:
            self.line = number
            yield words
        self.line = 0

    def _parse(self) -> AsfFile:
        degrees = self._units()
        root, position, orientation = self._root()
        bones = self._bones()
        parents = self._hierarchy(bones)
        skeleton = _skeleton_of(bones, parents, root, self.metres, self.where)
        return AsfFile(self.where, self.metres, degrees, bones, parents, root, position, orientation, skeleton)

    def _units(self) -> bool:
        units = {words[0].lower(): words[1] for words in self._lines("units")} if "units" in self.sections else {}
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
        bone = AsfBone(_ROOT, np.zeros(3), 0.0, rot.identity(), order, channels)
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
                if bone.name in bones or bone.name == _ROOT:
                    raise self._error(f"repeats the bone {bone.name!r}")
                bones[bone.name] = bone
            else:
                fields[keyword] = (self.line, words[1:])
        if not bones:
            raise self._error("has no bones")
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
                if name != _ROOT and name not in bones:
                    raise self._error(f"names the unknown bone {name!r} in its hierarchy")
            for child in words[1:]:
                if child in parents or child == _ROOT:
                    raise self._error(f"gives {child!r} a second parent")
                parents[child] = words[0]
        return parents


def fixed_axis_rotation(angles: Array, order: str) -> Array:
    """Return rotations by angles (..., n) about fixed axes, the first letter of `order` first, radians."""
    return rot.from_euler(angles[..., ::-1], order[::-1])


def _skeleton_of(
    bones: dict[str, AsfBone], parents: dict[str, str], root: AsfBone, metres: float, where: str
) -> Skeleton:
    order = _parents_first(parents, where)
    kept = [name for name in order if name in JOINT_NAMES or any(c[0] == "r" for c in bones[name].channels)]
    if set(kept) <= set(JOINT_NAMES):
        kept.sort(key=JOINT_NAMES.index)
    kept = [_ROOT, *kept]
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
    """Return the nearest kept ancestor and the offset from its joint, over the bones left out between them."""
    offset = np.zeros(3)
    ancestor = parents[name]
    while ancestor != _ROOT:
        offset = offset + bones[ancestor].direction * bones[ancestor].length
        if ancestor in kept:
            break
        ancestor = parents[ancestor]
    return ancestor, offset


def _parents_first(parents: dict[str, str], where: str) -> list[str]:
    order: list[str] = []
    waiting = list(parents)
    while waiting:
        ready = [name for name in waiting if parents[name] == _ROOT or parents[name] in order]
        if not ready:
            raise FormatError(f"has bones that do not hang on the root: {', '.join(waiting[:5])}", where=where)
        order.append(ready[0])
        waiting.remove(ready[0])
    return order


def _angle_order(bone: AsfBone) -> str:
    """Return the joint's axes in `rotations.from_euler` order: fixed axes in reverse."""
    axes = {channel[1].upper() for channel in bone.channels if channel[0] == "r"}
    return "".join(axis for axis in reversed(bone.axis_order) if axis in axes)


# --- AMC -----------------------------------------------------------------------------------------------------------

_NAMED = re.compile(rb"\n[ \t]*([A-Za-z][^\s]*)")


def read_amc(path: Path | str, skeleton: AsfFile | Path | str, fps: float = CMU_FPS) -> Motion:
    """Return the motion of an AMC file on the skeleton of its ASF file (given as read, or by path).

    AMC files do not store their rate; CMU's is 120 Hz. Degrees of freedom that a frame's first line layout lacks
    are zero.

    Raises:
        FormatError: not an AMC file, damaged, or of another skeleton; names file and line.
    """
    asf = skeleton if isinstance(skeleton, AsfFile) else read_asf_file(skeleton)
    return parse_amc(read_bytes(path), str(path), asf, fps)


def parse_amc(content: bytes, where: str, asf: AsfFile, fps: float = CMU_FPS) -> Motion:
    """Return the motion held in the bytes of an AMC file; `where` names it in errors."""
    content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    start = _first_frame(content, where)
    degrees = asf.degrees
    header = content[:start].upper()
    if b":RADIANS" in header:
        degrees = False
    elif b":DEGREES" in header:
        degrees = True
    layout = _layout(content[start:], where, asf, header.count(b"\n"))
    values = _values(content[start:], layout)
    if values is None:
        raise _first_fault(content[start:], where, layout, header.count(b"\n"))
    return _motion(values, layout, asf, degrees, fps, Path(where).stem)


def _first_frame(content: bytes, where: str) -> int:
    match = re.search(rb"(?m)^[ \t]*\d+[ \t]*\n[ \t]*[A-Za-z]", content)
    if match is None or b"\x00" in content[:4096]:
        raise FormatError("is not an AMC motion (no numbered frames)", where=where)
    return match.start()


def _layout(body: bytes, where: str, asf: AsfFile, line: int) -> list[AsfBone]:
    """Return the bones of the first frame in its order, checked against the skeleton."""
    layout: list[AsfBone] = []
    for number, raw in enumerate(body[: 1 << 16].split(b"\n")[1:], start=line + 2):
        words = raw.decode("latin-1").split()
        if len(words) == 1 and words[0].isdigit():
            break
        if not words:
            continue
        bone = asf.root if words[0] == _ROOT else asf.bones.get(words[0])
        place = f"{where}, line {number}"
        if bone is None:
            raise FormatError(
                f"moves the bone {words[0]!r}, which {asf.path} does not have",
                where=place,
                advice="give the skeleton file that belongs to this motion",
            )
        if len(words) - 1 != len(bone.channels):
            raise FormatError(
                f"has {len(words) - 1} values for {words[0]!r}, {asf.path} says {len(bone.channels)}", where=place
            )
        if bone in layout:
            raise FormatError(f"repeats the bone {words[0]!r} in one frame", where=place)
        layout.append(bone)
    if asf.root not in layout:
        raise FormatError("has no root in its first frame", where=where)
    return layout


def _values(body: bytes, layout: list[AsfBone]) -> Array | None:
    """Return (F, D) values in the layout's order, or None when any frame departs from the layout."""
    names = [bone.name.encode() for bone in layout]
    body = b"\n" + body
    found = _NAMED.findall(body)
    frames = len(found) // len(names)
    if frames == 0 or found != names * frames:
        return None
    width = 1 + sum(len(bone.channels) for bone in layout)
    table = parse_numbers(_NAMED.sub(b"\n", body))
    if table is None or table.size != frames * width:
        return None
    table = table.reshape(frames, width)
    counted = np.array_equal(table[:, 0], table[0, 0] + np.arange(frames))
    return table[:, 1:] if counted and np.all(np.isfinite(table)) else None


def _first_fault(body: bytes, where: str, layout: list[AsfBone], line: int) -> FormatError:
    """Return the error that names the first line at which an AMC file departs from its first frame."""
    expected = [[""]] + [[bone.name, *bone.channels] for bone in layout]
    step = -1
    number = line
    for number, raw in enumerate(body.split(b"\n"), start=line + 1):
        words = raw.decode("latin-1").split()
        if not words:
            continue
        step = (step + 1) % len(expected)
        fault = _line_fault(words, expected[step])
        if fault:
            return FormatError(fault, where=f"{where}, line {number}")
    what = "ends within a frame" if step != len(expected) - 1 else "has frames out of sequence"
    return FormatError(what, where=f"{where}, line {number}", advice="the file is cut off or damaged")


def _line_fault(words: list[str], expected: list[str]) -> str:
    if not expected[0]:
        return "" if len(words) == 1 and words[0].isdigit() else f"expected a frame number, found {words[0]!r}"
    if words[0] != expected[0]:
        return f"expected the values of {expected[0]!r}, found {words[0]!r}"
    if len(words) != len(expected):
        return f"expected {len(expected) - 1} values of {expected[0]!r}, found {len(words) - 1}"
    for word in words[1:]:
        try:
            if not np.isfinite(float(word)):
                return f"has a value of {expected[0]!r} that is not finite"
        except ValueError:
            return f"{word!r} is not a number"
    return ""


def _motion(values: Array, layout: list[AsfBone], asf: AsfFile, degrees: bool, fps: float, name: str) -> Motion:
    skeleton = asf.skeleton
    rotations = rot.identity((len(values), len(skeleton)))
    positions = np.tile(asf.root_position, (len(values), 1))
    factor = np.pi / 180.0 if degrees else 1.0
    ends = np.cumsum([0, *(len(bone.channels) for bone in layout)])
    for bone, (start, stop) in zip(layout, pairwise(ends), strict=True):
        columns = dict(zip(bone.channels, values[:, start:stop].T, strict=True))
        if bone.name in skeleton.names:
            rotations[:, skeleton.index(bone.name)] = _bone_rotation(bone, columns, factor)
        if bone is asf.root:
            for axis, channel in enumerate(("tx", "ty", "tz")):
                positions[:, axis] += columns.get(channel, 0.0)
    rotations[:, 0] = rot.multiply(rotations[:, 0], asf.root_orientation)
    return Motion(name, fps, skeleton, rot.continuous(rotations), positions * asf.metres_per_unit)


def _bone_rotation(bone: AsfBone, columns: dict[str, Array], factor: float) -> Array:
    order = [axis for axis in bone.axis_order if f"r{axis.lower()}" in columns]
    if not order:
        return rot.identity()
    angles = np.stack([columns[f"r{axis.lower()}"] for axis in order], axis=-1) * factor
    turned = fixed_axis_rotation(angles, "".join(order))
    return rot.multiply(rot.multiply(bone.axis, turned), rot.conjugate(bone.axis))
