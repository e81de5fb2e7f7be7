"""Solve labelled markers with Momentum (Meta, MIT), for `perfanim bench published --momentum PYTHON`.

It runs in a Python that has `pymomentum-cpu`, which ours does not; data is exchanged through files. Momentum gets the
same skeleton, marker set and markers as our solver at its start: it calibrates the sizes of the bones (left like right)
and the positions of the markers, then tracks.
"""

import argparse
import os
import re
import sys
import sysconfig
import time
from pathlib import Path
from typing import Any

import numpy as np
import pymomentum.geometry as pm
from numpy.typing import NDArray
from pymomentum.marker_tracking import CalibrationConfig, TrackingConfig, calibrate_markers, process_markers

Array = NDArray[Any]

_CM = 100.0  # Momentum's settings are for centimetres


def main() -> None:
    """Read markers, solve, write joints (F, J, 3), markers (F, M, 3), metres, and seconds (calibration, solve)."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("given", help=".npz with joints, parents, offsets_m, markers, of_joint, places_m, positions_m")
    parser.add_argument("out", help=".npz to write")
    args = parser.parse_args()
    library = Path(sysconfig.get_path("platlib"), "pymomentum_cpu.libs", "libstdc++-pymomentum.so.6")
    if library.exists() and "LD_PRELOAD" not in os.environ:  # Momentum's progress bar crashes with another libstdc++
        os.execve(sys.executable, [sys.executable, *sys.argv], os.environ | {"LD_PRELOAD": str(library)})  # noqa: S606
    with np.load(args.given) as file:
        given = {name: file[name] for name in file.files}
    character = _character(given)
    frames = [_markers(given["markers"], row) for row in given["positions_m"]]
    started, settings = time.perf_counter(), CalibrationConfig()
    sizes, *_ = calibrate_markers(character, np.array([], np.float32), frames, settings)  # also moves its locators
    fitted = time.perf_counter()
    motion = process_markers(character, sizes, frames, TrackingConfig(), settings, calibrate=False)
    seconds = (fitted - started, time.perf_counter() - fitted)
    motion = np.asarray(motion, np.float32).reshape(len(frames), -1)
    states = np.asarray(pm.model_parameters_to_skeleton_state(character, motion))
    turns, places = states[..., 3:7], states[..., :3]
    parents = [locator.parent for locator in character.locators]
    offsets = np.array([locator.offset for locator in character.locators]) * states[:, parents, 7:8]
    markers = places[:, parents] + _rotated(turns[:, parents], offsets)
    np.savez(args.out, joints_m=places / _CM, markers_m=markers / _CM, seconds=seconds)


def _character(given: dict[str, Array]) -> pm.Character:
    """Return the skeleton with rotations of all joints, a position of the root, and sizes, left like right."""
    names, none = [str(name) for name in given["joints"]], np.array([0.0, 0.0, 0.0, 1.0], np.float32)
    skeleton = pm.Skeleton(
        [
            pm.Joint(name, int(parent), none, (_CM * offset).astype(np.float32))
            for name, parent, offset in zip(names, given["parents"], given["offsets_m"], strict=True)
        ]
    )
    columns: dict[str, list[tuple[int, float]]] = {}
    for number, name in enumerate(names):
        first = number * pm.PARAMETERS_PER_JOINT
        for axis in range(3):
            if number == 0:
                columns[f"root_t{'xyz'[axis]}"] = [(first + axis, 1.0)]
            columns[f"{name}_r{'xyz'[axis]}"] = [(first + 3 + axis, 1.0)]
            if number and given["offsets_m"][number][axis]:  # a bone is lengthened by moving the start of its child
                size = f"scale_{re.sub('^[lr](?=clav|hum|rad|wri|hand|fem|tib|foot|toes|thumb|fing)', '', name)}"
                columns.setdefault(size, []).append((first + axis, _CM * float(given["offsets_m"][number][axis])))
    transform = np.zeros((pm.PARAMETERS_PER_JOINT * len(names), len(columns)), np.float32)
    for column, entries in enumerate(columns.values()):
        for row, factor in entries:
            transform[row, column] = factor
    locators = [
        pm.Locator(str(name), int(joint), (_CM * place).astype(np.float32))
        for name, joint, place in zip(given["markers"], given["of_joint"], given["places_m"], strict=True)
    ]
    model = pm.ParameterTransform(list(columns), skeleton, transform)
    return pm.Character("body", skeleton, model, locators=locators)


def _markers(names: Array, positions_m: Array) -> list[pm.Marker]:
    seen = np.isfinite(positions_m).all(axis=-1)
    return [
        pm.Marker(str(name), _CM * position if visible else np.zeros(3), occluded=not visible)
        for name, position, visible in zip(names, positions_m, seen, strict=True)
    ]


def _rotated(turns: Array, vectors: Array) -> Array:
    """Return vectors rotated by quaternions (x, y, z, w)."""
    axis, w = turns[..., :3], turns[..., 3:]
    once = 2.0 * np.cross(axis, vectors)
    return vectors + w * once + np.cross(axis, once)


if __name__ == "__main__":
    main()
