"""Solved takes kept as recorded ones: markers of other systems brought in, and captures solved anew."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..database.store import Database, identity
from ..formats.take_file.chunks import ChunkKind
from ..formats.take_file.pose_codec import TimedPose
from ..formats.take_file.reading import TakeFile
from ..formats.take_file.setup import TakeNotes, TakeSetup
from ..formats.take_file.whole import write_whole_take
from ..geometry.camera import CameraRig
from ..geometry.rig_file import rig_tables
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_take import MarkerTake
from ..markers.prop import Prop, prop_tables
from ..markers.subject import Subject, subject_tables
from ..markers.take_frames import take_frames
from ..solver.settings import SolveSettings
from .solve_take import SolvedTake, solve_take

Progress = Callable[[float, str], None]


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
        path: the recorded take to write; what is there is replaced.
        take: in the product's world.
        subject, database, settings: by which it is solved.
        capture: where the markers came from, for the set-up.

    Raises:
        TakeError: the take lacks torso markers.
        FormatError: `path` cannot be written.
    """
    solved = solve_take(take, subject, database, settings, progress)
    rig = take.single.rig if take.single is not None else None
    setup = TakeSetup.of(rig, subject, _differing(settings), identity(database), capture)
    frames = [(0.0, frame) for frame in take_frames(take, subject.marker_set)]
    write_whole_take(path, setup, TakeNotes(take.name), frames, _poses(solved, [stamp_s for stamp_s, _ in frames]))
    return solved


def save_resolved_take(
    path: Path | str,
    take: TakeFile,
    frames: Sequence[MarkerFrame],
    rig: CameraRig | None,
    subject: Subject,
    database: Database,
    settings: SolveSettings,
    solved: SolvedTake,
    props: Sequence[Prop],
    performers: Sequence[Subject],
) -> None:
    """Write a recorded take with the poses of another solve; rating and notes go along, the name tells the method.

    Args:
        path: the recorded take to write, another than `take`'s.
        take: what was recorded.
        frames: its marker frames, as they were solved.
        rig, subject, database, settings, props, performers: by which they were solved.
        solved: their poses.

    Raises:
        FormatError: `path` cannot be written.
    """
    setup = replace(
        take.setup,
        rig=rig_tables(rig) if rig is not None else {},
        subject=subject_tables(subject),
        settings=_differing(settings),
        database=identity(database),
        props=tuple(prop_tables(prop) for prop in props),
        performers=tuple(subject_tables(performer) for performer in performers),
    )
    name = take.notes.name.removesuffix(f" ({_method(take.setup.settings)})")
    rated = TakeNotes(f"{name} ({settings.method})", take.notes.notes, take.notes.rating)
    notes = replace(rated, recorded=take.notes.recorded)
    stamps_s = [stamp_s for stamp_s, _ in take.stamped_frames]
    events = [bytes(chunk.payload) for chunk in take.chunks if chunk.kind == ChunkKind.EVENT]
    write_whole_take(path, setup, notes, list(zip(stamps_s, frames, strict=True)), _poses(solved, stamps_s), events)


def _poses(solved: SolvedTake, stamps_s: Sequence[float]) -> list[TimedPose]:
    rows = zip(solved.poses, stamps_s, solved.seconds, strict=True)
    return [TimedPose(pose, stamp_s, float(seconds)) for pose, stamp_s, seconds in rows]


def _differing(settings: SolveSettings) -> dict[str, Any]:
    """Return the settings that differ from the defaults."""
    usual = vars(SolveSettings())
    return {name: value for name, value in vars(settings).items() if value != usual[name]}


def _method(settings: Mapping[str, Any]) -> str:
    return str(settings.get("method", SolveSettings().method))
