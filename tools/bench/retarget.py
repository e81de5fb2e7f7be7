"""A walk and boxing on every character in a folder: bones found, limb directions, twists, feet on the floor.

What is written as FBX and glTF is read back; bone layouts of MPFB (.json) stand for characters without a mesh.
"""

import contextlib
import io
import os
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mpfb_layouts import save_layout
from perfanim.core.body.motion import sliced
from perfanim.core.body.standing_on_floor import on_floor
from perfanim.core.errors import PerfanimError
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.system.assets import MOTION
from perfanim.perfanim_addon.export.retarget_file import retarget_file
from retargeted import measured
from stood import read_back, stood

from .run import Run

ENDINGS = (".glb", ".gltf", ".vrm", ".blend", ".json")
FORMATS = ("blend", "fbx", "glb")  # written
CLIPS = ("walking-01-neutral", "boxing-01-neutral")
FRAMES = 180
SCENE_FPS = 24.0  # a .blend keeps its own rate, so each frame of the motion is put on one of the scene's
DIRECTION_DEG, TURN, SLIDE_CM_S, FEET_MM = 3.0, 2.0, 1.0, 5.0  # limits to reach


def retarget(run: Run) -> dict[str, Any]:
    """Retarget two clips to all characters below `data`.

    Returns:
        rows (character, clip, how far its arms hang in the rest pose, unmapped or doubtful bones, origin of the map,
        largest median angle between the direction of a limb and the performer's, fastest rotation of a
        bone relative to the performer's fastest joint, speed of feet beyond the performer's while these are planted,
        and for each format largest height of the lower sole above or below the floor, farthest slide of a planted foot;
        the clips have no flight),
        refused (character, reason), missed (rows that exceed a limit), outputs.
    """
    run.out.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    refused: list[dict[str, str]] = []
    paths = sorted(path for path in run.data.rglob("*") if path.suffix.lower() in ENDINGS)
    for number, path in enumerate(paths):
        name = str(path.relative_to(run.data))
        run.progress(number / len(paths), name)
        try:
            rows += [{"character": name, "clip": clip} | _row(path, clip) for clip in CLIPS]
        except PerfanimError as error:
            refused.append({"character": name, "reason": str(error).partition(": ")[2]})
    missed = sum(
        row["direction_deg"] > DIRECTION_DEG
        or row["turn"] > TURN
        or row["slide_cm_s"] > SLIDE_CM_S
        or max(row[f"{form}_{kind}_mm"] for form in FORMATS for kind in ("sole", "slide")) > FEET_MM
        for row in rows
    )
    return run.write("retarget", {"rows": rows, "refused": refused, "missed": missed}, {"": rows, "refused": refused})


def _row(path: Path, clip: str) -> dict[str, Any]:
    motion = on_floor(sliced(read_motion(MOTION / f"{clip}.bvh"), 0, FRAMES))
    feet = {}
    with tempfile.TemporaryDirectory() as folder, _silent():
        if path.suffix == ".json":
            save_layout(path, path := Path(folder) / f"{path.stem}.blend")
        if path.suffix == ".blend":
            motion = replace(motion, fps=SCENE_FPS)
        for form in reversed(FORMATS):
            done = retarget_file(motion, path, Path(folder) / f"out.{form}")
            again, first = read_back(done, motion.fps) if form != "blend" else (done, 1)
            feet[form] = stood(again, motion, first)
        figures = measured(done, motion)
    medians = {limb: float(np.median(errors)) for limb, errors in figures.direction_deg.items()}
    worst = max(medians, key=lambda limb: medians[limb])
    return {
        "arms_down_deg": round(figures.arms_down_deg),
        "unmapped": " ".join(done["unmapped"]),
        "doubtful": " ".join(done["doubtful"]),
        "found_by": done["found_by"],
        "limb": worst,
        "direction_deg": round(medians[worst], 2),
        "turn": round(figures.turn_deg / figures.own_turn_deg, 2),
        "slide_cm_s": round(figures.slide_cm_s - figures.own_slide_cm_s, 2),
    } | {
        f"{form}_{kind}_mm": round(value, 1)
        for form in FORMATS
        for kind, value in (
            ("sole", float(np.abs(feet[form].soles_mm.min(axis=1)).max())),
            ("slide", feet[form].slide_mm),
        )
    }


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Hide output of Blender's importers, written by Python or by lower levels."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)
