"""`perfanim take`: what is in a recorded take, one that was cut off made whole, and its motion or markers."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import FormatError, SettingsError, TakeError
from ...formats.markers.marker_files import WRITABLE, declared_frames, is_recorded, read_take, write_take
from ...formats.markers.prop_csv import write_prop_csv
from ...formats.markers.recorded_take import marker_take
from ...formats.motion.write_motion import MOTION_ENDINGS, is_motion, write_motion
from ...formats.take_file.edit import recover
from ...formats.take_file.lock import is_locked
from ...formats.take_file.reading import ENDING, TakeFile, rate, read_take_file, take_name
from ...session.solve_take import by_performer, resample_uniform
from ..options import add_motion_options
from . import fill, import_takes

Progress = Callable[[float, str], None]


def add_parser(subparsers: Any) -> None:
    """Add the `take` command group."""
    parser = subparsers.add_parser("take", help="recorded takes: what is in them, recover, export")
    group = parser.add_subparsers(metavar="WHAT", required=True)
    info = group.add_parser("info", help="what is in a take, and whether all of it is there")
    info.add_argument("take", metavar="TAKE", help=f"{ENDING}, .c3d, .trc, .csv, .tsv or .take.npz")
    info.set_defaults(run=run_info)
    mend = group.add_parser("recover", help="write what is intact of a take that was cut off or damaged as a whole one")
    mend.add_argument("take", metavar="TAKE", help=f"recorded take ({ENDING}); it stays as it is")
    mend.add_argument("--out", metavar="TAKE", help=f"take to write (default: NAME-recovered{ENDING} beside it)")
    mend.set_defaults(run=run_recover)
    import_takes.add_parser(group)
    fill.add_parser(group)
    export = group.add_parser("export", help="motion or markers of a recorded take as they were solved live")
    export.add_argument(
        "take", metavar="TAKE", help=f"recorded take ({ENDING}); one that was cut off gives what it has"
    )
    export.add_argument(
        "--out",
        required=True,
        metavar="FILE",
        help=f"motion ({', '.join(MOTION_ENDINGS)}) or markers ({', '.join(WRITABLE)})",
    )
    add_motion_options(export)
    export.add_argument(
        "--prop", metavar="NAME", help="instead: where this prop was, as a table (.csv: metres, quaternion w first)"
    )
    export.add_argument(
        "--performer", metavar="NAME", help="motion of this further performer (default: of the first performer)"
    )
    export.set_defaults(run=run_export)


def run_info(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Return what is in a take."""
    progress(0.0, "reading")
    return _recorded_info(read_take_file(args.take)) if is_recorded(args.take) else _marker_info(args.take)


def _recorded_info(take: TakeFile) -> dict[str, Any]:
    frames, setup = take.frames, take.setup
    numbers = np.array([frame.number for frame in frames], dtype=np.int64)
    times_s = np.array([frame.time_s for frame in frames])
    subject = setup.worn_subject()
    rig = setup.camera_rig()
    poses = [solved.pose for solved in take.poses]
    return {
        "format": "recorded take",
        "name": take.notes.name,
        "frames": len(frames),
        "duration_s": float(times_s[-1] - times_s[0]) if len(frames) else 0.0,
        "fps": rate(times_s, numbers) if len(frames) > 1 else None,
        "complete": take.complete,
        "lost_frames": _left_out(numbers),
        "gaps": len(take.gaps),
        "gaps_s": sum(gap.seconds for gap in take.gaps),
        "markers": len(subject.marker_set),
        "names": list(subject.marker_set.names),
        "visible_fraction": float(np.mean([np.isfinite(p.observed_m[:, 0]) for p in poses])) if poses else None,
        "poses": len(poses),
        "confidence": float(np.mean([pose.confidence for pose in poses])) if poses else None,
        "cameras": len(rig) if rig is not None else 0,
        "subject": subject.name,
        "marker_set": subject.marker_set.name,
        "database": setup.database.get("path", ""),
        "props": _props_found(take),
        "performers": _performers_followed(take),
        "created": setup.created,
        "software": setup.software,
        "notes": take.notes.notes,
        "rating": take.notes.rating,
        "character": take.notes.character,
        "recorded": take.notes.recorded,
        "events": list(take.events),
        "bytes": take.path.stat().st_size,
        "problems": ["it is being recorded"] if is_locked(take.path) else take.problems,
    }


def _props_found(take: TakeFile) -> dict[str, float | None]:
    """Return in which share of the poses each prop was found."""
    found = [[prop.found for prop in solved.pose.props] for solved in take.poses]
    names = [prop.name for prop in take.setup.carried_props()]
    return {name: float(np.mean([row[i] for row in found])) if found else None for i, name in enumerate(names)}


def _performers_followed(take: TakeFile) -> list[dict[str, Any]]:
    """Return name and mean confidence of each further performer."""
    others = by_performer([solved.pose for solved in take.poses])[1:]
    names = [subject.name for subject in take.setup.further_subjects()]
    confidences = [float(np.mean([pose.confidence for pose in poses])) for poses in others]
    known = confidences if take.poses else [None] * len(names)
    return [{"name": name, "confidence": value} for name, value in zip(names, known, strict=True)]


def _marker_info(path: str) -> dict[str, Any]:
    take, declared = read_take(path), declared_frames(path)
    promised = (
        f"the header promises {declared} frames: the file was cut off, write it again with the program it is from"
    )
    return {
        "format": "marker take",
        "name": take.name,
        "frames": take.frames,
        "duration_s": float(take.times_s[-1] - take.times_s[0]),
        "fps": take.fps,
        "complete": take.frames >= declared,
        "lost_frames": _left_out(take.frame_numbers) + max(declared - take.frames, 0),
        "markers": len(take.names),
        "names": list(take.names),
        "visible_fraction": float(take.visible.mean()),
        "problems": [promised] * (take.frames < declared),
    }


def _left_out(numbers: Any) -> int:
    """Return how many frames are missing between the first and the last."""
    return int(numbers[-1] - numbers[0]) + 1 - len(numbers) if len(numbers) else 0


def run_recover(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Write a whole take of what is intact."""
    path = Path(args.take)
    out = Path(args.out) if args.out else path.with_name(f"{take_name(path)}-recovered{ENDING}")
    if not is_recorded(out):
        raise SettingsError(f"{out} does not end in {ENDING}", advice="or it would not be known as a take")
    if out.exists() and not args.out:
        raise FormatError("is there already", where=str(out), advice="give another name with --out")
    progress(0.0, "reading")
    take = read_take_file(path)
    problems = [str(fault) for fault in take.faults]
    recover(take, out)
    frames = take.frames
    return {
        "frames": len(frames),
        "poses": len(take.poses),
        "duration_s": float(frames[-1].time_s - frames[0].time_s) if frames else 0.0,
        "left_out": problems,
        "out": str(out),
    }


def run_export(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Write the motion or the markers."""
    out = Path(args.out)
    endings = (*MOTION_ENDINGS, *WRITABLE)
    if not out.name.lower().endswith(endings):
        raise FormatError("has an ending that cannot be written", where=str(out), advice=f"use {', '.join(endings)}")
    if args.prop is not None and out.suffix.lower() != ".csv":
        raise SettingsError(f"{out} does not end in .csv", advice="a prop's place is written as a table")
    progress(0.0, "reading")
    if not is_recorded(args.take):
        if args.prop is not None or args.performer is not None:
            raise FormatError(
                "holds the markers of one performer and no props",
                where=str(args.take),
                advice="only a .perftake has further targets",
            )
        markers = read_take(args.take)
        if is_motion(out):
            raise FormatError(
                "holds markers and no motion", where=str(args.take), advice="perfanim solve makes motion of markers"
            )
        write_take(markers, out)
        return {"frames": markers.frames, "fps": markers.fps, "warnings": [], "out": str(out)}
    take = read_take_file(args.take)
    warnings = list(take.problems)
    unsolved = take.frame_count - len(take.poses)
    if unsolved > 0:
        warnings.append(f"{unsolved} frames were not solved live and are left out: perfanim solve takes all of them")
    if args.prop is not None:
        return _export_prop(take, args.prop, out, warnings)
    if is_motion(out):
        index = _performer_index(take, args.performer)
        subject = (take.setup.worn_subject(), *take.setup.further_subjects())[index]
        everybody = by_performer([solved.pose for solved in take.recorded_poses])
        poses = everybody[index] if index < len(everybody) else []
        motion = resample_uniform(poses, subject, take.notes.name, str(args.take))
        motion = write_motion(motion, out, args.units, args.naming, args.rate)
        return {"frames": motion.frames, "fps": motion.fps, "warnings": warnings, "out": str(out)}
    if args.performer is not None:
        raise SettingsError("a further performer's motion can be exported, not the markers", where=str(out))
    markers = marker_take(take)
    write_take(markers, out)
    return {"frames": markers.frames, "fps": markers.fps, "warnings": warnings, "out": str(out)}


def _performer_index(take: TakeFile, name: str | None) -> int:
    """Return which performer is meant, 0 for the first; TakeError when there is no such."""
    if name is None:
        return 0
    names = [subject.name for subject in take.setup.further_subjects()]
    if name in names:
        return 1 + names.index(name)
    told = f"they are: {', '.join(names)}" if names else "it was recorded with one; solve it with --performer"
    raise TakeError(f"has no further performer {name!r}", where=str(take.path), advice=told)


def _export_prop(take: TakeFile, name: str, out: Path, warnings: list[str]) -> dict[str, Any]:
    """Write where a prop was."""
    names = [prop.name for prop in take.setup.carried_props()]
    if name not in names:
        told = f"its props: {', '.join(names)}" if names else "it was recorded without any; solve it with --prop"
        raise TakeError(f"has no prop {name!r}", where=str(take.path), advice=told)
    poses = [solved.pose for solved in take.recorded_poses]
    if len(poses) < 2:
        raise TakeError(f"has {len(poses)} solved frames", where=str(take.path), advice="solve it again")
    fps = rate(np.array([pose.time_s for pose in poses]), np.array([pose.number for pose in poses]))
    index = names.index(name)
    write_prop_csv(poses, index, name, fps, out)
    found = sum(pose.props[index].found for pose in poses) / len(poses)
    return {"frames": len(poses), "fps": fps, "found_fraction": found, "warnings": warnings, "out": str(out)}
