"""`perfanim calibrate prop`: measure a rigid object with markers, from a take."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...body.clock import clock_of
from ...formats.markers.marker_files import is_recorded, read_take
from ...formats.take_file.take_reader import read_take_file
from ...labelling.trajectory_linking import track_markers
from ...markers.marker_take import MarkerTake
from ...markers.prop import save_prop
from ...subjects.prop_calibration import calibrate_prop
from ...system.progress import Progress
from ..options import add_command, add_text
from .calibrate_subject import part


def add_parser(group: Any) -> None:
    parser = add_command(group, "prop", run, "a rigid object with markers, such as a sword, a stick or a camera")
    parser.add_argument(
        "take",
        metavar="TAKE",
        help="take of the prop alone, lying in front of the cameras or moving slowly: from `perfanim track` without "
        "--marker-set, a .perftake, or from another system",
    )
    add_text(parser, "--out", "prop.toml", "definition to write", required=True)
    add_text(parser, "--name", "NAME", "name of the prop (default: the file's)")
    add_text(parser, "--frames", "A:B", "use only these frames of the take")
    add_text(parser, "--markers", "M,M,...", "its markers (default: the largest rigid group)")


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    progress(0.0, "reading")
    take = part(_trajectories(args.take), args.frames)
    name = args.name or Path(args.out).stem
    found = calibrate_prop(take, name, args.markers.split(",") if args.markers else ())
    save_prop(found.prop, args.out)
    places = found.prop.positions_m
    return {
        "name": name,
        "markers_mm": dict(zip(found.prop.names, (1e3 * places).round(1).tolist(), strict=True)),
        "residual_mm": 1e3 * found.prop.residual_m,
        "frames": found.frames,
        "left_out": list(found.left_out),
        "advice": list(found.advice),
        "out": str(args.out),
    }


def _trajectories(path: str) -> MarkerTake:
    """Return the trajectories of all points of a take, labelled or not."""
    if not is_recorded(path):
        return read_take(path)
    take = read_take_file(path)
    frames = [replace(frame, labels=np.full(len(frame.points_m), -1)) for frame in take.frames]
    clock = clock_of(np.array([frame.time_s for frame in frames]))
    return track_markers(frames, take.notes.name, clock.fps).take
