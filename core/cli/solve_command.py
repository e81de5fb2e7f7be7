"""`perfanim solve`: a marker take to full-body motion."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..body.foot_lock import FEET
from ..database.store import Database
from ..errors import FormatError
from ..formats.markers.marker_files import READABLE, is_recorded
from ..formats.motion.write_motion import MOTION_ENDINGS, is_motion
from ..formats.take_file.take_reader import ENDING
from ..labelling.take_import import UPS
from ..markers.label_matching import AUTO
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from ..session.session_cache import SessionCache
from ..session.solve_request import BodyFiles, MotionOutput, SolveMarkers, SolveRecorded
from ..session.solve_take import SolvedTake
from ..solver.settings import METHODS
from ..subjects.refine_body import refine_body
from ..subjects.refinement_text import worthwhile
from ..system.progress import Progress
from .options import add_choice, add_motion_options, add_names_option, add_repeated, add_switch, add_text


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser("solve", help="full-body motion from a marker take")
    parser.add_argument("take", metavar="TAKE", help=f"marker take: {', '.join(READABLE)}")
    add_text(parser, "--database", "DB", "motion database (default of a .perftake: the one it was recorded with)")
    _add_performer_options(parser)
    add_switch(
        parser,
        "--refine-body",
        "first correct the performer's bones and marker offsets by this take (see calibrate subject --refine); "
        "the subject's file stays as it is",
    )
    add_choice(parser, "--method", METHODS, "solver method (default best; of a .perftake, as live)")
    add_switch(parser, "--causal", "solve each frame by earlier ones alone, as live (default: in both directions)")
    _add_marker_options(parser)
    _add_recorded_options(parser)
    parser.add_argument(
        "--smooth",
        type=float,
        metavar="HZ",
        help="low-pass markers before and motion after, without lag; 6 suits walking; of a .perftake the motion alone "
        "(default: off)",
    )
    parser.add_argument(
        "--feet",
        choices=FEET,
        default="off",
        help="hold feet in place: auto, those that stand; always, the lower one even if it glides (default off)",
    )
    parser.add_argument(
        "--out",
        required=True,
        metavar="MOTION.bvh",
        help=f"motion to write ({', '.join(MOTION_ENDINGS)}); of a {ENDING} also another {ENDING}: the recording with "
        "the new poses",
    )
    add_motion_options(parser)
    parser.set_defaults(run=run, wrong_usage=parser.error)


def _add_performer_options(parser: argparse.ArgumentParser) -> None:
    body = parser.add_mutually_exclusive_group()
    add_text(body, "--subject", "FILE", "calibrated subject, skeleton and marker offsets (default: a .perftake's own)")
    add_text(body, "--skeleton", "FILE", ".asf or .bvh with the bones to use; needs --marker-set")
    parser.add_argument(
        "--marker-set",
        metavar="NAME",
        help=f"shipped marker set or TOML file, or {AUTO}: the shipped one to which most of the take's labels belong "
        "(default: the subject's)",
    )


def _add_marker_options(parser: argparse.ArgumentParser) -> None:
    add_names_option(parser)
    parser.add_argument(
        "--use",
        metavar="N|NAME,...",
        help="solve with a few of a suit's markers: those named, or the N that determine the body best by "
        "the motion database; the others then measure the error (left_out_rms_mm)",
    )
    parser.add_argument(
        "--up",
        choices=UPS,
        help="axis of a marker file that points up: auto for the axis along the standing performer, feet for the floor "
        "under the feet, which becomes y = 0 (default: the file is taken as it is, y up)",
    )


def _add_recorded_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--cameras",
        metavar="cameras.toml",
        help="of a .perftake: another calibration to triangulate its 2D detections with (default: as live)",
    )
    parser.add_argument(
        "--prop",
        action="append",
        metavar="prop.toml",
        help="of a .perftake: a prop besides the performer (repeatable; default: the recorded ones); writes "
        "MOTION.PROP.csv beside the motion",
    )
    add_repeated(
        parser,
        "--performer",
        "subject.toml",
        "of a .perftake: a further performer before the same cameras, with a motion beside MOTION "
        "(repeatable; default: the recorded ones)",
    )


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    check(args)
    progress(0.0, "reading")
    solved, facts = solve(args, progress, SessionCache())
    facts = {"fps": solved.motion.fps, "expected_joint_errors_deg": solved.joint_errors_deg()} | facts
    return solved.summary() | facts | {"out": str(Path(args.out))}


def check(args: argparse.Namespace) -> None:
    """End with wrong usage for options that exclude each other.

    Raises:
        FormatError: no motion format has the output's ending.
    """
    recorded, take_out = is_recorded(args.take), is_recorded(args.out)
    if not recorded and args.database is None:
        args.wrong_usage("the following arguments are required: --database")
    if not recorded and args.subject is None and args.skeleton is None:
        args.wrong_usage("one of the arguments --subject --skeleton is required")
    unlabelled = "only a .perftake holds points without labels"
    for is_wrong, message in (
        (not recorded and args.cameras is not None, "--cameras: only a .perftake holds 2D detections of cameras"),
        (not recorded and args.prop, f"--prop: {unlabelled}"),
        (not recorded and args.performer, f"--performer: {unlabelled}"),
        (recorded and args.up is not None, "--up: a .perftake has y up"),
        (recorded and args.names is not None, "--names: a .perftake has its marker set's labels"),
        (recorded and args.marker_set == AUTO, f"--marker-set {AUTO}: a .perftake has its marker set's labels"),
        (args.cameras is not None and args.refine_body, "--refine-body: the recorded labels have the old calibration"),
        (recorded and args.use is not None, "--use: for marker takes, not for a .perftake"),
        (take_out and not recorded, "--out: perfanim take import makes a .perftake of other takes"),
        (take_out and args.smooth is not None, "--smooth: a .perftake holds poses as they are solved"),
        (take_out and args.feet != "off", "--feet: a .perftake holds poses as they are solved"),
    ):
        if is_wrong:
            args.wrong_usage(f"argument {message}")
    if not take_out and not is_motion(args.out):
        advice = f"use {', '.join((*MOTION_ENDINGS, ENDING))}"
        raise FormatError("cannot be written (no motion has this ending)", where=str(args.out), advice=advice)


def solve(args: argparse.Namespace, progress: Progress, cache: SessionCache) -> tuple[SolvedTake, dict[str, Any]]:
    """Solve the take of checked options and write the output; return poses and facts.

    Takes that are solved one after another share the cache.
    """
    body = BodyFiles(args.subject, args.skeleton, args.marker_set)
    refine = _refine if args.refine_body else None
    output = MotionOutput(str(args.out), args.units, args.naming, args.rate, args.smooth, args.feet)
    request: SolveMarkers | SolveRecorded
    if is_recorded(args.take):
        request = SolveRecorded(
            str(args.take),
            body,
            output,
            args.database,
            args.cameras,
            props=args.prop or (),
            performers=args.performer,
            method=args.method,
            causal=args.causal,
            refine=refine,
        )
        if args.cameras is not None:
            from ..vision.synchronise import retriangulate  # images' libraries are slow to load

            request = replace(request, retriangulate=retriangulate)
    else:
        request = SolveMarkers(
            str(args.take), args.database, body, output, args.names, args.use, args.up, args.method, args.causal, refine
        )
    return request.run(progress, cache)


def _refine(take: MarkerTake, subject: Subject, database: Database, progress: Progress) -> tuple[Subject, list[str]]:
    """Return the subject corrected by the take where it is off, and the changes."""
    return worthwhile(subject, refine_body(take, subject, database, progress))
