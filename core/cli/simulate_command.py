"""`perfanim simulate`: `markers` here, `cameras` beside it."""

import argparse
from pathlib import Path
from typing import Any

from ..body.motion import resampled
from ..formats.markers.marker_files import check_ending, write_take
from ..formats.motion.bvh import write_bvh
from ..formats.motion.read_motion import read_motion
from ..markers.marker_set import load_marker_set
from ..simulate.simulated_markers import simulate_markers
from ..system.progress import Progress
from . import simulate_cameras
from .options import add_number, add_text, check_fps, seed


def add_parser(subparsers: Any) -> None:
    group = subparsers.add_parser("simulate", help="marker takes and camera videos made from motion")
    commands = group.add_subparsers(metavar="COMMAND", required=True)
    _add_markers(commands)
    simulate_cameras.add_parser(commands)


def _add_markers(commands: Any) -> None:
    parser = commands.add_parser("markers", help="marker take from motion, with its truth")
    parser.add_argument("motion", metavar="MOTION", help=".bvh or .amc")
    add_text(parser, "--skeleton", "FILE.asf", "skeleton of an AMC file")
    add_text(parser, "--marker-set", "NAME", "shipped marker set or TOML file", required=True)
    add_text(parser, "--out", "TAKE", "take to write: .take.npz, .csv or .trc", required=True)
    add_number(parser, "--fps", "HZ", "rate of the take (default: the motion's)")
    add_number(parser, "--noise-mm", "S", "standard deviation per coordinate, mm (default 0)", default=0.0)
    add_number(parser, "--dropout", "P", "share of positions that are missing (default 0)", default=0.0)
    add_text(parser, "--seed", "N", "of noise and gaps (default 0)", type=seed, default=0)
    parser.set_defaults(run=_markers)


def _markers(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    check_fps(args.fps)
    check_ending(args.out)
    progress(0.0, "reading")
    motion = read_motion(args.motion, args.skeleton)
    if args.fps is not None:
        motion = resampled(motion, args.fps)
    marker_set = load_marker_set(args.marker_set)
    take, truth = simulate_markers(motion, marker_set, args.noise_mm, args.dropout, args.seed)
    progress(0.5, "writing")
    out = Path(args.out)
    truth_path = truth_path_of(out)
    write_take(take, out)
    write_bvh(truth, truth_path)
    return {
        "frames": take.frames,
        "fps": take.fps,
        "markers": list(take.names),
        "visible_fraction": float(take.visible.mean()),
        "take": str(out),
        "truth": str(truth_path),
    }


def truth_path_of(take: Path) -> Path:
    """Return the truth's path beside a take: "walk.take.npz" -> "walk.truth.bvh"."""
    stem = take.name.removesuffix(".take.npz") if take.name.endswith(".take.npz") else take.stem
    return take.with_name(f"{stem}.truth.bvh")
