"""`perfanim solve`: a marker take to full-body motion."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..database.store import open_database
from ..errors import SubjectError
from ..formats.bvh import write_bvh
from ..formats.takes import read_take
from ..marker_filter import smoothed, smoothed_motion
from ..marker_set import Subject, load_marker_set, load_subject
from ..marker_take import MarkerTake
from ..motion_files import read_skeleton
from ..solve_take import solve_take
from ..solver.settings import METHODS, SolveSettings


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser("solve", help="full-body motion from a marker take")
    parser.add_argument("take", metavar="TAKE", help="marker take: .take.npz, .c3d, .trc or .csv")
    parser.add_argument("--database", required=True, metavar="DB", help="motion database")
    body = parser.add_mutually_exclusive_group(required=True)
    body.add_argument("--subject", metavar="FILE", help="calibrated subject (skeleton and marker offsets)")
    body.add_argument("--skeleton", metavar="FILE", help=".asf or .bvh whose bones are used; needs --marker-set")
    parser.add_argument("--marker-set", metavar="NAME", help="shipped marker set or TOML file (default: the subject's)")
    parser.add_argument("--method", choices=METHODS, default="best", help="how poses are found (default best)")
    parser.add_argument(
        "--smooth",
        type=float,
        metavar="HZ",
        help="low-pass markers before and motion after, without lag; 6 suits walking (default: off)",
    )
    parser.add_argument("--out", required=True, metavar="MOTION.bvh", help="motion to write")
    parser.add_argument("--units", choices=("m", "cm"), default="m", help="unit of the BVH file (default m)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace, progress: Callable[[float, str], None]) -> dict[str, Any]:
    """Solve a take and write its motion."""
    progress(0.0, "reading")
    take = read_take(args.take)
    if args.smooth is not None:
        take = smoothed(take, args.smooth)
    subject = _subject(args)
    database = open_database(args.database)
    settings = SolveSettings(method=args.method)
    solved = solve_take(take, subject, database, settings, progress)
    motion = solved.motion if args.smooth is None else smoothed_motion(solved.motion, args.smooth)
    write_bvh(motion, args.out, args.units)
    return solved.summary() | {
        "method": settings.method,
        "fps": take.fps,
        "warnings": _differences(take, subject),
        "out": str(Path(args.out)),
    }


def _differences(take: MarkerTake, subject: Subject) -> list[str]:
    """Return what tells that the take was recorded with other markers than the subject's."""
    worn = subject.marker_set.names
    lacking = [name for name in worn if name not in take.names]
    unused = [name for name in take.names if name not in worn]
    return [f"not in the take: {', '.join(lacking)}"] * bool(lacking) + [
        f"not in the marker set, left out: {', '.join(unused)}"
    ] * bool(unused)


def _subject(args: argparse.Namespace) -> Subject:
    if args.subject is None:
        if args.marker_set is None:
            raise SubjectError("--skeleton needs --marker-set", advice="name the marker set that was worn")
        skeleton = read_skeleton(args.skeleton)
        return Subject(Path(args.skeleton).stem, skeleton, load_marker_set(args.marker_set))
    subject = load_subject(args.subject)
    if args.marker_set is None:
        return subject
    chosen = load_marker_set(args.marker_set)
    known = {marker.name: marker for marker in subject.marker_set.markers}
    uncalibrated = [m.name for m in chosen.markers if m.name not in known and m.offset_m is None]
    if uncalibrated:
        raise SubjectError(
            "no offset is known for " + ", ".join(uncalibrated),
            where=str(args.subject),
            advice="calibrate the subject with this marker set",
        )
    markers = tuple(known.get(marker.name, marker) for marker in chosen.markers)
    return Subject(subject.name, subject.skeleton, type(chosen)(chosen.name, markers), subject.residual_m)
