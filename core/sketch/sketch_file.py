"""Sketches: keyframed controls of one body, and their CSV file.

The file has comment lines with "#", one of which states "fps=...", then the header `control,frame,x,y,z` and one row
per key in any order: a joint of the standard skeleton, a frame, and a position in metres, y up.
"""

import csv
import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from ..body.motion import LEAST_FPS, MOST_FPS
from ..body.standard_skeleton import JOINT_NAMES
from ..errors import FormatError
from ..formats.markers.reader_parts import numbers_of
from ..geometry import rotations as rot
from ..geometry.arrays import Array, packed, unpacked
from ..system.file_content import decode_text
from ..system.files import read_bytes
from ..system.schema import About, Via
from .key_interpolation import curve_positions

FEET = ("lfoot", "rfoot", "ltoes", "rtoes")
_HEADER = ("control", "frame", "x", "y", "z")
_ADVICE = "columns must be control,frame,x,y,z in metres, and a comment line must state fps=..."


@dataclass(frozen=True)
class SketchLimits:
    """Limits of sketches."""

    most_frames: int = 20_000  # frames between the first and the last key
    farthest_m: float = 1000.0
    latest_frame: float = 1e9
    upright: float = 0.7  # smallest cosine between the vertical and the line from feet to hips of an upright body
    ankle_m: float = 0.08  # height of a standing foot's ankle


LIMITS = SketchLimits()


@dataclass(frozen=True)
class Control:
    """A joint with K keyframes."""

    joint: Annotated[str, About("joint of the standard skeleton")]
    frames: Annotated[Array, About("whole frame numbers, ascending; two may be equal", shape=(None,), fewest=1)]
    positions_m: Annotated[Array, About("world positions of the joint", "m", shape=(None, 3), fewest=1)]
    # drawn curve (S, 3) at each frame from the first key to the last; None for Blender's default curve
    drawn_m: Annotated[
        Array | None, About("drawn curve", "m"), Via(str, lambda text, _: unpacked(text).reshape(-1, 3), packed)
    ] = None
    height_is_free: Annotated[bool, About("whether the height comes from the database's motion, not from the keys")] = (
        False
    )

    def distinct_keys(self) -> tuple[Array, Array]:
        """Return frames (K,) and positions (K, 3); keys in the same frame are averaged."""
        frames, key = np.unique(self.frames, return_inverse=True)
        sums = np.zeros((len(frames), 3))
        np.add.at(sums, key, self.positions_m)
        return frames, sums / np.bincount(key)[:, None]

    def curve(self, at: Array) -> Array:
        """Return positions (F, 3) at frames (F,) on the curve through the keys.

        The curve passes through the mean of keys in the same frame. A drawn curve is bent towards keys that lie off it,
        such as one that is being dragged.
        """
        keyed, positions_m = self.distinct_keys()
        if self.drawn_m is None:
            return curve_positions(keyed, positions_m, at)
        drawn = self._drawn(self.drawn_m, at)
        return drawn + curve_positions(keyed, positions_m - self._drawn(self.drawn_m, keyed), at)

    def _drawn(self, points_m: Array, at: Array) -> Array:
        frames = self.frames[0] + np.arange(len(points_m))
        return np.stack([np.interp(at, frames, axis) for axis in points_m.T], axis=1)


@dataclass(frozen=True)
class Sketch:
    """Controls of one body, with frames at a rate of `fps`."""

    name: Annotated[str, About("name")]
    fps: Annotated[float, About("frame rate", "Hz", above=0.0)]
    controls: Annotated[tuple[Control, ...], About("controls")]

    @property
    def frames(self) -> Array:
        """All frames (F,) from the first key to the last."""
        first = min(control.frames[0] for control in self.controls)
        last = max(control.frames[-1] for control in self.controls)
        return np.arange(first, last + 1.0)


def upright_from(sketch: Sketch) -> Array | None:
    """Return the rotation (4,) that puts the hips of a sketch above its feet.

    The result is None if the body is upright already, or if the sketch does not control hips and feet.
    """
    means = {control.joint: control.positions_m.mean(axis=0) for control in sketch.controls}
    feet = [means[name] for name in FEET if name in means]
    if "root" not in means or not feet:
        return None
    leg = means["root"] - np.mean(feet, axis=0)
    return None if leg[1] > LIMITS.upright * np.linalg.norm(leg) else rot.between(leg, np.array([0.0, 1.0, 0.0]))


def tilted(sketch: Sketch, rotation: Array) -> Sketch:
    """Return the sketch rotated by a quaternion (4,) and placed on the floor."""
    turned = [rot.rotate(rotation, control.positions_m) for control in sketch.controls]
    down = np.array([0.0, min(points[:, 1].min() for points in turned) - LIMITS.ankle_m, 0.0])
    controls = []
    for control, points in zip(sketch.controls, turned, strict=True):
        drawn_m = None if control.drawn_m is None else rot.rotate(rotation, control.drawn_m) - down
        controls.append(replace(control, positions_m=points - down, drawn_m=drawn_m))
    return replace(sketch, controls=tuple(controls))


def read_sketch(path: Path | str) -> Sketch:
    """Return the sketch from a CSV file; its layout is described in the module.

    Raises:
        FormatError: The file is not a sketch, or is damaged; the message names file and line.
    """
    where = str(path)
    text = decode_text(read_bytes(path), where, "sketch")
    if "\x00" in text:
        raise FormatError("is not a text file", where=where, advice="save the sketch as CSV")
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    rows = [(number, line) for number, line in lines if not line.startswith("#")]
    keys: dict[str, list[list[float]]] = {}
    if not rows or tuple(cell.strip().lower() for cell in rows[0][1].split(",")) != _HEADER:
        raise FormatError("is not a sketch", where=where, advice=_ADVICE)
    for number, line in rows[1:]:
        joint, key = _key(line, f"{where}, line {number}")
        keys.setdefault(joint, []).append(key)
    if not keys:
        raise FormatError("has no keys", where=where, advice="key at least one control")
    fps = _rate("\n".join(line for _, line in lines if line.startswith("#")), where)
    controls = []
    for joint, unsorted in keys.items():
        table = np.array(sorted(unsorted, key=lambda key: key[0]))
        controls.append(Control(joint, table[:, 0], table[:, 1:]))
    sketch = Sketch(Path(path).stem, fps, tuple(controls))
    first, last = (pick(pick(control.frames) for control in controls) for pick in (min, max))
    if last - first >= LIMITS.most_frames:
        message = f"has keys in frames {first:.0f} to {last:.0f}, but may span at most {LIMITS.most_frames} frames"
        raise FormatError(message, where=where, advice="split the sketch")
    return sketch


def _key(line: str, where: str) -> tuple[str, list[float]]:
    """Return a row's joint, and its frame and position as one list."""
    try:
        cells = next(csv.reader([line]))
    except csv.Error as error:
        raise FormatError(f"is not CSV ({error})", where=where, advice=_ADVICE) from error
    if len(cells) != len(_HEADER):
        raise FormatError(f"has {len(cells)} fields, not {len(_HEADER)}", where=where, advice=_ADVICE)
    joint = cells[0].strip()
    if joint not in JOINT_NAMES:
        raise FormatError(f"there is no joint {joint!r}", where=where, advice="choose from " + ", ".join(JOINT_NAMES))
    frame, *position = numbers_of(cells[1:], where)
    if not all(math.isfinite(value) for value in (frame, *position)) or frame != round(frame):
        raise FormatError("needs a whole frame number and a finite position", where=where, advice=_ADVICE)
    if max(abs(value) for value in position) > LIMITS.farthest_m or abs(frame) > LIMITS.latest_frame:
        message = f"has a coordinate beyond {LIMITS.farthest_m:g} m or a frame beyond {LIMITS.latest_frame:g}"
        raise FormatError(message, where=where, advice="give positions in metres")
    return joint, [frame, *position]


def _rate(comments: str, where: str) -> float:
    stated = re.search(r"fps\s*=\s*([0-9.eE+-]+)", comments)
    (fps,) = numbers_of([stated.group(1)], where) if stated else (math.nan,)
    if not LEAST_FPS <= fps <= MOST_FPS:
        message = f"does not state a frame rate of {LEAST_FPS:g} to {MOST_FPS:g} Hz"
        raise FormatError(message, where=where, advice=_ADVICE)
    return fps
