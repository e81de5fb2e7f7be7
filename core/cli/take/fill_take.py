"""`perfanim take fill`: fill gaps and remove noise in a marker take with the help of the body."""

import argparse
from dataclasses import replace
from typing import Any

from ...api.calibration import fit_subject
from ...api.solving import SolveRequest
from ...api.take_reading import fit_take
from ...database.starter_database import starter_database
from ...database.store import Database, open_database
from ...errors import TakeError
from ...formats.markers.marker_files import READABLE, WRITABLE, check_ending, is_recorded, read_take
from ...formats.markers.rewrite_take import rewrite_take
from ...labelling.take_import import turned
from ...labelling.up_axis import TURNS, axis_up
from ...markers.gap_filling import find_gaps
from ...markers.label_faults import correct_labels, told
from ...markers.label_matching import AUTO, choose_marker_set, load_names, rename_labels
from ...markers.marker_take import MarkerTake
from ...markers.subject import Subject, load_subject
from ...markers.take_frames import is_unnamed
from ...session.solve_take import fill_take
from ...system.progress import Progress
from ..options import add_command, add_number, add_request_options, add_text, check_height
from ..performer_options import add_names_option


def add_parser(group: Any) -> None:
    parser = add_command(group, "fill", run, "fill gaps and remove noise in a marker take with the help of the body")
    parser.add_argument("take", metavar="TAKE", help=f"marker take: {', '.join(READABLE)}; it is not changed")
    written = f"take to write ({', '.join(WRITABLE)}); in the take's own format, all its other content is kept"
    add_text(parser, "--out", "FILE", written, required=True)
    add_text(parser, "--database", "DB", "motion database (default: the starter database)")
    add_text(parser, "--subject", "FILE", "calibrated subject (default: fitted to the take's motion)")
    add_number(parser, "--height", "M", "approximate height of the performer, without --subject", default=1.75)
    worn = f"without --subject: shipped marker set or TOML file, or {AUTO} to choose by the labels (default {AUTO})"
    add_text(parser, "--marker-set", "NAME", worn, default=AUTO)
    add_names_option(parser)
    add_request_options(parser, SolveRequest, trust_labels="--trust-labels")
    add_number(
        parser,
        "--filter",
        "HZ",
        "also remove noise from the measured positions, with a zero-lag low-pass filter on their offsets from the "
        "body; 10 suits most motion (default: measured positions are not changed)",
    )


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    check_height(args.height)
    check_ending(args.out)
    progress(0.0, "reading")
    database, read = open_database(args.database or starter_database(progress)), read_take(args.take)
    if is_recorded(args.take) or is_unnamed(read):
        advice = "give a marker take with 3D positions and names"
        raise TakeError("holds no trajectories to fill", where=str(args.take), advice=advice)
    take = rename_labels(read, load_names(args.names)) if args.names is not None else read
    subject, take = _subject_and_take(args, take, database, progress)
    turn = TURNS[axis_up(take, subject.marker_set)]
    upright = turned(take, turn)
    take, faults = (upright, ()) if args.trust_labels else correct_labels(upright, subject)
    filled, solved = fill_take(take, subject, database, args.filter, progress)
    filled = turned(filled, turn.T)  # the file keeps its axes
    new = filled.visible & ~take.visible
    lengths = [gap.frames for gap in find_gaps(take.visible) if new[gap.start, gap.marker]]
    warnings = told([fault.stretch(take) for fault in faults])
    warnings += rewrite_take(args.take, replace(read, positions_m=filled.positions_m), args.out)
    left = sorted({name for name, open_ in zip(read.names, ~filled.visible.all(axis=0), strict=True) if open_})
    if left:
        warnings.append(f"gaps remain in {', '.join(left)}: these are not in the marker set, or are never visible")
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
    """Return the subject, and the take with the marker names of its set."""
    if args.subject is not None:
        subject = load_subject(args.subject)
        return subject, fit_take(take, subject.marker_set, None)
    marker_set = choose_marker_set(args.marker_set, take.names, str(args.take))
    named = fit_take(take, marker_set, None)
    return fit_subject(named, database, marker_set, args.height, progress=progress), named
