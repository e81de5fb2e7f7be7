"""`perfanim take import`: convert marker takes of other systems to recorded takes."""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...api.solving import SolveRequest, solve_markers
from ...api.take_reading import fit_take, labelled_by, read_labelled
from ...body.standard_skeleton import default_skeleton
from ...database.starter_database import starter_database
from ...database.store import Database, open_database
from ...errors import FormatError, MarkerSetError, PerfanimError, SubjectError, TakeError
from ...formats.markers.marker_files import READABLE, is_recorded
from ...formats.take_file.take_reader import ENDING, read_take_file, take_name, unused_path
from ...formats.take_file.take_recovery import recover
from ...labelling.take_import import UPS
from ...markers.label_faults import told
from ...markers.label_matching import AUTO, load_names
from ...markers.marker_set import MarkerSet, load_marker_set
from ...markers.subject import Subject, load_subject
from ...markers.take_frames import is_unnamed
from ...system.progress import Progress
from ..options import (
    add_choice,
    add_command,
    add_number,
    add_request_options,
    add_text,
    check_height,
    request_of,
)
from ..performer_options import add_names_option


def add_parser(group: Any) -> None:
    parser = add_command(group, "import", run, "solve marker takes of other systems and keep them as recorded takes")
    parser.add_argument("takes", nargs="+", metavar="TAKE", help=f"{', '.join(READABLE)}; a {ENDING} is copied")
    add_text(parser, "--out", "DIR", f"folder for NAME{ENDING}; existing takes are kept", required=True)
    add_text(parser, "--database", "DB", "motion database (default: the starter database)")
    body = "calibrated subject (default: an average body with the markers at their usual positions)"
    add_text(parser, "--subject", "FILE", body)
    add_number(parser, "--height", "M", "height of the average body (default 1.75)", default=1.75)
    add_text(
        parser,
        "--marker-set",
        "NAME",
        f"shipped marker set or TOML file, or {AUTO}: the shipped set that matches most of a take's labels; other "
        "markers are placed from the motion (default: the subject's, or the set that matches most labels)",
    )
    add_names_option(parser)
    add_request_options(parser, SolveRequest, method="--method", trust_labels="--trust-labels")
    add_choice(
        parser,
        "--up",
        UPS,
        "axis of the file that points up: auto for the one along which the performer stands (default), feet to fit "
        "the floor to the feet and make it y = 0",
        default="auto",
    )


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Solve marker takes and store them as recorded takes; a bad one does not stop the others."""
    progress(0.0, "reading")
    if args.subject is None:
        check_height(args.height)
    database = open_database(args.database or starter_database(progress))
    chosen = load_marker_set(args.marker_set) if args.marker_set not in (None, AUTO) else None
    by_take = args.marker_set == AUTO or (args.marker_set is None and args.subject is None)
    subject = None if by_take else _subject(args, chosen)
    names = load_names(args.names) if args.names is not None else None
    kept: list[dict[str, Any]] = []
    failed: list[PerfanimError] = []
    share = 1.0 / len(args.takes)
    for number, path in enumerate(args.takes):

        def part(fraction: float, text: str, done: float = number * share) -> None:
            progress(done + share * fraction, text)

        try:
            kept.append(_import_one(args, Path(path), subject, names, database, part))
        except (FormatError, TakeError, MarkerSetError, SubjectError) as error:
            failed.append(error)
    if not kept:
        raise failed[0]
    return {
        "frames": sum(take["frames"] for take in kept),
        "takes": kept,
        "failed": [str(error) for error in failed],
        "out": str(args.out),
    }


def _subject(args: argparse.Namespace, marker_set: MarkerSet | None) -> Subject:
    """Return the subject with the markers of the set, or with its own; an average body if none is named."""
    if args.subject is not None:
        subject = load_subject(args.subject)
        return subject if marker_set is None else subject.wearing(marker_set)
    assert marker_set is not None  # noqa: S101 - without a subject, the labels determine the set
    return Subject("average body", default_skeleton(args.height), marker_set)


def _import_one(
    args: argparse.Namespace,
    path: Path,
    subject: Subject | None,
    names: Mapping[str, str] | None,
    database: Database,
    progress: Progress,
) -> dict[str, Any]:
    """Import one take and return facts about it; without a subject, the take's labels determine the marker set."""
    progress(0.0, f"reading {path.name}")
    if is_recorded(path):
        return _copy_recorded(path, Path(args.out))
    take = read_labelled(path, names)
    if subject is None:
        take, worn = labelled_by(AUTO, take, database, str(path), progress)
        subject = _subject(args, worn)
    warnings = list(take.notes)
    take = fit_take(replace(take, name=_stem(path)), subject.marker_set, args.up)
    lacking = [] if is_unnamed(take) else [name for name in subject.marker_set.names if name not in take.names]
    warnings += [f"not in {path.name}: {', '.join(lacking)}"] if lacking else []
    out = unused_path(Path(args.out), take.name)
    take = replace(take, name=take_name(out))  # so that takes of the same name can be told apart in lists
    request = request_of(SolveRequest, args, place_markers=args.marker_set == AUTO)
    solved = solve_markers(take, subject, database, request, progress)
    warnings += [note for note in take.notes if note not in warnings]
    warnings += solved.clock.sentences if solved.clock is not None else []
    solved.save(out, capture={"imported": str(path), "up": args.up})
    warnings += [f"{path.name}: {text}" for text in told(solved.corrected)]
    if not solved.verdict.is_good:
        warnings.append(f"{path.name}: {solved.verdict.text}")
    facts = solved.summary() | {"verdict": solved.verdict.text}
    matched = {"marker_set": subject.marker_set.name, "markers": len(subject.marker_set) - len(lacking)}
    return {"take": path.name, "warnings": warnings, "out": str(out)} | matched | facts


def _copy_recorded(path: Path, folder: Path) -> dict[str, Any]:
    recorded = read_take_file(path)
    out = unused_path(folder, recorded.notes.name)
    recover(recorded, out)
    warnings = [*recorded.problems, *([] if recorded.poses else [f"{out.stem} has no poses yet: solve it"])]
    return {"take": path.name, "frames": recorded.frame_count, "warnings": warnings, "out": str(out)}


def _stem(path: Path) -> str:
    """Return a file name without its extension."""
    ending = next((ending for ending in READABLE if path.name.lower().endswith(ending)), "")
    return path.name[: len(path.name) - len(ending)] or path.name
