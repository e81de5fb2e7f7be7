"""`perfanim take import`: convert marker takes, films and pictures to recorded takes."""

import argparse
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...api.recordings import FilmedTake, find_recordings
from ...api.solving import SolveRequest, solve_markers, solve_unmeasured
from ...api.take_reading import fit_take, labelled_by, read_labelled
from ...body.foot_lock import floor_of
from ...body.standard_skeleton import default_skeleton
from ...database.starter_database import starter_database
from ...database.store import Database, open_database
from ...errors import FormatError, MarkerSetError, PerfanimError, SubjectError, TakeError
from ...formats.markers.marker_files import READABLE, is_recorded
from ...formats.take_file.take_reader import ENDING, read_take_file, take_name, unused_path
from ...formats.take_file.take_recovery import recover
from ...geometry.camera import CameraRig
from ...labelling.take_import import UPS
from ...markers.label_faults import told
from ...markers.label_matching import AUTO, load_names
from ...markers.marker_set import MarkerSet, load_marker_set
from ...markers.marker_take import MarkerTake, SingleViews
from ...markers.subject import Subject, load_subject
from ...markers.take_frames import is_unnamed
from ...session.verdict import Reason, ReasonKind
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
    parser = add_command(group, "import", run, "solve marker takes, films or pictures and keep them as recorded takes")
    sources = (
        f"{', '.join(READABLE)} (a {ENDING} is copied); or the films or folders of pictures of one take, one for each "
        "camera; a folder stands for what is in it"
    )
    parser.add_argument("takes", nargs="+", metavar="TAKE", help=sources)
    add_text(parser, "--out", "DIR", f"folder for NAME{ENDING}; existing takes are kept", required=True)
    add_text(parser, "--database", "DB", "motion database (default: the starter database)")
    calibration = "for films or pictures: the calibration (default: the one beside them)"
    add_text(parser, "--cameras", "cameras.toml", calibration)
    network = "films or pictures show a person without markers: use this body network (default: the one that is here)"
    parser.add_argument("--people", metavar="NETWORK", nargs="?", const="", help=network)
    add_text(parser, "--subject", "FILE", "calibrated subject (default: a body is fitted to the motion)")
    height = "use an average body of this height, with the markers at their usual positions, instead of a fitted one"
    add_number(parser, "--height", "M", height)
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


@dataclass(frozen=True)
class _Import:
    """What the takes of one import share.

    Args:
        subject: Performer; None if the body is fitted to each take, or the labels determine the markers.
        names: Marker for each label that matches none.
    """

    args: argparse.Namespace
    subject: Subject | None
    names: Mapping[str, str] | None
    database: Database


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Solve takes and store them as recorded takes; a bad one does not stop the others."""
    progress(0.0, "reading")
    check_height(args.height)
    takes, filmed = find_recordings(args.takes, args.cameras)
    database = open_database(args.database or starter_database(progress))
    chosen = load_marker_set(args.marker_set) if args.marker_set not in (None, AUTO) else None
    names = load_names(args.names) if args.names is not None else None
    shared = _Import(args, _subject(args, chosen), names, database)
    kept: list[dict[str, Any]] = []
    failed: list[PerfanimError] = []
    items: list[Path | FilmedTake] = [*takes, *([filmed] if filmed else [])]
    share = 1.0 / len(items)
    for number, item in enumerate(items):

        def part(fraction: float, text: str, done: float = number * share) -> None:
            progress(done + share * fraction, text)

        try:
            kept.append(
                _import_file(shared, item, part) if isinstance(item, Path) else _import_filmed(shared, item, part)
            )
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


def _subject(args: argparse.Namespace, marker_set: MarkerSet | None) -> Subject | None:
    """Return the subject with the markers of the set, or with its own; None if it depends on the take."""
    if args.subject is not None:
        if args.marker_set == AUTO:
            return None
        subject = load_subject(args.subject)
        return subject if marker_set is None else subject.wearing(marker_set)
    return _average(args, marker_set) if args.height is not None and marker_set is not None else None


def _average(args: argparse.Namespace, marker_set: MarkerSet) -> Subject:
    return Subject("average body", default_skeleton(args.height), marker_set)


def _import_file(shared: _Import, path: Path, progress: Progress) -> dict[str, Any]:
    """Import one file and return facts about it."""
    progress(0.0, f"reading {path.name}")
    if is_recorded(path):
        return _copy_recorded(path, Path(shared.args.out))
    take = replace(read_labelled(path, shared.names), name=_stem(path))
    return _import_take(shared, take, path, shared.args.marker_set or AUTO, shared.args.up, progress)


class _Tracked(NamedTuple):
    """Films or pictures in which markers were found, and why these are doubtful."""

    filmed: FilmedTake
    doubts: list[str]


def _import_filmed(shared: _Import, filmed: FilmedTake, progress: Progress) -> dict[str, Any]:
    """Track the markers, or the person, and import the trajectories."""
    from ...api.tracking import GUESSED, TrackRequest, track  # OpenCV is slow to load
    from ...vision.people.body_network import BlazePose
    from ...vision.people.network_file import body_network_file

    args = shared.args
    people = None if args.people is None else args.people or str(body_network_file())
    named = BlazePose.marker_set if people else args.marker_set
    worn = shared.subject.marker_set if shared.subject is not None else None
    worn = load_marker_set(named) if named not in (None, AUTO) else worn
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, f"{filmed.name}.take.npz")
        subject = None if people else shared.subject
        request = TrackRequest(
            filmed.rig, filmed.sources, str(file), worn, subject, shared.database if subject else None, people=people
        )
        facts = track(request, lambda share, text: progress(0.5 * share, f"{filmed.name}: {text}"))
        take = replace(read_labelled(file, shared.names), name=filmed.name)
    up = "y" if floor_of(filmed.rig) is not None else "feet"
    where = Path(filmed.sources[0]).parent

    def solving(share: float, text: str) -> None:
        progress(0.5 + 0.5 * share, text)

    tracked = _Tracked(filmed, facts.get("doubts", []))
    done = _import_take(shared, take, where, named or AUTO, up, solving, tracked)
    told_before = [text for text in facts["warnings"] if text != GUESSED]
    return done | {"cameras": str(filmed.calibration), "warnings": [*told_before, *done["warnings"]]}


def _import_take(
    shared: _Import,
    take: MarkerTake,
    path: Path,
    named: str,
    up: str,
    progress: Progress,
    tracked: _Tracked | None = None,
) -> dict[str, Any]:
    """Solve a take, store it and return facts about it.

    Args:
        path: File or source of the take, for messages.
        named: Name of the marker set, or "auto".
        tracked: Films or pictures in which its markers were found.
    """
    args, subject, worn = shared.args, shared.subject, None
    if subject is None:
        take, worn = labelled_by(named, take, shared.database, str(path), progress)
        if args.subject is not None:
            subject = load_subject(args.subject).wearing(worn)
        elif args.height is not None:
            subject = _average(args, worn)
    marker_set = subject.marker_set if subject is not None else worn
    assert marker_set is not None  # noqa: S101 - there is a set if there is no subject
    warnings = list(take.notes)
    origin: dict[str, Any] = {"imported": str(path), "up": up}
    if tracked is not None:
        origin["tracked"] = list(tracked.filmed.sources)
        take = _with_cameras(take, tracked.filmed.rig)
    take = fit_take(take, marker_set, up)
    lacking = [] if is_unnamed(take) else [name for name in marker_set.names if name not in take.names]
    warnings += [f"not in {path.name}: {', '.join(lacking)}"] if lacking else []
    out = unused_path(Path(args.out), take.name)
    take = replace(take, name=take_name(out))  # so that takes of the same name can be told apart in lists
    by_labels = args.marker_set == AUTO or (args.marker_set is None and args.subject is None)
    request = request_of(SolveRequest, args, place_markers=by_labels)
    if subject is not None:
        solved = solve_markers(take, subject, shared.database, request, progress)
    else:
        solved = solve_unmeasured(take, AUTO if named == AUTO else marker_set, shared.database, request, progress)
    if tracked is not None:
        doubts = (Reason(ReasonKind.LABELS, text) for text in tracked.doubts)
        solved = replace(solved, findings=(*solved.findings, *doubts))
    warnings += [note for note in take.notes if note not in warnings]
    warnings += solved.clock.sentences if solved.clock is not None else []
    solved.save(out, capture=origin)
    warnings += [f"{path.name}: {text}" for text in told(solved.corrected)]
    if not solved.verdict.is_good:
        warnings.append(f"{path.name}: {solved.verdict.text}")
    facts = solved.summary() | {"verdict": solved.verdict.text}
    if tracked is not None and up == "feet" and take.single is not None:
        facts["camera_heights_mm"] = take.single.rig.heights_mm
    matched = {"marker_set": marker_set.name, "markers": len(marker_set) - len(lacking)}
    return {"take": path.name, "warnings": warnings, "out": str(out)} | matched | facts


def _with_cameras(take: MarkerTake, rig: CameraRig) -> MarkerTake:
    """Return a take that knows its cameras, so that they are moved along with its markers."""
    if take.single is not None or len(rig) == 1:
        return take
    shape = take.positions_m.shape[:2]
    return replace(take, single=SingleViews(rig, np.full(shape, -1), np.full((*shape, 2), np.nan)))


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
