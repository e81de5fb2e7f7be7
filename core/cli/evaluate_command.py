"""`perfanim evaluate`: compare a motion with the ground truth."""

import argparse
from pathlib import Path
from typing import Any

from ..body.motion_metrics import evaluate
from ..formats.motion.read_motion import read_motion, read_skeleton
from ..system.progress import Progress
from .options import add_command, add_text


def add_parser(subparsers: Any) -> None:
    parser = add_command(subparsers, "evaluate", _run, "compare a motion with the ground truth")
    parser.add_argument("motion", metavar="MOTION", help=".bvh or .amc")
    add_text(parser, "--truth", "TRUTH", ".bvh or .amc", required=True)
    add_text(parser, "--skeleton", "FILE.asf", "skeleton of AMC files; its axes are those of the joint angles")


def _run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    progress(0.0, "reading")
    skeleton = read_skeleton(args.skeleton) if args.skeleton else None
    motion, truth = (
        read_motion(path, args.skeleton if Path(path).suffix.lower() == ".amc" else None)
        for path in (args.motion, args.truth)
    )
    progress(0.5, "comparing")
    notes = [*motion.notes, *truth.notes]
    return evaluate(motion, truth, skeleton) | ({"warnings": notes} if notes else {})
