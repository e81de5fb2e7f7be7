"""BVH motion files: reader for all channel layouts, and writer.

A joint's position channels replace its OFFSET; rotations are multiplied in the order of the channels (Zrotation
Xrotation Yrotation means Rz Rx Ry); angles are in degrees; Y is up.
"""

import math
import re
from pathlib import Path

import numpy as np

from ...body.motion import LEAST_FPS, MOST_FPS, Motion
from ...body.skeleton import Skeleton
from ...body.source_motion import SourceMotion
from ...errors import FormatError
from ...geometry import rotations as rot
from ...geometry.arrays import Array, IntArray, Mask
from ...system.file_content import decode_text, utf8_text, with_decimal_points
from ...system.files import atomic_path, read_bytes
from .bvh_hierarchy import BvhHierarchy, read_hierarchy
from .number_parsing import angle_jumps, check_pose_bytes, parse_table

# metres per unit; "cmu" is the unit of the CMU database's own files (inches / 0.45)
UNITS: dict[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048, "cmu": 0.0254 / 0.45}
WRITTEN_ORDER = "ZXY"
_WIDTH = "write one frame per line, with a value for each channel of the hierarchy"


def read_bvh(content: Path | str | bytes, name: str = "", unit: str = "auto") -> SourceMotion:
    """Return the motion of a BVH file, in metres.

    Args:
        content: Path or bytes of a file.
        name: Name of the clip; for bytes also the file name in messages.
        unit: One of UNITS, or "auto" for the one that makes the body closest to the size of an adult.

    Numbers written as "nan" stay NaN (see `SourceMotion.finite_frames`). If the frame count in the header differs from
    the number of rows, and the last row is complete, a note says so.

    Raises:
        FormatError: The file is not BVH, is damaged or cut off; names file and line.
    """
    if isinstance(content, bytes):
        where, data = name or "BVH data", content
    else:
        where, data = str(content), read_bytes(content)
    if unit != "auto" and unit not in UNITS:
        raise FormatError(f"{unit!r} is not a unit", where=where, advice="use one of auto, " + ", ".join(UNITS))
    header, motion, line = _split(data, where)
    hierarchy = read_hierarchy(header, where)
    rows, fps, notes = _read_motion(motion, hierarchy.width, where, line)
    check_pose_bytes(len(rows), len(hierarchy.names), len(data), where)
    return _assemble(hierarchy, rows, fps, unit, name or Path(where).stem, where, notes)


def _split(data: bytes, where: str) -> tuple[str, bytes, int]:
    """Return hierarchy text, motion bytes and the line number of the MOTION line."""
    data = utf8_text(data, where, "BVH file")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if b"\x00" in data[:4096] or not data[:4096].lstrip().upper().startswith(b"HIERARCHY"):
        raise FormatError(
            "is not a BVH file (it does not begin with HIERARCHY)", where=where, advice="export it as BVH"
        )
    match = re.search(rb"(?mi)^[ \t]*MOTION[ \t]*$", data)
    if match is None:
        lines = data.count(b"\n") + 1
        raise FormatError("has no MOTION section", where=f"{where}, line {lines}", advice="export it again")
    line = data.count(b"\n", 0, match.start()) + 1
    header, motion = (with_decimal_points(part) for part in (data[: match.start()], data[match.end() :]))
    return decode_text(header, where, "BVH file"), motion, line


def _read_motion(block: bytes, width: int, where: str, line: int) -> tuple[Array, float, list[str]]:
    """Return the rows (F, width), the frame rate and notes."""
    match = re.match(rb"\s*Frames:?[ \t]*(\S+)[ \t]*\n\s*Frame[ \t]*Time:?[ \t]*(\S+)[ \t]*(?:\n|$)", block, re.I)
    place = f"{where}, line {line}"
    try:
        declared, interval = (int(match[1]), float(match[2])) if match else (0, float("nan"))
    except ValueError:
        declared, interval = 0, float("nan")
    if match is None or not 1.0 / MOST_FPS <= interval <= 1.0 / LEAST_FPS:
        raise FormatError(
            "needs 'Frames:' and a 'Frame Time:' from 0.0005 to 1 s after MOTION",
            where=place,
            advice="correct these lines, or export the file again",
        )
    if width == 0:
        raise FormatError("has no channels", where=where, advice="export it with animation")
    body = block[match.end() :]
    numbers = parse_table(body)
    first = line + block.count(b"\n", 0, match.end())
    if numbers is None or np.any(np.isinf(numbers)):
        raise _first_word_that_is_no_number(body, f"{where}, line", first)
    if numbers.ndim < 2 or numbers.shape[1] != width:
        _check_lines(body, width, declared, f"{where}, line", first)
    rows = numbers.reshape(-1, width)
    if len(rows) == 0:
        raise FormatError("has no frames", where=place, advice="export it with animation")
    notes = [] if len(rows) == declared else [f"declares {declared} frames, but has {len(rows)}"]
    fps = 1.0 / interval
    return rows, float(round(fps)) if abs(fps - round(fps)) < 0.01 else fps, notes


def _first_word_that_is_no_number(body: bytes, place: str, line: int) -> FormatError:
    for number, raw in enumerate(body.split(b"\n"), start=line):
        for word in raw.split():
            if re.fullmatch(rb"[-+]?((\d+(\.\d*)?|\.\d+)(e[-+]?\d+)?|nan(\(\w*\))?)", word, re.I) is None:
                what = f"{word[:30].decode('latin-1')!r} is not a finite number"
                mixed = (
                    "write all numbers with decimal points" if b"," in word else "correct it, or export the file again"
                )
                return FormatError(what, where=f"{place} {number}", advice=mixed)
    return FormatError(
        "has a number that is too large",
        where=f"{place} {line} or below",
        advice="correct it, or export the file again",
    )


def _check_lines(body: bytes, width: int, declared: int, place: str, line: int) -> None:
    """Raise FormatError for the first line that has too few or too many values.

    Unless there are as many lines as frames, a frame may span several lines, and a line may hold several frames.
    """
    lines = [(number, len(raw.split())) for number, raw in enumerate(body.split(b"\n"), start=line)]
    lines = [(number, count) for number, count in lines if count]
    start, begun = 0, 0  # first line and number of values of an unfinished frame
    for index, (_, count) in enumerate(lines):
        start, begun = (start if begun else index), begun + count
        is_cut = index + 1 == len(lines) and count < width  # cut by the end of the file
        is_wrong = len(lines) == declared and count != width
        if (is_wrong or (begun > width and begun % width)) and not is_cut:
            what = f"has {lines[start][1]} of {width} values"
            raise FormatError(what, where=f"{place} {lines[start][0]}", advice=_WIDTH)
        begun %= width
    if begun:
        what, advice = f"has {begun} of {width} values in its last row", "complete the row, or export the file again"
        raise FormatError(what, where=f"{place} {lines[-1][0]}", advice=advice)


def _assemble(
    hierarchy: BvhHierarchy, rows: Array, fps: float, unit: str, name: str, where: str, notes: list[str]
) -> SourceMotion:
    offsets = hierarchy.offsets.copy()
    translations = _translations(hierarchy, rows, offsets)
    metres = UNITS[unit] if unit != "auto" else _likely_unit(hierarchy.parents, offsets, hierarchy.tips)
    for path in translations.values():
        path *= metres
    rotations, angle_jumps = _turns(hierarchy, rows)
    return SourceMotion(
        name=name,
        where=where,
        fps=fps,
        names=hierarchy.names,
        parents=hierarchy.parents,
        offsets_m=offsets * metres,
        tips_m=hierarchy.tips * metres,
        rotations=rotations,
        translations_m=translations,
        euler_orders=hierarchy.orders,
        metres_per_unit=metres,
        angle_jumps=angle_jumps,
        notes=tuple(notes),
    )


def _turns(hierarchy: BvhHierarchy, rows: Array, block: int = 1 << 17) -> tuple[Array, Mask]:
    """Return rotations (F, J, 4) and a mask (F,) of jumps in their angles.

    Args:
        block: Number of poses computed at once, because all together would need several times the result's memory.
    """
    joints = len(hierarchy.names)
    rotations, jumps = np.empty((len(rows), joints, 4)), np.zeros(len(rows), dtype=np.bool_)
    turning = np.concatenate([turn.columns.ravel() for turn in hierarchy.turns]) if hierarchy.turns else []
    step = max(block // joints, 1)
    for start in range(0, len(rows), step):
        part = rows[start : start + step]
        turned = rot.identity((len(part), joints))
        for turn in hierarchy.turns:
            angles = part.take(turn.columns, axis=1)
            turned[:, turn.joints] = rot.from_euler(np.radians(angles, out=angles), turn.order)
        before = max(start - 1, 0)  # last frame of the previous block
        whole = rot.continuous(np.concatenate((rotations[before:start], turned)))
        rotations[start : start + step] = whole[start - before :]
        jumps[start : start + step] = angle_jumps(rows[before : start + step, turning])[start - before :]
    return rotations, jumps


def _translations(hierarchy: BvhHierarchy, rows: Array, offsets: Array, still: float = 1e-4) -> dict[int, Array]:
    """Return the positions (F, 3) of joints that position channels move, in file units.

    Constant channels of other joints are their offsets and are written to `offsets`.

    Args:
        still: Range below which a channel counts as constant, file units.
    """
    columns, joints, axes = hierarchy.places.T
    values = rows.take(columns, axis=1)
    moving = ~(np.max(values, axis=0) - np.min(values, axis=0) <= still)  # NaN counts as moving
    leaving = np.zeros(len(offsets), dtype=np.bool_)
    leaving[[0, *joints[moving]]] = True
    moved = leaving[joints]
    offsets[joints[~moved], axes[~moved]] = values[0, ~moved]
    paths = {0: np.tile(offsets[0], (len(rows), 1))}
    for place in np.flatnonzero(moved):
        joint = int(joints[place])
        paths.setdefault(joint, np.tile(offsets[joint], (len(rows), 1)))[:, axes[place]] = values[:, place]
    return paths


def _likely_unit(parents: IntArray, offsets: Array, tips: Array, reach_m: float = 1.25) -> float:
    """Return the unit, in metres, that makes the longest chain of bones most like an adult's.

    Args:
        reach_m: Length from an adult's pelvis to the fingertips; rough, as units differ by at least a factor of two.
    """
    children = np.bincount(parents[parents >= 0], minlength=len(parents)).tolist()
    lengths = rot.lengths(offsets).tolist()
    reach = [0.0]
    for joint, above in enumerate(parents[1:].tolist(), start=1):
        # bones above the first branching are an offset from the floor, not part of the body
        anatomical = reach[above] > 0.0 or children[above] > 1
        reach.append(reach[above] + lengths[joint] if anatomical else 0.0)
    longest = float(np.max(np.array(reach) + rot.lengths(tips)))
    if longest <= 0.0:
        return 1.0
    return min(UNITS.values(), key=lambda metres: abs(math.log(longest * metres / reach_m)))


def write_bvh(motion: Motion, path: Path | str, units: str = "m", decimals: int = 7) -> None:
    """Write a motion with its skeleton's joint names, Y up.

    The root has six channels, every other joint three, rotations in the order ZXY (Rz Rx Ry).

    Args:
        decimals: Decimals of angles in degrees and of the root's position in `units`.

    Raises:
        FormatError: The unit is unknown, or the file cannot be written.
    """
    if units not in UNITS:
        raise FormatError(f"{units!r} is not a unit", where=str(path), advice="use one of " + ", ".join(UNITS))
    scale = 1.0 / UNITS[units]
    order = _depth_first(motion.skeleton)
    angles = np.degrees(rot.to_euler(motion.rotations[:, order], WRITTEN_ORDER))
    rows = np.concatenate((motion.root_positions_m * scale, angles.reshape(motion.frames, -1)), axis=1)
    rows = (
        np.round(rows, decimals) + 0.0
    )  # turn -0.0 into 0.0, so that files do not depend on the last bit of a computation
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
