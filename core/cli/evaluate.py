"""`perfanim evaluate`: a motion against its truth."""

import argparse
from pathlib import Path
from typing import Any

from ..body.motion_metrics import evaluate
from ..formats.motion.read_motion import read_motion, read_skeleton
from ..system.progress import Progress


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser("evaluate", help="compare a motion with its truth")
    parser.add_argument("motion", metavar="MOTION", help=".bvh or .amc")
    parser.add_argument("--truth", required=True, metavar="TRUTH", help=".bvh or .amc")
    parser.add_argument(
        "--skeleton", metavar="FILE.asf", help="skeleton of AMC files; its axes are those of the joint angles"
    )
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    progress(0.0, "reading")
    skeleton = read_skeleton(args.skeleton) if args.skeleton else None
    motion, truth = (
        read_motion(path, args.skeleton if Path(path).suffix.lower() == ".amc" else None)
        for path in (args.motion, args.truth)
    )
    progress(0.5, "comparing")
    return evaluate(motion, truth, skeleton)
