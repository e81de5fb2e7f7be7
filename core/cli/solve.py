"""`perfanim solve`: a marker take to full-body motion."""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..body.foot_lock import FEET, floor_of, with_feet_held
from ..body.motion import Motion
from ..body.skeleton import marker_positions
from ..database.store import Database, identity
from ..errors import FormatError, SubjectError, TakeError
from ..formats.markers.marker_files import is_recorded, read_take
from ..formats.markers.prop_csv import write_prop_csv
from ..formats.motion.read_motion import read_skeleton
from ..formats.motion.write_motion import MOTION_ENDINGS, is_motion, write_motion
from ..formats.take_file.reading import ENDING, TakeFile, read_take_file
from ..geometry.rig_file import load_rig
from ..labelling.take_import import UPS, import_take
from ..markers.filtering import smooth_motion, smooth_take
from ..markers.label_matching import AUTO, load_names, match_best_set, match_labels, rename_labels
from ..markers.marker_set import MarkerSet, load_marker_set
from ..markers.marker_take import MarkerTake
from ..markers.prop import Prop, load_prop
from ..markers.subject import Subject, load_subject
from ..markers.take_frames import is_unnamed
from ..session.capture_setup import CaptureSetup
from ..session.save_solved_take import save_resolved_take
from ..session.session_cache import SessionCache
from ..session.solve_take import SolvedTake, solve_recorded, solve_take
from ..solver.settings import METHODS, SolveSettings
from ..solver.marker_selection import choose_markers, with_markers, worn_in
from .options import add_motion_options


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser("solve", help="full-body motion from a marker take")
    parser.add_argument("take", metavar="TAKE", help="marker take: .take.npz, .c3d, .trc, .csv or .tsv; or a .perftake")
    parser.add_argument(
        "--database", metavar="DB", help="motion database (a .perftake knows the one it was recorded with)"
    )
    body = parser.add_mutually_exclusive_group()
    body.add_argument(
        "--subject", metavar="FILE", help="calibrated subject, skeleton and marker offsets (a .perftake holds its own)"
    )
    body.add_argument("--skeleton", metavar="FILE", help=".asf or .bvh with the bones to use; needs --marker-set")
    parser.add_argument(
        "--marker-set",
        metavar="NAME",
        help=f"shipped marker set or TOML file, or {AUTO}: the shipped one to which most of the take's labels belong "
        "(default: the subject's)",
    )
    parser.add_argument(
        "--names",
        metavar="FILE",
        help='TOML file whose table [names] says which label is which marker ("Knee 1" = "LKNE"); the other labels are '
        "markers whose name they spell, whatever the case, separators and the subject before them",
    )
    parser.add_argument(
        "--use",
        metavar="N|NAME,...",
        help="solve with a few of a suit's markers: those named, or the N that leave least of the body open in "
        "the motion database; the others then tell how far off the body is (left_out_rms_mm)",
    )
    parser.add_argument(
        "--cameras",
        metavar="cameras.toml",
        help="of a .perftake: another calibration, by which its 2D detections are located anew (default: as live)",
    )
    parser.add_argument(
        "--prop",
        action="append",
        metavar="prop.toml",
        help="of a .perftake: a prop that is followed beside the performer (repeatable; default: those that were "
        "recorded); leaves MOTION.PROP.csv beside the motion",
    )
    parser.add_argument("--method", choices=METHODS, help="how poses are found (default best; of a .perftake, as live)")
    parser.add_argument(
        "--up",
        choices=UPS,
        help="axis of a marker file that points up: auto for that which the performer stands along, feet for the floor "
        "on which the feet stand, which becomes y = 0 (default: the file is taken as it is, y up)",
    )
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
        "--performer",
        action="append",
        default=[],
        metavar="subject.toml",
        help="of a .perftake: a further performer before the same cameras, whose motion is written beside MOTION "
        "(repeatable; default: those that were recorded)",
    )
    parser.add_argument(
        "--out",
        required=True,
        metavar="MOTION.bvh",
        help=f"motion to write ({', '.join(MOTION_ENDINGS)}); of a {ENDING} also another {ENDING}: what was recorded, "
        "with the new poses",
    )
    add_motion_options(parser)
    parser.set_defaults(run=run, wrong_usage=parser.error)


def run(args: argparse.Namespace, progress: Callable[[float, str], None]) -> dict[str, Any]:
    """Solve a take and write its motion."""
    check(args)
    progress(0.0, "reading")
    solved, facts = solve(args, progress, SessionCache())
    return solved.summary() | {"fps": solved.motion.fps} | facts | {"out": str(Path(args.out))}


def check(args: argparse.Namespace) -> None:
    """End with wrong usage for options that cannot be meant together; FormatError for an ending nothing has."""
    recorded = is_recorded(args.take)
    if not recorded and args.database is None:
        args.wrong_usage("the following arguments are required: --database")
    if not recorded and args.subject is None and args.skeleton is None:
        args.wrong_usage("one of the arguments --subject --skeleton is required")
    if not recorded and args.cameras is not None:
        args.wrong_usage("argument --cameras: only a .perftake holds what cameras saw")
    if not recorded and args.prop:
        args.wrong_usage("argument --prop: only a .perftake holds points that are nobody's yet")
    if not recorded and args.performer:
        args.wrong_usage("argument --performer: only a .perftake holds points that are nobody's yet")
    if recorded and args.up is not None:
        args.wrong_usage("argument --up: a .perftake has y up")
    if recorded and (args.names is not None or args.marker_set == AUTO):
        args.wrong_usage(f"arguments --names, --marker-set {AUTO}: a .perftake knows its markers")
    if recorded and args.use is not None:
        args.wrong_usage("argument --use: for marker takes, not for a .perftake")
    if is_recorded(args.out) and not recorded:
        args.wrong_usage("argument --out: perfanim take import makes a .perftake of other takes")
    if is_recorded(args.out) and args.smooth is not None:
        args.wrong_usage("argument --smooth: a .perftake holds poses as they are solved")
    if is_recorded(args.out) and args.feet != "off":
        args.wrong_usage("argument --feet: a .perftake holds poses as they are solved")
    if not is_recorded(args.out) and not is_motion(args.out):
        advice = f"use {', '.join((*MOTION_ENDINGS, ENDING))}"
        raise FormatError("cannot be written (no motion has this ending)", where=str(args.out), advice=advice)


def solve(
    args: argparse.Namespace, progress: Callable[[float, str], None], store: SessionCache
) -> tuple[SolvedTake, dict[str, Any]]:
    """Solve the take of the command's options, write what they ask for; return poses and motion, and facts.

    Args:
        args: the options, checked.
        progress: told how far it is.
        store: what takes that are solved one after another share.
    """
    solve_kind = _solve_recorded if is_recorded(args.take) else _solve_markers
    solved, facts = solve_kind(args, progress, store)
    motions = list(solved.motions)
    if args.smooth is not None:
        motions = [smooth_motion(motion, args.smooth) for motion in motions]
    if args.feet != "off":
        floor_m = _floor_m(args)
        motions = [with_feet_held(motion, args.feet, floor_m) for motion in motions]
    if not is_recorded(args.out):
        outs = [args.out, *(performer["out"] for performer in facts.get("performers", ()))]
        for motion, out in zip(motions, outs, strict=True):
            facts["fps"] = write_motion(motion, out, args.units, args.naming, args.rate).fps
    return replace(solved, motions=tuple(motions)), facts


def _floor_m(args: argparse.Namespace) -> float | None:
    """Return the height of the floor that the calibration tells of, None where there is none."""
    if args.cameras is not None:
        return floor_of(load_rig(args.cameras))
    return floor_of(read_take_file(args.take).setup.camera_rig()) if is_recorded(args.take) else None


def _solve_markers(
    args: argparse.Namespace, progress: Callable[[float, str], None], store: SessionCache
) -> tuple[SolvedTake, dict[str, Any]]:
    """Solve labelled markers."""
    take = read_take(args.take)
    if args.names is not None:
        take = rename_labels(take, load_names(args.names))
    marker_set = _marker_set(args, take)
    subject = _subject(args, marker_set)
    if args.up is not None:
        take = import_take(take, subject.marker_set, args.up)
    elif not is_unnamed(take):
        take = match_labels(take.names, subject.marker_set).rename(take)
    if args.smooth is not None:
        take = smooth_take(take, args.smooth)
    settings, database = SolveSettings(method=args.method or "best"), store.database(args.database)
    worn, facts = _few(args.use, take, subject, database) if args.use is not None else (worn_in(take, subject), {})
    solved = solve_take(take, worn, database, settings, progress, store.session)
    if args.use is not None:
        facts["left_out_rms_mm"] = 1e3 * _left_out_rms_m(take, subject, worn, solved.motion)
    names = subject.marker_set.names
    return solved, {
        "method": settings.method,
        "marker_set": subject.marker_set.name,
        "markers": sum(name in take.names for name in names),
        "warnings": _differences(take, subject),
    } | facts


def _few(use: str, take: MarkerTake, subject: Subject, database: Database) -> tuple[Subject, dict[str, Any]]:
    """Return the subject with the markers that `--use` asks for, and what is to be told of the choice."""
    if not use.strip().isdigit():
        named = [name.strip() for name in use.split(",") if name.strip()]
        worn = with_markers(subject, named)
        return worn, {"used": list(worn.marker_set.names)}
    seen = [name for name, visible in zip(take.names, take.visible.T, strict=True) if visible.any()]
    choice = choose_markers(subject, database, int(use), seen)
    worn = with_markers(subject, choice.names)
    return worn, {"used": list(choice.names), "expected_mm": (1e3 * choice.expected_m).round(1).tolist()}


def _left_out_rms_m(take: MarkerTake, subject: Subject, worn: Subject, motion: Motion) -> float:
    """Return the root mean square distance of the markers that were not solved with, NaN where there are none."""
    left_out = [n for n in subject.marker_set.names if n in take.names and n not in worn.marker_set.names]
    if not left_out:
        return float("nan")
    rest = subject.marker_set.subset(left_out)
    joints = rest.joint_indices(motion.skeleton)
    solved = marker_positions(motion.skeleton, joints, rest.offsets_m, motion.rotations, motion.root_positions_m)
    measured = take.positions_m[:, [take.names.index(name) for name in rest.names]]
    return float(np.sqrt(np.nanmean(np.sum((solved - measured) ** 2, axis=-1))))


def _solve_recorded(
    args: argparse.Namespace, progress: Callable[[float, str], None], store: SessionCache
) -> tuple[SolvedTake, dict[str, Any]]:
    """Solve what cameras saw, with what was in use then unless something else is given."""
    take = read_take_file(args.take)
    setup = take.setup
    rig, frames = setup.camera_rig(), take.frames
    if args.cameras is not None:
        from ..vision.relocate import retriangulate  # images' libraries are slow to load

        progress(0.0, "locating the markers anew")
        rig = load_rig(args.cameras)
        frames = tuple(retriangulate(rig, frames))
    chosen = load_marker_set(args.marker_set) if args.marker_set is not None else None
    first, *further = setup.subjects()
    subject = _subject(args, chosen, first)
    try:
        settings = SolveSettings.of_table(dict(setup.settings) | ({"method": args.method} if args.method else {}))
    except TypeError as error:
        raise TakeError(f"was solved with settings that are unknown here ({error})", where=str(args.take)) from error
    path = args.database or setup.database.get("path", "")
    if not path:
        raise TakeError("does not tell its motion database", where=str(args.take), advice="give --database")
    database = store.database(path)
    if is_recorded(args.out) and Path(args.out).exists() and Path(args.out).samefile(args.take):
        raise TakeError("would be overwritten", where=str(args.out), advice="give another name")
    props = tuple(load_prop(path) for path in args.prop) if args.prop else setup.carried_props()
    if args.performer:
        further = [load_subject(path) for path in args.performer]
    capture = CaptureSetup(rig, (subject, *further), props, database, settings)
    solved = solve_recorded(take, frames, capture, progress, store.session)
    if is_recorded(args.out):
        save_resolved_take(args.out, take, frames, capture, solved)
    warnings = list(take.problems)
    if args.database is None and identity(database)["sha256"] != setup.database.get("sha256"):
        warnings.append(f"{path} has changed since the take was recorded")
    facts = {"method": settings.method, "warnings": warnings, "complete": take.complete}
    if props:
        facts["props"] = _props_found(args, take, solved, props)
    if further:
        facts["performers"] = _further_performers(args, take, solved, further)
    return solved, facts


def _props_found(
    args: argparse.Namespace, take: TakeFile, solved: SolvedTake, props: Sequence[Prop]
) -> dict[str, float]:
    """Return in which share of the frames each prop was found; beside a motion, write where they were."""
    poses = [pose for pose in solved.poses if take.is_recorded(pose.number)]
    if not is_recorded(args.out):
        for index, prop in enumerate(props):
            write_prop_csv(poses, index, prop.name, solved.motion.fps, _beside(args.out, prop.name, ".csv"))
    return {prop.name: sum(pose.props[index].found for pose in poses) / len(poses) for index, prop in enumerate(props)}


def _further_performers(
    args: argparse.Namespace, take: TakeFile, solved: SolvedTake, performers: Sequence[Subject]
) -> list[dict[str, Any]]:
    """Return name and mean confidence of each further performer, and the file for a motion beside the first's."""
    facts = []
    names = [subject.name for subject in performers]
    for index, name in enumerate(names):
        sure = [pose.confidence for pose in solved.poses_of(1 + index) if take.is_recorded(pose.number)]
        fact: dict[str, Any] = {"name": name, "confidence": float(np.mean(sure))}
        if not is_recorded(args.out):
            unlike = name if names.count(name) == 1 else f"{name}-{index + 2}"
            fact["out"] = str(_beside(args.out, unlike, Path(args.out).suffix))
        facts.append(fact)
    return facts


def _beside(out: str, name: str, ending: str) -> Path:
    """Return the file for a further target beside the performer's motion."""
    plain = "".join(c if c.isalnum() or c in "-_" else "-" for c in name)
    return Path(out).with_name(f"{Path(out).stem}.{plain}{ending}")


def _differences(take: MarkerTake, subject: Subject) -> list[str]:
    """Return what tells that the take was recorded with other markers than the subject's."""
    if is_unnamed(take):
        return []
    worn = subject.marker_set.names
    lacking = [name for name in worn if name not in take.names]
    unused = [name for name in take.names if name not in worn]
    return [f"not in the take: {', '.join(lacking)}"] * bool(lacking) + [
        f"not in the marker set, left out: {', '.join(unused)}"
    ] * bool(unused)


def _marker_set(args: argparse.Namespace, take: MarkerTake) -> MarkerSet | None:
    """Return the marker set that is asked for, None for the subject's."""
    if args.marker_set == AUTO:
        return match_best_set(take.names, str(args.take)).marker_set
    return load_marker_set(args.marker_set) if args.marker_set is not None else None


def _subject(args: argparse.Namespace, chosen: MarkerSet | None, recorded: Subject | None = None) -> Subject:
    """Return who performs, with the markers of the chosen set, or the subject's own."""
    if args.skeleton is not None:
        if chosen is None:
            raise SubjectError("--skeleton needs --marker-set", advice="name the marker set that was worn")
        return Subject(Path(args.skeleton).stem, read_skeleton(args.skeleton), chosen)
    subject = load_subject(args.subject) if args.subject is not None or recorded is None else recorded
    if chosen is None:
        return subject
    known = {marker.name: marker for marker in subject.marker_set.markers}
    uncalibrated = [m.name for m in chosen.markers if m.name not in known and m.offset_m is None]
    if uncalibrated:
        raise SubjectError(
            "no offset is known for " + ", ".join(uncalibrated),
            where=str(args.subject or args.take),
            advice="calibrate the subject with this marker set",
        )
    markers = tuple(known.get(marker.name, marker) for marker in chosen.markers)
    return Subject(subject.name, subject.skeleton, MarkerSet(chosen.name, markers), subject.residual_m)
