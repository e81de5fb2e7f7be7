"""BVH motion files: reader for every channel layout, and writer.

A joint's position channels replace its OFFSET, rotations are multiplied in the order of the channels (a file with
Zrotation Xrotation Yrotation means Rz Rx Ry), angles are degrees, Y is up.
"""

import math
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...body.motion import LEAST_FPS, MOST_FPS, Motion
from ...body.skeleton import MOST_JOINTS, Skeleton
from ...body.source_motion import SourceMotion
from ...errors import FormatError
from ...geometry import rotations as rot
from ...geometry.arrays import Array, IntArray, Mask
from ...system.files import atomic_path, read_bytes
from ..unique_names import unique_names
from .numbers import check_pose_bytes, parse_numbers

# metres of one unit of a file; "cmu" is the unit of the CMU database's own files (inches / 0.45)
UNITS: dict[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048, "cmu": 0.0254 / 0.45}
WRITTEN_ORDER = "ZXY"
_CHANNELS = frozenset(axis + kind for axis in "xyz" for kind in ("position", "rotation"))
_LONGEST_LIMB_M = 1.25  # pelvis to finger tips of an adult; decides between units, which lie a factor of two apart
_ANGLE_JUMP_DEG = 150.0  # between frames; the two forms of one Euler rotation lie 180 or 360 degrees apart
_BLOCK = 1 << 17  # poses of joints that are computed at once
_STILL = 1e-4  # position channels that move a joint by less than this (file units) only repeat its offset


@dataclass
class _Joint:
    name: str
    parent: int
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    tip: tuple[float, ...] = (0.0, 0.0, 0.0)
    channels: list[str] = field(default_factory=list)


def read_bvh(content: Path | str | bytes, name: str = "", unit: str = "auto") -> SourceMotion:
    """Return the motion of a BVH file, in metres.

    Args:
        content: path, or the bytes of a file.
        name: clip name; for bytes also the file's name in messages (a path names itself).
        unit: one of UNITS, or "auto" to take the one that makes the body most nearly man-sized.

    Frames with "nan" keep it (see `SourceMotion.finite_frames`). A declared frame count that differs from the rows
    present is noted, not refused, as long as the last row is whole.

    Raises:
        FormatError: not a BVH file, damaged or cut off; names file and line.
    """
    if isinstance(content, bytes):
        where, data = name or "BVH data", content
    else:
        where, data = str(content), read_bytes(content)
    if unit != "auto" and unit not in UNITS:
        raise FormatError(f"{unit!r} is no unit", where=where, advice="units: auto, " + ", ".join(UNITS))
    header, motion, line = _split(data, where)
    joints = _HierarchyParser(header, where).parse()
    rows, fps, notes = _read_motion(motion, sum(len(j.channels) for j in joints), where, line)
    check_pose_bytes(len(rows), len(joints), len(data), where)
    return _assemble(joints, rows, fps, unit, name or Path(where).stem, where, notes)


def _split(data: bytes, where: str) -> tuple[str, bytes, int]:
    """Return hierarchy text, motion bytes and the line number of the MOTION line."""
    data = data.removeprefix(b"\xef\xbb\xbf")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if b"\x00" in data[:4096] or not data[:4096].lstrip().upper().startswith(b"HIERARCHY"):
        raise FormatError("is not a BVH file (it does not begin with HIERARCHY)", where=where)
    match = re.search(rb"(?mi)^[ \t]*MOTION[ \t]*$", data)
    if match is None:
        lines = data.count(b"\n") + 1
        raise FormatError("has no MOTION section", where=f"{where}, line {lines}", advice="the file is cut off")
    line = data.count(b"\n", 0, match.start()) + 1
    return data[: match.start()].decode("utf-8", errors="replace"), data[match.end() :], line


class _HierarchyParser:
    def __init__(self, text: str, where: str) -> None:
        self.where = where
        self.lines = text.replace("{", "\n{\x01").replace("}", "\n\x01}").split("\n")
        self.joints: list[_Joint] = []
        self.stack: list[int] = []
        self.number = 0

    def _error(self, what: str) -> FormatError:
        return FormatError(what, where=f"{self.where}, line {self.number}", advice="the file is damaged")

    def parse(self) -> list[_Joint]:
        opened: int | None = None
        end_site = -2  # on the stack in place of a joint
        self.number = 1
        first = True
        for piece in self.lines:
            # braces were given lines of their own, marked so that they do not count
            own_line = "\x01" in piece
            self.number += 0 if first or own_line else 1
            first = False
            brace, text = ("{", piece[2:]) if piece.startswith("{\x01") else ("", piece)
            if brace:
                if opened is None:
                    raise self._error("has a '{' that belongs to no joint")
                self.stack.append(opened)
                opened = None
            if text.startswith("\x01}"):
                if not self.stack:
                    raise self._error("closes more joints than it opens")
                self.stack.pop()
                text = text[2:]
            words = text.split()
            if not words:
                continue
            keyword = words[0].upper()
            if keyword in ("ROOT", "JOINT"):
                opened = self._open(" ".join(words[1:]))
            elif keyword == "END":
                if not self.stack or self.stack[-1] == end_site:
                    raise self._error("has an end site outside of a joint")
                opened = end_site
            elif keyword == "OFFSET":
                self._offset(words[1:])
            elif keyword == "CHANNELS":
                self._channels(words[1:])
            elif keyword != "HIERARCHY":
                raise self._error(f"has the unknown keyword {words[0][:40]!r}")
        if self.stack or not self.joints:
            raise self._error("has a hierarchy that is not complete")
        return self.joints

    def _open(self, name: str) -> int:
        if not name:
            raise self._error("has a joint without a name")
        if len(self.joints) == MOST_JOINTS:
            raise self._error(f"has more than {MOST_JOINTS} joints")
        parent = self.stack[-1] if self.stack else -1
        if parent == -2 or (parent == -1) != (len(self.joints) == 0):
            raise self._error(f"has the joint {name!r} outside of the root's hierarchy")
        self.joints.append(_Joint(name, parent))
        return len(self.joints) - 1

    def _offset(self, words: list[str]) -> None:
        try:
            offset = tuple(map(float, words))
        except ValueError:
            raise self._error(f"has an OFFSET that is no number: {' '.join(words)[:60]}") from None
        if len(offset) != 3 or not all(map(math.isfinite, offset)) or not self.stack:
            raise self._error("needs three finite numbers after OFFSET, inside a joint")
        if self.stack[-1] >= 0:
            self.joints[self.stack[-1]].offset = offset
        else:
            self.joints[self.stack[-2]].tip = offset

    def _channels(self, words: list[str]) -> None:
        channels = [word.lower() for word in words[1:]]
        known = all(channel in _CHANNELS for channel in channels)
        if not words or words[0] != str(len(channels)) or not known or len(set(channels)) != len(channels):
            raise self._error(f"has unknown channels: {' '.join(words)[:80]}")
        if not self.stack or self.stack[-1] < 0:
            raise self._error("has CHANNELS outside of a joint")
        self.joints[self.stack[-1]].channels = channels


def _read_motion(block: bytes, width: int, where: str, line: int) -> tuple[Array, float, list[str]]:
    """Return the rows (F, width), the frame rate and notes."""
    match = re.match(rb"\s*Frames:?[ \t]*(\S+)[ \t]*\n\s*Frame[ \t]*Time:?[ \t]*(\S+)[ \t]*(?:\n|$)", block, re.I)
    place = f"{where}, line {line}"
    try:
        declared, interval = (int(match[1]), float(match[2])) if match else (0, float("nan"))
    except ValueError:
        declared, interval = 0, float("nan")
    if match is None or not 1.0 / MOST_FPS <= interval <= 1.0 / LEAST_FPS:
        raise FormatError("needs 'Frames:' and a 'Frame Time:' from 0.0005 to 1 s after MOTION", where=place)
    if width == 0:
        raise FormatError("has no channels", where=where)
    body = block[match.end() :]
    numbers = parse_numbers(body)
    if numbers is None or numbers.size % width or np.any(np.isinf(numbers)):
        raise _first_fault(body, width, where, line + block.count(b"\n", 0, match.end()))
    rows = numbers.reshape(-1, width)
    if len(rows) == 0:
        raise FormatError("has no frames", where=place)
    notes = [] if len(rows) == declared else [f"declares {declared} frames, has {len(rows)}"]
    fps = 1.0 / interval
    return rows, float(round(fps)) if abs(fps - round(fps)) < 0.01 else fps, notes


def _first_fault(body: bytes, width: int, where: str, line: int) -> FormatError:
    """Return the error for the first bad row; rows may be broken over lines."""
    seen = 0
    for number, raw in enumerate(body.split(b"\n"), start=line):
        for word in raw.split():
            seen += 1
            if re.fullmatch(rb"[-+]?((\d+(\.\d*)?|\.\d+)(e[-+]?\d+)?|nan(\(\w*\))?)", word, re.I) is None:
                text = word[:30].decode("latin-1")
                return FormatError(f"{text!r} is not a finite number", where=f"{where}, line {number}")
        if raw.split() and seen % width and len(raw.split()) not in (seen, seen % width, width):
            break
    last = line + body.rstrip().count(b"\n")
    return FormatError(
        f"has {seen % width or width} of {width} values in its last row",
        where=f"{where}, line {last}",
        advice="the file is cut off or a value is missing",
    )


def _assemble(
    joints: list[_Joint], rows: Array, fps: float, unit: str, name: str, where: str, notes: list[str]
) -> SourceMotion:
    channels = [(index, channel) for index, joint in enumerate(joints) for channel in joint.channels]
    orders = ["".join(c[0].upper() for c in joint.channels if c.endswith("rotation")) for joint in joints]
    offsets = np.array([joint.offset for joint in joints])
    tips = np.array([joint.tip for joint in joints])
    parents = np.array([joint.parent for joint in joints], dtype=np.int64)
    translations = _translations(channels, rows, offsets)
    metres = UNITS[unit] if unit != "auto" else _likely_unit(parents, offsets, tips)
    for path in translations.values():
        path *= metres
    rotations, angle_jumps = _turns(channels, orders, rows)
    return SourceMotion(
        name=name,
        where=where,
        fps=fps,
        names=unique_names([joint.name for joint in joints]),
        parents=parents,
        offsets_m=offsets * metres,
        tips_m=tips * metres,
        rotations=rotations,
        translations_m=translations,
        euler_orders=tuple(orders),
        metres_per_unit=metres,
        angle_jumps=angle_jumps,
        notes=tuple(notes),
    )


def _turns(channels: list[tuple[int, str]], orders: list[str], rows: Array) -> tuple[Array, Mask]:
    """Return rotations (F, J, 4) and jumps (F,), computed block by block.

    All at once takes several times their memory. Joints with the same order of channels are computed together.
    """
    rotations, jumps = np.empty((len(rows), len(orders), 4)), np.zeros(len(rows), dtype=np.bool_)
    columns: list[list[int]] = [[] for _ in orders]
    for column, (joint, channel) in enumerate(channels):
        if channel.endswith("rotation"):
            columns[joint].append(column)
    turning = [column for own in columns for column in own]
    groups = [[joint for joint, own in enumerate(orders) if own == order] for order in set(orders) - {""}]
    step = max(_BLOCK // len(orders), 1)
    for start in range(0, len(rows), step):
        block = rows[start : start + step]
        turned = rot.identity((len(block), len(orders)))
        for joints in groups:
            angles = block[:, [columns[joint] for joint in joints]]
            turned[:, joints] = rot.from_euler(np.radians(angles), orders[joints[0]])
        before = max(start - 1, 0)  # the frame that the block goes on from
        whole = rot.continuous(np.concatenate((rotations[before:start], turned)))
        rotations[start : start + step] = whole[start - before :]
        steps = np.abs(np.diff(rows[before : start + step, turning], axis=0))
        jumps[before + 1 : start + step] = np.any(steps > _ANGLE_JUMP_DEG, axis=1)
    return rotations, jumps


def _translations(channels: list[tuple[int, str]], rows: Array, offsets: Array) -> dict[int, Array]:
    """Return the paths (F, 3), file units, of joints moved by position channels.

    Those of other joints only repeat an offset, which they write into `offsets`.
    """
    paths = {0: np.tile(offsets[0], (len(rows), 1))}
    columns = [c for c, (_, channel) in enumerate(channels) if channel.endswith("position")]
    values = rows[:, columns]
    lowest, highest = np.min(values, axis=0), np.max(values, axis=0)
    moving = {channels[c][0] for c in np.array(columns)[~(highest - lowest <= _STILL)]}  # NaN counts as moving
    for value, column in zip(values.T, columns, strict=True):
        joint, axis = channels[column][0], "xyz".index(channels[column][1][0])
        if joint in moving or joint == 0:
            paths.setdefault(joint, np.tile(offsets[joint], (len(rows), 1)))[:, axis] = value
        else:
            offsets[joint, axis] = value[0]
    return paths


def _likely_unit(parents: IntArray, offsets: Array, tips: Array) -> float:
    """Return the unit that makes the longest chain nearest to an adult's."""
    children = np.bincount(parents[parents >= 0], minlength=len(parents))
    reach = np.zeros(len(parents))
    for joint in range(1, len(parents)):
        above = parents[joint]
        # what lies above the first branching is where the body stands, not the body
        anatomical = reach[above] > 0.0 or children[above] > 1
        reach[joint] = reach[above] + np.linalg.norm(offsets[joint]) if anatomical else 0.0
    longest = float(np.max(reach + np.linalg.norm(tips, axis=1)))
    if longest <= 0.0:
        return 1.0
    return min(UNITS.values(), key=lambda metres: abs(np.log(longest * metres / _LONGEST_LIMB_M)))


def write_bvh(motion: Motion, path: Path | str, units: str = "m", decimals: int = 7) -> None:
    """Write a motion with its skeleton's joint names, Y up.

    The root has six channels, every other joint three, rotations in the order ZXY (Rz Rx Ry).

    Args:
        decimals: of angles in degrees and of the root's path in `units`; fewer make smaller files.

    Raises:
        FormatError: unknown unit, or the file cannot be written.
    """
    if units not in UNITS:
        raise FormatError(f"{units!r} is no unit", where=str(path), advice="units: " + ", ".join(UNITS))
    scale = 1.0 / UNITS[units]
    order = _depth_first(motion.skeleton)
    angles = np.degrees(rot.to_euler(motion.rotations[:, order], WRITTEN_ORDER))
    rows = np.concatenate((motion.root_positions_m * scale, angles.reshape(motion.frames, -1)), axis=1)
    rows = np.round(rows, decimals) + 0.0  # -0.0 becomes 0.0: files do not depend on the last bit of a computation
    head = [
        "HIERARCHY",
        *_joint_lines(motion.skeleton, 0, "", scale),
        "MOTION",
        f"Frames: {motion.frames}",
        f"Frame Time: {1.0 / motion.fps:.9f}",
    ]
    row_format = " ".join([f"%.{decimals}f"] * rows.shape[1])
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.write("\n".join(head) + "\n")
        file.writelines(row_format % tuple(row) + "\n" for row in rows.tolist())


def _children(skeleton: Skeleton, joint: int) -> list[int]:
    return [int(child) for child in np.flatnonzero(skeleton.parents == joint)]


def _depth_first(skeleton: Skeleton, joint: int = 0) -> list[int]:
    return [joint, *(below for child in _children(skeleton, joint) for below in _depth_first(skeleton, child))]


def _joint_lines(skeleton: Skeleton, joint: int, indent: str, scale: float) -> list[str]:
    def offset(vector: Array) -> str:
        return "OFFSET " + " ".join(f"{value * scale:.7f}" for value in vector)

    rotations = " ".join(f"{axis}rotation" for axis in WRITTEN_ORDER)
    channels = f"3 {rotations}" if joint else f"6 Xposition Yposition Zposition {rotations}"
    inner = indent + "  "
    lines = [
        f"{indent}{'JOINT' if joint else 'ROOT'} {skeleton.names[joint]}",
        f"{indent}{{",
        inner + offset(skeleton.offsets_m[joint]),
        f"{inner}CHANNELS {channels}",
    ]
    children = _children(skeleton, joint)
    for child in children:
        lines += _joint_lines(skeleton, child, inner, scale)
    if not children:
        lines += [f"{inner}End Site", f"{inner}{{", f"{inner}  " + offset(skeleton.tips_m[joint]), f"{inner}}}"]
    return [*lines, f"{indent}}}"]
