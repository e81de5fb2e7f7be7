"""`perfanim take import`: marker takes of other systems as recorded takes."""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...body.standard_skeleton import default_skeleton
from ...database.store import Database, open_database
from ...errors import FormatError, MarkerSetError, PerfanimError, SubjectError, TakeError
from ...formats.markers.marker_files import READABLE, declared_frames, is_recorded, read_take
from ...formats.take_file.take_edits import recover
from ...formats.take_file.take_reader import ENDING, read_take_file, take_name, unused_path
from ...labelling.take_import import UPS, import_take
from ...markers.label_matching import AUTO, load_names, match_best_set, rename_labels
from ...markers.marker_set import MarkerSet, load_marker_set
from ...markers.subject import Subject, load_subject
from ...markers.take_frames import is_unnamed
from ...session.save_solved_take import save_imported_take
from ...solver.marker_selection import worn_in
from ...solver.settings import METHODS, SolveSettings
from ...system.progress import Progress
from ..options import add_choice, add_names_option, add_number, add_text, check_height

_DOUBTFUL_MM = 100.0  # live, solved markers so far off mean that labels or pose are wrong


def add_parser(group: Any) -> None:
    parser = group.add_parser("import", help="solve marker takes of other systems and keep them as recorded takes")
    parser.add_argument("takes", nargs="+", metavar="TAKE", help=f"{', '.join(READABLE)}; a {ENDING} is copied")
    add_text(parser, "--out", "DIR", f"folder for NAME{ENDING}; none is replaced", required=True)
    add_text(parser, "--database", "DB", "motion database", required=True)
    parser.add_argument(
        "--subject", metavar="FILE", help="calibrated subject (default: an average body, markers at their usual places)"
    )
    add_number(parser, "--height", "M", "of the average body (default 1.75)", default=1.75)
    parser.add_argument(
        "--marker-set",
        metavar="NAME",
        help=f"shipped marker set or TOML file, or {AUTO}: the shipped one to which most of a take's labels belong "
        f"(default: the subject's, {AUTO} without a subject)",
    )
    add_names_option(parser)
    add_choice(parser, "--method", METHODS, "how poses are found (default best)", default="best")
    parser.add_argument(
        "--up",
        choices=UPS,
        default="auto",
        help="axis of the file that points up: auto for that which the performer stands along (default), feet for the "
        "floor on which the feet stand, which becomes y = 0",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Keep marker takes as recorded ones; a bad one does not keep the others out."""
    progress(0.0, "reading")
    if args.subject is None:
        check_height(args.height)
    database = open_database(args.database)
    chosen = load_marker_set(args.marker_set) if args.marker_set not in (None, AUTO) else None
    by_take = args.marker_set == AUTO or (args.marker_set is None and args.subject is None)
    subject = None if by_take else _subject(args, chosen)
    names = load_names(args.names) if args.names is not None else {}
    kept: list[dict[str, Any]] = []
    failed: list[PerfanimError] = []
    for number, path in enumerate(args.takes):
        share = 1.0 / len(args.takes)

        def part(fraction: float, text: str, done: float = number * share, share: float = share) -> None:
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
    """Return the subject with the markers of the set, or else with its own."""
    if args.subject is None:
        assert marker_set is not None  # noqa: S101 - without a subject the labels choose a set
        return Subject("average body", default_skeleton(args.height), marker_set)
    subject = load_subject(args.subject)
    return subject if marker_set is None else subject.wearing(marker_set)


def _import_one(
    args: argparse.Namespace,
    path: Path,
    subject: Subject | None,
    names: Mapping[str, str],
    database: Database,
    progress: Progress,
) -> dict[str, Any]:
    """Write one take and return its facts.

    Without a subject the take's labels choose the marker set.
    """
    progress(0.0, f"reading {path.name}")
    if is_recorded(path):
        recorded = read_take_file(path)
        out = unused_path(Path(args.out), recorded.notes.name)
        recover(recorded, out)
        warnings = [*recorded.problems, *([] if recorded.poses else [f"{out.stem} has no poses yet: solve it again"])]
        return {"take": path.name, "frames": recorded.frame_count, "warnings": warnings, "out": str(out)}
    take = read_take(path)
    declared = declared_frames(path)
    warnings = [f"{path.name} holds {take.frames} of {declared} frames"] * (take.frames < declared)
    take = rename_labels(take, names) if names else take
    subject = subject or _subject(args, match_best_set(take.names, str(path)).marker_set)
    take = import_take(replace(take, name=_stem(path)), subject.marker_set, args.up)
    lacking = [] if is_unnamed(take) else [name for name in subject.marker_set.names if name not in take.names]
    warnings += [f"not in {path.name}: {', '.join(lacking)}"] * bool(lacking)
    out = unused_path(Path(args.out), take.name)
    take = replace(take, name=take_name(out))  # takes of one name differ in a list, too
    capture = {"imported": str(path), "up": args.up}
    worn, settings = worn_in(take, subject), SolveSettings(method=args.method)
    solved = save_imported_take(out, take, worn, database, settings, capture, progress)
    figures = solved.summary()
    if not figures["marker_rms_mm"] <= _DOUBTFUL_MM:
        off = f"{figures['marker_rms_mm']:.0f} mm off"
        warnings.append(f"no body explains the markers of {path.name} ({off}): check marker set and performer")
    matched = {"marker_set": subject.marker_set.name, "markers": len(subject.marker_set) - len(lacking)}
    return {"take": path.name, "warnings": warnings, "out": str(out)} | matched | figures


def _stem(path: Path) -> str:
    """Return a file's name without the ending of its format."""
    ending = next((ending for ending in READABLE if path.name.lower().endswith(ending)), "")
    return path.name[: len(path.name) - len(ending)] or path.name
