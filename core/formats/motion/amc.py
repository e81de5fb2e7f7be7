"""Acclaim motion: AMC files, as written by the CMU Motion Capture Database.

Values are angles about fixed axes, in the bone's axis order, in a frame C that the ASF file gives for each bone: the
joint's rotation relative to rest is C R(values) C^-1.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from itertools import islice

import numpy as np

from ...body.motion import Motion
from ...errors import FormatError
from ...geometry import rotations as rot
from ...geometry.arrays import Array, Mask
from ...system.file_content import utf8_text, with_decimal_points
from .asf import ROOT, AsfBone, AsfFile, fixed_axis_rotation
from .number_parsing import angle_jumps, check_pose_bytes, parse_numbers

CMU_FPS = 120.0
_SPACE, _TAB, _NEWLINE = b" \t\n"


@dataclass(frozen=True)
class AmcValues:
    """Numbers in an AMC file.

    Args:
        layout: Bones of each frame, in the file's order.
        values: Values (F, D) in that order, in the file's units; NaN where the file says so.
        factor: Radians per unit of an angle.
    """

    layout: tuple[AsfBone, ...]
    values: Array
    factor: float

    @property
    def angle_jumps(self) -> Mask:
        """Frames (F,) with an angle far from that of the previous frame."""
        turning = [channel[0] == "r" for bone in self.layout for channel in bone.channels]
        return angle_jumps(np.degrees(self.values[:, turning] * self.factor))


def parse_amc_values(content: bytes, where: str, asf: AsfFile) -> AmcValues:
    """Return the numbers in the bytes of an AMC file; FormatError names file and line."""
    content = with_decimal_points(utf8_text(content, where, "AMC motion"))
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    start = _first_frame(content, where)
    header, body = content[:start].upper(), content[start:]
    degrees = b":RADIANS" not in header and (asf.degrees or b":DEGREES" in header)
    layout = _layout(body, where, asf, header.count(b"\n"))
    values = _values(body, layout)
    if values is None:  # indented, with blank lines, or damaged
        values = _values(_stripped(body), layout)
    if values is None:
        raise _first_fault(body, where, layout, header.count(b"\n"))
    check_pose_bytes(len(values), len(asf.skeleton), len(content), where)
    return AmcValues(tuple(layout), values, np.pi / 180.0 if degrees else 1.0)


def _stripped(body: bytes) -> bytes:
    """Return the lines without indentation or blank lines, one in memory at a time."""
    stripped = bytearray()
    for line in BytesIO(body):
        if words := line.strip():
            stripped += words + b"\n"
    return bytes(stripped)


def _first_frame(content: bytes, where: str) -> int:
    match = re.search(rb"(?m)^[ \t]*\d+[ \t]*\n[ \t]*[A-Za-z]", content)
    if match is None or b"\x00" in content[:4096]:
        raise FormatError("is not an AMC motion (no numbered frames)", where=where, advice="export it as AMC")
    return match.start()


def _layout(body: bytes, where: str, asf: AsfFile, line: int) -> list[AsfBone]:
    """Return the bones of the first frame in its order, checked against the skeleton."""
    layout: list[AsfBone] = []
    lines = islice(BytesIO(body[: 1 << 16]), 1, None)
    for number, raw in enumerate(lines, start=line + 2):
        words = raw.decode("latin-1").split()
        if len(words) == 1 and words[0].isdecimal():
            break
        if not words:
            continue
        bone = asf.root if words[0] == ROOT else asf.bones.get(words[0])
        place = f"{where}, line {number}"
        if bone is None:
            raise FormatError(
                f"moves the bone {words[0]!r}, which {asf.path} does not have",
                where=place,
                advice="give the skeleton file that belongs to this motion",
            )
        if len(words) - 1 != len(bone.channels):
            raise FormatError(
                f"has {len(words) - 1} values for {words[0]!r}, but {asf.path} defines {len(bone.channels)}",
                where=place,
                advice="give the skeleton file that belongs to this motion",
            )
        if any(bone is other for other in layout):
            raise FormatError(f"lists the bone {words[0]!r} twice in one frame", where=place, advice="export it again")
        layout.append(bone)
    if asf.root not in layout:
        raise FormatError("has no root in its first frame", where=where, advice="export it again")
    return layout


def _values(body: bytes, layout: list[AsfBone]) -> Array | None:
    """Return values (F, D) in the layout's order, or None if a frame differs from it.

    Every frame has the same names on the same lines, so each name is checked and blanked out in all frames at once.
    """
    text = np.frombuffer(body if body.endswith(b"\n") else body + b"\n", dtype=np.uint8)
    ends = np.flatnonzero(text == _NEWLINE)
    if len(ends) % (len(layout) + 1):
        return None
    lines = np.concatenate(([0], ends[:-1] + 1)).reshape(-1, len(layout) + 1)
    numbers = text.copy()
    for bone, starts in zip(layout, lines.T[1:], strict=True):
        name = np.frombuffer(bone.name.encode(), dtype=np.uint8)
        places = starts[:, None] + np.arange(len(name) + 1)
        if places[-1, -1] >= len(text):
            return None
        found = text[places]
        spaced = (found[:, -1] == _SPACE) | (found[:, -1] == _TAB) | (found[:, -1] == _NEWLINE)
        if not (np.array_equal(found[:, :-1], np.broadcast_to(name, found[:, :-1].shape)) and np.all(spaced)):
            return None
        numbers[places] = _SPACE
    width = 1 + sum(len(bone.channels) for bone in layout)
    table = parse_numbers(numbers.tobytes())
    if table is None or table.size != len(lines) * width or np.any(np.isinf(table)):
        return None
    table = table.reshape(len(lines), width)
    return table[:, 1:] if np.array_equal(table[:, 0], table[0, 0] + np.arange(len(lines))) else None


def _first_fault(body: bytes, where: str, layout: list[AsfBone], line: int) -> FormatError:
    """Return the error for the first line that differs from the first frame."""
    expected = [[""]] + [[bone.name, *bone.channels] for bone in layout]
    step = -1
    number = line
    for number, raw in enumerate(BytesIO(body), start=line + 1):
        words = raw.decode("latin-1").split()
        if not words:
            continue
        step = (step + 1) % len(expected)
        fault = _line_fault(words, expected[step])
        if fault:
            return FormatError(fault, where=f"{where}, line {number}", advice="repair this line, or export it again")
    what = "ends within a frame" if step != len(expected) - 1 else "has frames out of sequence"
    return FormatError(what, where=f"{where}, line {number}", advice="export it again")


def _line_fault(words: list[str], expected: list[str]) -> str:
    if not expected[0]:
        return "" if len(words) == 1 and words[0].isdecimal() else f"expected a frame number, found {words[0]!r}"
    if words[0] != expected[0]:
        return f"expected the values of {expected[0]!r}, found {words[0]!r}"
    if len(words) != len(expected):
        return f"expected {len(expected) - 1} values of {expected[0]!r}, found {len(words) - 1}"
    for word in words[1:]:
        try:
            if np.isinf(float(word)):
                return f"has a value of {expected[0]!r} that is not finite"
        except ValueError:
            return f"{word!r} is not a number"
    return ""


def amc_motion(table: AmcValues, asf: AsfFile, fps: float, name: str) -> Motion:
    """Return the motion from an AMC file's numbers on the skeleton of its ASF file.

    Args:
        fps: Frame rate, which AMC files do not store; CMU's is `CMU_FPS`.

    Raises:
        FormatError: A frame contains NaN, or a value is invalid in `Motion`.
    """
    skeleton, values = asf.skeleton, table.values
    rotations = rot.identity((len(values), len(skeleton)))
    positions = np.tile(asf.root_position, (len(values), 1))
    columns = _columns(table.layout)
    same: dict[str, list[AsfBone]] = {}  # bones with the same axes, which are computed together
    for bone in table.layout:
        if bone.name in skeleton.names and _turning_axes(bone):
            same.setdefault("".join(_turning_axes(bone)), []).append(bone)
    for axes, bones in same.items():
        angles = values.take([[columns[bone.name, f"r{axis.lower()}"] for axis in axes] for bone in bones], axis=1)
        turned = fixed_axis_rotation(angles * table.factor, axes)
        frames = np.array([bone.axis for bone in bones])
        joints = [skeleton.index(bone.name) for bone in bones]
        rotations[:, joints] = rot.multiply(rot.multiply(frames, turned), rot.conjugate(frames))
    for axis, channel in enumerate(("tx", "ty", "tz")):
        if (ROOT, channel) in columns:
            positions[:, axis] += values[:, columns[ROOT, channel]]
    rotations[:, 0] = rot.multiply(rotations[:, 0], asf.root_orientation)
    return Motion(name, fps, skeleton, rot.continuous(rotations), positions * asf.metres_per_unit)


def _columns(layout: Sequence[AsfBone]) -> dict[tuple[str, str], int]:
    """Return the column of each bone's channel in a frame's values."""
    return {key: column for column, key in enumerate((bone.name, each) for bone in layout for each in bone.channels)}


def _turning_axes(bone: AsfBone) -> list[str]:
    """Return the axes of the bone's angles in the order of rotation."""
    return [axis for axis in bone.axis_order if f"r{axis.lower()}" in bone.channels]
