"""`perfanim take fill`: gaps and noise of a marker take mended by the body."""

import argparse
from dataclasses import replace
from typing import Any

from ...body.standard_skeleton import default_skeleton
from ...database.store import Database, open_database
from ...errors import TakeError
from ...formats.markers.marker_files import READABLE, WRITABLE, check_ending, is_recorded, read_take
from ...formats.markers.rewrite_take import rewrite_take
from ...markers.gap_filling import find_gaps
from ...markers.label_matching import AUTO, choose_marker_set, load_names, match_labels, rename_labels
from ...markers.marker_take import MarkerTake
from ...markers.subject import Subject, load_subject
from ...markers.take_frames import is_unnamed
from ...session.solve_take import fill_take
from ...subjects.from_motion import subject_from_motion
from ...system.progress import Progress
from ..options import add_number, add_text, check_height
from ..performer_options import add_names_option


def add_parser(group: Any) -> None:
    parser = group.add_parser("fill", help="fill gaps of a marker take, and remove noise, by the body it shows")
    parser.add_argument("take", metavar="TAKE", help=f"marker take: {', '.join(READABLE)}; it is left alone")
    parser.add_argument(
        "--out",
        required=True,
        metavar="FILE",
        help=f"take to write ({', '.join(WRITABLE)}); in the take's own format all else that it holds is kept",
    )
    add_text(parser, "--database", "DB", "motion database", required=True)
    add_text(parser, "--subject", "FILE", "calibrated subject (default: fitted to the take's motion)")
    add_number(parser, "--height", "M", "of the performer, roughly, without --subject", default=1.75)
    parser.add_argument(
        "--marker-set",
        default=AUTO,
        metavar="NAME",
        help=f"without --subject: shipped marker set or TOML file, or {AUTO}: by the take's labels (default {AUTO})",
    )
    add_names_option(parser)
    parser.add_argument(
        "--filter",
        type=float,
        metavar="HZ",
        help="remove noise from the measured positions, too: low-pass their offsets from the body without lag; 10 "
        "suits most motion (default: measured positions stay as they are)",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    check_height(args.height)
    check_ending(args.out)
    progress(0.0, "reading")
    database, read = open_database(args.database), read_take(args.take)
    if is_recorded(args.take) or is_unnamed(read):
        advice = "give a marker take with 3D positions and names"
        raise TakeError("holds no trajectories to fill", where=str(args.take), advice=advice)
    take = rename_labels(read, load_names(args.names)) if args.names is not None else read
    subject, take = _subject_and_take(args, take, database, progress)
    filled, solved = fill_take(take, subject, database, args.filter, progress)
    new = filled.visible & ~take.visible
    lengths = [gap.frames for gap in find_gaps(take.visible) if new[gap.start, gap.marker]]
    warnings = rewrite_take(args.take, replace(read, positions_m=filled.positions_m), args.out)
    left = sorted({name for name, open_ in zip(read.names, ~filled.visible.all(axis=0), strict=True) if open_})
    warnings += [f"gaps are left in {', '.join(left)}: no markers of the set, or never seen"] * bool(left)
    return {
        "frames": take.frames,
        "gaps": len(lengths),
        "filled": int(new.sum()),
        "longest_gap_s": max(lengths, default=0) / take.fps,
        "marker_set": subject.marker_set.name,
        "marker_rms_mm": solved.summary()["marker_rms_mm"],
        "warnings": warnings,
        "out": str(args.out),
    }


def _subject_and_take(
    args: argparse.Namespace, take: MarkerTake, database: Database, progress: Progress
) -> tuple[Subject, MarkerTake]:
    """Return the subject, and the take under the markers' names."""
    if args.subject is not None:
        subject = load_subject(args.subject)
        return subject, match_labels(take.names, subject.marker_set).rename(take)
    marker_set = choose_marker_set(args.marker_set, take.names, str(args.take))
    named = match_labels(take.names, marker_set).rename(take)
    start = Subject("performer", default_skeleton(args.height), marker_set)
    return subject_from_motion(named, start, database, progress), named
