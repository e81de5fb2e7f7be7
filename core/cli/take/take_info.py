"""`perfanim take info`: facts about a take, and whether the file is complete."""

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ...body.clock import Clock, ClockFault, clock_of
from ...body.scene_pose import decisions, doubtful_stretches, mean_part_confidences
from ...errors import PerfanimError, TakeError
from ...formats.markers.marker_files import READABLE, is_recorded, read_take
from ...formats.take_file.take_reader import TakeFile, read_take_file
from ...markers.steady_take import take_clock
from ...markers.subject import Subject
from ...system.lock import is_locked
from ...system.progress import Progress
from ..options import add_command

_MAIN = ("frames", "fps", "markers", "visible_fraction", "problems")  # facts listed when several takes are given
_UNSOLVED = "has no labels or poses yet: perfanim solve finds them"
_NOBODY = ", with --subject, or --skeleton and --marker-set"


def add_parser(group: Any) -> None:
    about = "facts about a take, and whether it is complete; for several takes, the main facts"
    parser = add_command(group, "info", run, about)
    parser.add_argument("takes", nargs="+", metavar="TAKE", help=", ".join(READABLE))
    why = "list only what the solver decided and why: each restart, relabelling and marker left out, with its time"
    parser.add_argument("--why", action="store_true", help=why)


def run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Return all facts about one take, or the main facts about each of several."""
    if len(args.takes) == 1:
        progress(0.0, "reading")
        return _why(args.takes[0]) if args.why else _info(args.takes[0])
    known: dict[str, dict[str, Any]] = {}
    failed: list[PerfanimError] = []
    for number, path in enumerate(args.takes):
        progress(number / len(args.takes), f"reading {path}")
        try:
            facts = {name: value for name, value in _info(path).items() if name in _MAIN and value != []}
            known[path] = _why(path) if args.why else facts
        except PerfanimError as error:
            failed.append(error)
    if not known:
        raise failed[0]
    return {"takes": known, "failed": [str(error) for error in failed]}


def _info(path: str) -> dict[str, Any]:
    return _recorded_info(read_take_file(path)) if is_recorded(path) else _marker_info(path)


def _why(path: str) -> dict[str, Any]:
    take = read_take_file(path) if is_recorded(path) else None
    if take is None or not take.poses:
        advice = f"perfanim solve {path} --out {Path(path).with_suffix('.perftake')} writes them"
        raise TakeError("has no poses", where=path, advice=advice)
    return {"decisions": [asdict(each) for each in decisions([solved.pose for solved in take.poses])]}


def _recorded_info(take: TakeFile) -> dict[str, Any]:
    frames, setup = take.frames, take.setup
    numbers = np.array([frame.number for frame in frames], dtype=np.int64)
    times_s = np.array([frame.time_s for frame in frames])
    clock = clock_of(times_s) if len(frames) > 1 else None
    problems = [*take.problems, *_told(clock)]
    subjects = setup.subjects()
    worn = subjects[0].marker_set if subjects else None
    rig = setup.camera_rig()
    poses = [solved.pose.performers[0] for solved in take.poses]
    return {
        "format": "recorded take",
        "name": take.notes.name,
        "frames": len(frames),
        **_times(clock),
        "complete": take.complete,
        "lost_frames": _left_out(numbers, clock),
        "gaps": len(take.gaps),
        "gaps_s": sum(gap.seconds for gap in take.gaps),
        "markers": len(worn) if worn else None,
        "names": list(worn.names) if worn else [],
        "visible_fraction": float(np.mean([np.isfinite(p.observed_m[:, 0]) for p in poses])) if poses else None,
        "poses": len(poses),
        "confidence": float(np.mean([pose.confidence for pose in poses])) if poses else None,
        "part_confidence": mean_part_confidences(poses),
        "doubtful": [asdict(stretch) for stretch in doubtful_stretches(poses)],
        "cameras": len(rig) if rig is not None else 0,
        "subject": subjects[0].name if subjects else "",
        "marker_set": worn.name if worn else "",
        "database": setup.database.get("path", ""),
        "props": _props_found(take),
        "performers": _further_performers(take, subjects[1:]),
        "created": setup.created,
        "software": setup.software,
        "notes": take.notes.notes,
        "rating": take.notes.rating,
        "character": take.notes.character,
        "recorded": take.notes.recorded,
        "events": list(take.events),
        "bytes": take.path.stat().st_size,
        "advice": [] if poses else [_UNSOLVED + ("" if subjects else _NOBODY)],
        "problems": ["it is being recorded"] if is_locked(take.path) else problems,
    }


def _props_found(take: TakeFile) -> dict[str, float | None]:
    """Return the share of the poses in which each prop was found."""
    found = [[prop.found for prop in solved.pose.props] for solved in take.poses]
    names = [prop.name for prop in take.setup.carried_props()]
    return {name: float(np.mean([row[i] for row in found])) if found else None for i, name in enumerate(names)}


def _further_performers(take: TakeFile, subjects: Sequence[Subject]) -> list[dict[str, Any]]:
    """Return name and mean confidence of each performer after the first."""
    sure = [[performer.confidence for performer in solved.pose.performers[1:]] for solved in take.poses]
    means = [float(np.mean(column)) for column in zip(*sure, strict=True)] if sure else [None] * len(subjects)
    return [{"name": subject.name, "confidence": mean} for subject, mean in zip(subjects, means, strict=True)]


def _marker_info(path: str) -> dict[str, Any]:
    take = read_take(path)
    clock = take_clock(take)
    return {
        "format": "marker take",
        "name": take.name,
        "frames": take.frames,
        **_times(clock),
        "complete": not take.cut_off_frames,
        "lost_frames": _left_out(take.frame_numbers, clock) + take.cut_off_frames,
        "markers": len(take.names),
        "names": list(take.names),
        "visible_fraction": float(take.visible.mean()),
        "problems": [*take.notes, *_told(clock)],
    }


def _times(clock: Clock | None) -> dict[str, Any]:
    """Return duration, rate of the outputs, mean rate, and shortest and longest step."""
    if clock is None:
        return {"duration_s": 0.0, "fps": None}
    steps_ms = [round(1e3 * step_s, 3) for step_s in clock.steps_s]
    return {"duration_s": clock.source_s, "fps": clock.fps, "mean_fps": clock.mean_fps, "step_ms": steps_ms}


def _left_out(numbers: Any, clock: Clock | None) -> int:
    """Return how many frames are missing between the first and the last, judged by their numbers or times."""
    if clock is None:
        return 0
    return max(int(numbers[-1] - numbers[0]) + 1 - len(numbers), clock.lost)


def _told(clock: Clock | None) -> list[str]:
    """Return the notes about the times, except the one about lost frames."""
    return [note.text for note in clock.notes if note.kind is not ClockFault.LOST] if clock is not None else []
