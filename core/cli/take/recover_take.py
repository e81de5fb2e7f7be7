"""`perfanim take recover`: write the intact part of a damaged take as a new take."""

import argparse
from pathlib import Path
from typing import Any

from ...errors import FormatError, SettingsError
from ...formats.markers.marker_files import is_recorded
from ...formats.take_file.take_reader import ENDING, read_take_file, take_name
from ...formats.take_file.take_recovery import recover
from ...system.files import exists
from ...system.progress import Progress
from ..options import add_command, add_text


def add_parser(group: Any) -> None:
    parser = add_command(group, "recover", run, "write the intact part of a cut-off or damaged take as a complete take")
    parser.add_argument("take", metavar="TAKE", help=f"recorded take ({ENDING}); it is not changed")
    add_text(parser, "--out", "TAKE", f"take to write (default: NAME-recovered{ENDING} beside it)")


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Write the intact part as a new take, and report what was left out."""
    path = Path(args.take)
    out = Path(args.out) if args.out else path.with_name(f"{take_name(path)}-recovered{ENDING}")
    if not is_recorded(out):
        raise SettingsError(f"does not end in {ENDING}", where=str(out), advice="name a file with this extension")
    if exists(out) and not args.out:
        raise FormatError("already exists", where=str(out), advice="give another name with --out")
    progress(0.0, "reading")
    take = read_take_file(path)
    problems = [str(fault) for fault in take.faults]
    recover(take, out)
    frames = take.frames
    return {
        "frames": len(frames),
        "poses": len(take.poses),
        "duration_s": float(frames[-1].time_s - frames[0].time_s) if frames else 0.0,
        "left_out": problems,
        "out": str(out),
    }
