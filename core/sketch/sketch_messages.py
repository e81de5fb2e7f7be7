"""Sketches and their solutions as JSON, exchanged between Blender and the worker."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..body.motion import Motion
from ..errors import SettingsError
from ..geometry.arrays import Array, packed, unpacked
from ..system.files import reading
from ..system.schema import Schema
from .sketch_file import Sketch
from .solve_sketch import SketchSettings, SketchSolution

_SKETCH = Schema(Sketch, "Sketch", "", SettingsError, "add the controls again")
_SETTINGS = Schema(SketchSettings, "Settings of a sketch", "", SettingsError, "set the sketch's settings again")


@dataclass(frozen=True)
class SolvedSketch:
    """Solution of a sketch as Blender needs it.

    Args:
        number: Number of the answered request.
        whole: False for the preview after an edit, which is a single frame.
        rotations: Parent-from-joint quaternions (F, J, 4) relative to rest; (0, J, 4) after an error.
        root_positions_m: Root positions (F, 3).
        unmet: Joint, frame, distance in metres and reason for each key that is not met.
        drawn_from: Names of the clips used.
        error: Reason why there is no solution; "" if there is one.
    """

    number: int
    whole: bool
    rotations: Array
    root_positions_m: Array
    unmet: tuple[tuple[str, int, float, str], ...] = ()
    drawn_from: tuple[str, ...] = ()
    error: str = ""


def sketch_from(table: Mapping[str, Any]) -> Sketch:
    """Return the sketch from `table_of(sketch)`; SettingsError if it is damaged."""
    with reading("sketch", SettingsError, "add the controls again"):
        sketch = _SKETCH.read(table, "sketch")
        for control in sketch.controls:
            keys, frames = len(control.frames), int(np.ptp(control.frames)) + 1
            if len(control.positions_m) != keys or (control.drawn_m is not None and len(control.drawn_m) != frames):
                raise ValueError(f"the arrays of control {control.joint} do not fit its {keys} keys in {frames} frames")
        return sketch


def settings_from(table: Mapping[str, Any]) -> SketchSettings:
    """Return the settings from `table_of(settings)`; SettingsError if they are damaged."""
    return _SETTINGS.read(table, "sketch")


def motion_table(motion: Motion, number: int) -> dict[str, Any]:
    """Return the message with a preview; arrays are float32 in base 64."""
    return {
        "number": number,
        "whole": False,
        "frames": motion.frames,
        "rotations": packed(motion.rotations),
        "root_positions_m": packed(motion.root_positions_m),
    }


def solution_table(solution: SketchSolution, number: int) -> dict[str, Any]:
    """Return the message with a solution."""
    return motion_table(solution.motion, number) | {
        "whole": True,
        "unmet": [[key.joint, key.frame, key.distance_m, key.reason] for key in solution.unmet],
        "drawn_from": list(solution.drawn_from),
    }


def solution_from(table: Mapping[str, Any]) -> SolvedSketch:
    """Return the solution from `solution_table`, or from {"number", "error"}."""
    frames = int(table.get("frames", 0))
    rotations = unpacked(table.get("rotations", ""))
    return SolvedSketch(
        number=int(table["number"]),
        whole=bool(table.get("whole", True)),
        rotations=rotations.reshape(frames, -1, 4) if frames else np.zeros((0, 1, 4)),
        root_positions_m=unpacked(table.get("root_positions_m", "")).reshape(frames, 3),
        unmet=tuple((str(j), int(f), float(d), str(r)) for j, f, d, r in table.get("unmet", ())),
        drawn_from=tuple(str(name) for name in table.get("drawn_from", ())),
        error=str(table.get("error", "")),
    )
