"""Solved takes saved as recorded takes: imported markers, captures solved again."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..database.store import Database
from ..formats.take_file.chunks import ChunkKind
from ..formats.take_file.pose_codec import TimedPose
from ..formats.take_file.take_reader import TakeFile
from ..formats.take_file.take_setup import TakeNotes
from ..formats.take_file.whole_take import write_whole_take
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from ..markers.take_frames import take_frames
from ..solver.settings import SolveSettings
from ..system.progress import Progress
from .capture_setup import CaptureSetup
from .solve_take import SolvedTake, solve_take


def save_imported_take(
    path: Path | str,
    take: MarkerTake,
    subject: Subject,
    database: Database,
    settings: SolveSettings,
    capture: Mapping[str, Any],
    progress: Progress,
) -> SolvedTake:
    """Solve labelled markers and write them, with the poses, as a recorded take.

    Args:
        path: recorded take to write; an existing file is replaced.
        take: markers in a world with y up.
        capture: origin of the markers, for the set-up.

    Raises:
        TakeError: the take lacks torso markers.
        FormatError: `path` cannot be written.
    """
    solved = solve_take(take, subject, database, settings, progress)
    setup = CaptureSetup(take.single.rig if take.single else None, (subject,), (), database, settings)
    frames = [(0.0, frame) for frame in take_frames(take, subject.marker_set)]
    poses = _timed_poses(solved, [stamp_s for stamp_s, _ in frames])
    write_whole_take(path, setup.tables(capture), TakeNotes(take.name), frames, poses)
    return solved


def save_resolved_take(
    path: Path | str, take: TakeFile, frames: Sequence[MarkerFrame], setup: CaptureSetup, solved: SolvedTake
) -> None:
    """Write a recorded take with new poses; keep its notes, add the method to name.

    Args:
        path: recorded take to write, not `take`'s own file.
        frames, setup, solved: marker frames, set-up and poses of the new solve.

    Raises:
        FormatError: `path` cannot be written.
    """
    recorded, method = take.setup, setup.settings.method
    tables = setup.tables(recorded.capture)
    name = take.notes.name.removesuffix(f" ({recorded.settings.get('method', SolveSettings().method)})")
    notes = TakeNotes(f"{name} ({method})", take.notes.notes, take.notes.rating, recorded=take.notes.recorded)
    stamps_s = [stamp_s for stamp_s, _ in take.stamped_frames]
    events = [bytes(chunk.payload) for chunk in take.chunks if chunk.kind == ChunkKind.EVENT]
    write_whole_take(
        path,
        replace(tables, created=recorded.created, software=recorded.software),
        notes,
        list(zip(stamps_s, frames, strict=True)),
        _timed_poses(solved, stamps_s),
        events,
    )


def _timed_poses(solved: SolvedTake, stamps_s: Sequence[float]) -> list[TimedPose]:
    rows = zip(solved.poses, stamps_s, solved.seconds, strict=True)
    return [TimedPose(pose, stamp_s, float(seconds)) for pose, stamp_s, seconds in rows]
