"""`perfanim calibrate subject`: measure skeleton and marker offsets from held poses, or from motion alone."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...api.calibration import calibrate_subject, fit_subject
from ...api.take_reading import fit_take, labelled_by, read_labelled
from ...body.calibration_poses import CALIBRATION, POSES
from ...body.standard_skeleton import default_skeleton
from ...database.store import open_database
from ...errors import SettingsError, SubjectError
from ...formats.markers.marker_files import is_recorded
from ...formats.take_file.take_reader import read_take_file
from ...markers.label_faults import correct_labels, told
from ...markers.label_matching import AUTO
from ...markers.marker_set import MarkerSet
from ...markers.marker_take import MarkerTake
from ...markers.subject import Subject, load_subject, save_subject
from ...session.limb_coverage import coverage_text, open_limbs
from ...subjects.contradictions import moved_markers
from ...subjects.from_motion import frames_of
from ...subjects.pose_calibration import SubjectCalibration
from ...subjects.refine_body import Refinement, refine_body
from ...subjects.refinement_text import worthwhile
from ...system.progress import Progress
from ..options import add_choice, add_command, add_number, add_text, check_height
from ..performer_options import add_names_option


def add_parser(group: Any) -> None:
    parser = add_command(group, "subject", run, "skeleton and marker offsets from held poses")
    parser.add_argument("take", metavar="TAKE", help="take that shows the calibration pose, held still for a second")
    worn = f"shipped marker set or TOML file, or {AUTO} to choose by the labels (default with --refine: the subject's)"
    add_text(parser, "--marker-set", "NAME", worn)
    add_names_option(parser)
    add_text(parser, "--out", "subject.toml", "subject to write", required=True)
    add_text(parser, "--name", "NAME", "name of the person (default: --skeleton-from's, or the file's)")
    held = parser.add_mutually_exclusive_group()
    add_choice(held, "--pose", POSES, "the pose that is held (default t)", default="t")
    add_text(
        held,
        "--poses",
        "P,P,...",
        "several poses, each held somewhere in the take for --seconds, an upright one first; best are "
        f"{','.join(CALIBRATION)}, which locate the shoulders",
    )
    add_number(parser, "--seconds", "S", "how long each pose is held (default 1)", default=1.0)
    add_text(parser, "--frames", "A:B", "use only these frames of the take")
    bones = "keep this subject's bones and measure only the markers, after one was added, removed or moved"
    add_text(parser, "--skeleton-from", "subject.toml", bones)
    add_text(
        parser,
        "--database",
        "DB",
        "without a held pose, fit bones and offsets to motion from the whole take, guided by poses from this motion "
        "database and by the marker set's usual offsets",
    )
    add_text(
        parser,
        "--refine",
        "subject.toml",
        "with --database: start from this subject, or the first of a .perftake, and correct bones and offsets "
        "slightly to fit the motion",
    )
    add_number(
        parser,
        "--height",
        "M",
        "with --database: height of the person, metres (default: estimated from the distances between markers)",
    )


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    if not 0.0 < args.seconds <= 60.0:
        raise SettingsError(f"--seconds {args.seconds:g} is out of range", advice="give more than 0, up to 60")
    progress(0.0, "reading")
    take = read_labelled(args.take, args.names)
    if args.refine and (not args.database or args.height is not None):
        raise SettingsError(
            "--refine needs --database and excludes --height", advice="add --database and leave --height out"
        )
    known = load_subject(args.skeleton_from) if args.skeleton_from else None
    before = _subject_of(args.refine) if args.refine else known
    if args.marker_set is None and not args.refine:
        raise SettingsError("no marker set is named", advice="give --marker-set")
    if args.marker_set is None and before:
        marker_set = before.marker_set
    else:
        database = open_database(args.database) if args.database else None
        take, marker_set = labelled_by(args.marker_set, take, database, str(args.take), progress)
    take = part(fit_take(take, marker_set, None if is_recorded(args.take) else "auto"), args.frames)
    name = args.name or (before.name if before else Path(args.out).stem)
    bones = before.skeleton if before else default_skeleton()
    take, faults = correct_labels(take, Subject(name, bones, marker_set))
    if args.database:
        if known:
            raise SettingsError("--skeleton-from and --database cannot be used together", advice="leave one out")
        subject, facts = _from_motion(args, take, marker_set, before, name, progress)
    else:
        poses = args.poses.split(",") if args.poses else args.pose
        result = calibrate_subject(take, marker_set, poses, name, args.seconds, known)
        subject, facts = result.subject, _trust(result)
    save_subject(subject, args.out)
    lengths = np.linalg.norm(subject.skeleton.tips_m, axis=1)
    return {
        "bones_mm": {joint: 1e3 * float(n) for joint, n in zip(subject.skeleton.names, lengths, strict=True)},
        "offsets_mm": {
            marker: (1e3 * np.asarray(offset)).round(1).tolist()
            for marker, offset in zip(subject.marker_set.names, subject.marker_set.offsets_m, strict=True)
        },
        "residual_mm": 1e3 * subject.residual_m,
        **facts,
        "warnings": [*take.notes, *told([fault.stretch(take) for fault in faults])],
        "out": str(args.out),
    }


def _trust(result: SubjectCalibration) -> dict[str, Any]:
    return {
        "marker_residuals_mm": {marker: round(1e3 * off, 1) for marker, off in result.marker_residuals_m.items()},
        "open_mm": {joint: round(1e3 * sigma, 1) for joint, sigma in result.sigmas_m.items()},
        "verdict": result.verdict,
        "advice": list(result.advice),
    }


def _from_motion(
    args: argparse.Namespace,
    take: MarkerTake,
    marker_set: MarkerSet,
    before: Subject | None,
    name: str,
    progress: Progress,
) -> tuple[Subject, dict[str, Any]]:
    """Return the subject estimated from motion, and facts about it."""
    database = open_database(args.database)
    if before:
        worn = replace(before.wearing(marker_set), name=name)
        result = refine_body(take, worn, database, progress)
        subject, changes = worthwhile(worn, result)
        return subject, {"changes": changes} | _changes(result)
    check_height(args.height)
    named = AUTO if args.marker_set == AUTO else marker_set
    subject = fit_subject(take, database, named, args.height, name, progress)
    doubtful = subject.residual_m > 0.015  # RMS distance, m: a larger one means a body that does not explain the motion
    advice = ["check --marker-set, or record a calibration pose"] if doubtful else []
    return subject, worn_facts(fit_take(take, marker_set, None), marker_set, subject) | {"advice": advice}


def worn_facts(take: MarkerTake, usual: MarkerSet, subject: Subject) -> dict[str, Any]:
    """Return how many of a take's markers are known, and which known ones are far from their usual positions."""
    shown = [name for name, visible in zip(take.names, take.visible.T, strict=True) if visible.any()]
    return {
        "coverage": coverage_text(subject.marker_set, shown, open_limbs(subject.marker_set, shown)),
        "moved_mm": {name: round(1e3 * off, 1) for name, off in moved_markers(subject, usual).items()},
    }


def _subject_of(path: str) -> Subject:
    """Return the subject of a file, or the first performer of a recorded take."""
    if not is_recorded(path):
        return load_subject(path)
    recorded = read_take_file(path).setup.subjects()
    if not recorded:
        raise SubjectError("names no performer", where=path, advice="solve the take first")
    return recorded[0]


def _changes(result: Refinement) -> dict[str, Any]:
    return {
        "frames": result.frames,
        "evidence": round(result.evidence, 1),
        "whole_percent": round(100.0 * result.whole, 1),
        "whole_sigma_percent": round(100.0 * result.whole_sigma, 1),
        "sizes_percent": {part: round(100.0 * change, 1) for part, change in result.sizes.items()},
        "size_sigmas_percent": {part: round(100.0 * sigma, 1) for part, sigma in result.size_sigmas.items()},
        "offset_sigmas_mm": {marker: round(1e3 * sigma, 1) for marker, sigma in result.offset_sigmas_m.items()},
    }


def part(take: MarkerTake, text: str | None) -> MarkerTake:
    """Return the frames "A:B" of a take, or all if None; SettingsError if the range is invalid."""
    if text is None:
        return take
    start, colon, stop = text.partition(":")
    try:
        frames = slice(int(start) if start else None, int(stop) if stop else None)
    except ValueError:
        colon = ""
    if not colon:
        raise SettingsError(f"--frames {text!r} is not A:B", advice="give a range such as 0:90")
    if len(range(*frames.indices(take.frames))) == 0:
        raise SettingsError(
            f"--frames {text} selects no frames", where=take.name, advice=f"choose from 0:{take.frames}"
        )
    return frames_of(take, frames)
