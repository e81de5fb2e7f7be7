"""Sketches and their solutions as JSON, exchanged between Blender and the worker."""

import base64
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..body.motion import Motion
from ..errors import SettingsError
from ..geometry.arrays import Array
from ..system.files import reading
from .sketch_file import Control, Sketch
from .solve_sketch import SketchSettings, SketchSolution


@dataclass(frozen=True)
class SolvedSketch:
    """Solution of a sketch as Blender needs it.

    Args:
        number: Number of the answered request.
        whole: False for the first picture of an edit, a single frame.
        rotations: Parent-from-joint quaternions (F, J, 4) relative to rest; (0, J, 4) after an error.
        root_positions_m: Root positions (F, 3).
        unmet: Joint, frame, distance in metres and reason of each key that is not met.
        drawn_from: Names of the clips used.
        error: Reason why there is no solution, "" if there is one.
    """

    number: int
    whole: bool
    rotations: Array
    root_positions_m: Array
    unmet: tuple[tuple[str, int, float, str], ...] = ()
    drawn_from: tuple[str, ...] = ()
    error: str = ""


def sketch_table(sketch: Sketch) -> dict[str, Any]:
    """Return a sketch as a JSON object."""
    return {"name": sketch.name, "fps": sketch.fps, "controls": [_control_table(each) for each in sketch.controls]}


def _control_table(control: Control) -> dict[str, Any]:
    table = {"joint": control.joint, "frames": control.frames.tolist(), "positions_m": control.positions_m.tolist()}
    if control.drawn_m is not None:
        table["drawn_m"] = _packed(control.drawn_m)
    if control.height_is_free:
        table["height_is_free"] = True
    return table


def sketch_from(table: Mapping[str, Any]) -> Sketch:
    """Return the sketch of `sketch_table`; SettingsError if it is damaged."""
    with reading("sketch", SettingsError, "add the controls again"):
        controls = tuple(_control_from(row) for row in table["controls"])
        return Sketch(str(table["name"]), float(table["fps"]), controls)


def _control_from(row: Mapping[str, Any]) -> Control:
    frames = np.array(row["frames"], dtype=np.float64).reshape(-1)
    drawn_m = _unpacked(row["drawn_m"]).reshape(int(frames[-1] - frames[0]) + 1, 3) if "drawn_m" in row else None
    return Control(
        str(row["joint"]),
        frames,
        np.array(row["positions_m"], dtype=np.float64).reshape(len(frames), 3),
        drawn_m,
        bool(row.get("height_is_free", False)),
    )


def settings_table(settings: SketchSettings) -> dict[str, Any]:
    """Return the settings as a JSON object."""
    return asdict(settings)


def settings_from(table: Mapping[str, Any]) -> SketchSettings:
    """Return the settings of `settings_table`; SettingsError if they are damaged."""
    with reading("sketch", SettingsError, "set the sketch's settings again"):
        return SketchSettings(
            float(table["follow"]),
            tuple(str(each) for each in table["behaviours"]),
            int(table["variation"]),
            bool(table["hold_feet"]),
        )


def motion_table(motion: Motion, number: int) -> dict[str, Any]:
    """Return the message with a first picture; arrays as float32 in base 64."""
    return {
        "number": number,
        "whole": False,
        "frames": motion.frames,
        "rotations": _packed(motion.rotations),
        "root_positions_m": _packed(motion.root_positions_m),
    }


def solution_table(solution: SketchSolution, number: int) -> dict[str, Any]:
    """Return the message with a solution."""
    return motion_table(solution.motion, number) | {
        "whole": True,
        "unmet": [[key.joint, key.frame, key.distance_m, key.reason] for key in solution.unmet],
        "drawn_from": list(solution.drawn_from),
    }


def solution_from(table: Mapping[str, Any]) -> SolvedSketch:
    """Return the solution of `solution_table`, or of {"number", "error"}."""
    frames = int(table.get("frames", 0))
    rotations = _unpacked(table.get("rotations", ""))
    return SolvedSketch(
        number=int(table["number"]),
        whole=bool(table.get("whole", True)),
        rotations=rotations.reshape(frames, -1, 4) if frames else np.zeros((0, 1, 4)),
        root_positions_m=_unpacked(table.get("root_positions_m", "")).reshape(frames, 3),
        unmet=tuple((str(j), int(f), float(d), str(r)) for j, f, d, r in table.get("unmet", ())),
        drawn_from=tuple(str(name) for name in table.get("drawn_from", ())),
        error=str(table.get("error", "")),
    )


def _packed(values: Array) -> str:
    return base64.b64encode(values.astype("<f4").tobytes()).decode("ascii")


def _unpacked(text: str) -> Array:
    return np.frombuffer(base64.b64decode(text), "<f4").astype(np.float64)
