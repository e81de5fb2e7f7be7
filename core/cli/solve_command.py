"""`perfanim solve`: solve a marker take to full-body motion."""

import argparse
from pathlib import Path
from typing import Any

from ..api.solving import RecordingChanges, SolveRequest, solve_markers, solve_recording, solve_unmeasured
from ..api.take_reading import fit_take, labelled_by, read_labelled, wearing
from ..database.starter_database import starter_database
from ..errors import FormatError
from ..formats.markers.marker_files import READABLE, is_recorded
from ..formats.motion.write_motion import MOTION_ENDINGS, is_motion
from ..formats.take_file.take_reader import ENDING, read_take_file
from ..geometry.rig_file import load_rig
from ..labelling.take_import import UPS
from ..markers.label_matching import AUTO
from ..markers.prop import load_prop
from ..markers.subject import load_subject
from ..session.session_cache import SessionCache
from ..session.solved_take import SolvedTake
from ..system.progress import Progress
from .options import (
    add_choice,
    add_command,
    add_motion_options,
    add_repeated,
    add_request_options,
    add_text,
    request_of,
)
from .performer_options import add_body_options, add_names_option, chosen_marker_set, chosen_subject


def add_parser(subparsers: Any) -> None:
    parser = add_command(subparsers, "solve", run, "full-body motion from a marker take")
    parser.add_argument("take", metavar="TAKE", help=f"marker take: {', '.join(READABLE)}")
    add_text(
        parser,
        "--database",
        "DB",
        "motion database (default: the starter database; for a .perftake, the one it was recorded with)",
    )
    _add_performer_options(parser)
    add_request_options(
        parser,
        SolveRequest,
        method="--method",
        causal="--causal",
        refine_body="--refine-body",
        trust_labels="--trust-labels",
        smooth_hz="--smooth HZ",
        feet="--feet",
        height_m="--height M",
    )
    _add_marker_options(parser)
    _add_recorded_options(parser)
    written = (
        f"motion to write ({', '.join(MOTION_ENDINGS)}), or a {ENDING} with the markers and the poses; from a {ENDING} "
        "the recording with the new poses"
    )
    add_text(parser, "--out", "MOTION.bvh", written, required=True)
    add_motion_options(parser)


def _add_performer_options(parser: argparse.ArgumentParser) -> None:
    subject = (
        "calibrated subject: skeleton and marker offsets (default: a .perftake's own, or fitted to a marker take's "
        "motion)"
    )
    add_body_options(parser, subject, ".asf or .bvh with the bones to use; needs --marker-set")
    worn = (
        f"shipped marker set or TOML file, or {AUTO}: the shipped set that matches most of the take's labels; other "
        f"markers are placed from the motion (default: the subject's, or {AUTO} without a subject)"
    )
    add_text(parser, "--marker-set", "NAME", worn)


def _add_marker_options(parser: argparse.ArgumentParser) -> None:
    add_names_option(parser)
    use = (
        "solve with only some of a suit's markers: those named, or the N that determine the body best according to "
        "the motion database; the others then measure the error (left_out_rms_mm)"
    )
    add_text(parser, "--use", "N|NAME,...", use)
    up = (
        "axis of a marker file that points up: auto for the one along which the performer stands (default), feet to "
        "fit the floor to the feet and make it y = 0"
    )
    add_choice(parser, "--up", UPS, up)


def _add_recorded_options(parser: argparse.ArgumentParser) -> None:
    rig = "for a .perftake: another calibration to triangulate its 2D detections with (default: as live)"
    add_text(parser, "--cameras", "cameras.toml", rig)
    prop = (
        "for a .perftake: a prop besides the performer (repeatable; default: the recorded ones); writes "
        "MOTION.PROP.csv beside the motion"
    )
    add_repeated(parser, "--prop", "prop.toml", prop)
    performer = (
        "for a .perftake: a further performer seen by the same cameras, whose motion is written beside MOTION "
        "(repeatable; default: the recorded ones)"
    )
    add_repeated(parser, "--performer", "subject.toml", performer)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    check(args)
    progress(0.0, "reading")
    solved = solve(args, progress, SessionCache())
    is_take = is_recorded(args.out)
    report: dict[str, Any] = {
        "fps": solved.motion.fps if is_take else args.rate or solved.motion.fps,
        "expected_joint_errors_deg": solved.joint_errors_deg(),
        **solved.report,
        **solved.verdict_facts(),
    }
    for performer, out in zip(report.get("performers", []), solved.motion_paths(args.out)[1:], strict=True):
        performer |= {} if is_take else {"out": str(out)}
    return solved.summary() | report | {"out": str(Path(args.out))}


def check(args: argparse.Namespace) -> None:
    """End with wrong usage for options that exclude each other.

    Raises:
        FormatError: The output's extension is not that of a motion or a recorded take.
    """
    recorded, take_out = is_recorded(args.take), is_recorded(args.out)
    unlabelled = "only a .perftake stores unlabelled points"
    for is_wrong, message in (
        (not recorded and args.cameras is not None, "--cameras: only a .perftake stores 2D detections of cameras"),
        (not recorded and args.prop, f"--prop: {unlabelled}"),
        (not recorded and args.performer, f"--performer: {unlabelled}"),
        (recorded and args.up is not None, "--up: a .perftake has y up"),
        (recorded and args.names is not None, "--names: a .perftake has its marker set's labels"),
        (recorded and args.marker_set == AUTO, f"--marker-set {AUTO}: a .perftake has its marker set's labels"),
        (
            args.cameras is not None and args.refine_body,
            "--refine-body: not with --cameras, because the recorded labels were made with the old calibration",
        ),
        (recorded and args.use is not None, "--use: for marker takes, not for a .perftake"),
        (take_out and args.smooth_hz is not None, "--smooth: a .perftake stores the poses as solved"),
        (take_out and args.feet != "off", "--feet: a .perftake stores the poses as solved"),
    ):
        if is_wrong:
            args.wrong_usage(f"argument {message}")
    if not take_out and not is_motion(args.out):
        advice = f"use one of {', '.join((*MOTION_ENDINGS, ENDING))}"
        raise FormatError("does not have the extension of a motion file", where=str(args.out), advice=advice)


def solve(args: argparse.Namespace, progress: Progress, cache: SessionCache) -> SolvedTake:
    """Solve the take with checked options and write the output.

    Takes that are solved one after another share the cache.
    """
    request = request_of(SolveRequest, args, **_used_markers(args.use), place_markers=args.marker_set == AUTO)
    solved = (_solve_recorded if is_recorded(args.take) else _solve_markers)(args, request, progress, cache)
    solved.save(args.out, args.units, args.naming, args.rate)
    return solved


def _used_markers(text: str | None) -> dict[str, Any]:
    """Return the fields for --use: the number of markers, or their names."""
    if text is not None and text.strip().isdecimal():
        return {"marker_count": int(text.strip()[:9])}
    return {"markers": tuple(name.strip() for name in text.split(",") if name.strip()) or (text,)} if text else {}


def _solve_markers(
    args: argparse.Namespace, request: SolveRequest, progress: Progress, cache: SessionCache
) -> SolvedTake:
    take = read_labelled(args.take, args.names)
    database = args.database or starter_database(progress)
    has_body = args.subject is not None or args.skeleton is not None
    named = args.marker_set or (None if has_body else AUTO)
    worn = None
    if named is not None:
        take, worn = labelled_by(named, take, cache.database(database), str(args.take), progress)
    subject = chosen_subject(args, worn)
    up = args.up or "auto"
    if subject is not None:
        take = fit_take(take, subject.marker_set, up)
        return solve_markers(take, subject, database, request, progress, cache)
    assert worn is not None  # noqa: S101 - a set is named if there is no subject
    fitted = AUTO if named == AUTO else worn
    return solve_unmeasured(fit_take(take, worn, up), fitted, database, request, progress, cache)


def _solve_recorded(
    args: argparse.Namespace, request: SolveRequest, progress: Progress, cache: SessionCache
) -> SolvedTake:
    take, worn = read_take_file(args.take), chosen_marker_set(args)
    subject, recorded = chosen_subject(args, worn), take.setup.subjects()
    if subject is None and recorded:
        subject = wearing(recorded[0], worn, str(args.take))
    changes = RecordingChanges(
        subject,
        [load_subject(path) for path in args.performer],
        [load_prop(path) for path in args.prop],
        load_rig(args.cameras) if args.cameras is not None else None,
    )
    return solve_recording(take, request, changes, args.database, progress, cache)
