"""Reading recorded takes, including damaged ones."""

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path, PurePath
from typing import Any, BinaryIO

from ...body.scene_pose import PerformerPose, ScenePose
from ...errors import CaptureError, TakeError
from ...markers.marker_frame import MarkerFrame
from ...markers.marker_frame_codec import unpack_stamped
from ...system.files import exists, open_foreign, read_bytes, reading
from .chunks import (
    HEADER_BYTES,
    PREAMBLE_BYTES,
    Chunk,
    ChunkKind,
    Fault,
    preamble_faults,
    read_chunk,
    scan,
    split_records,
)
from .footer import Footer, find_footer
from .pose_codec import TimedPose, unpack_solved
from .take_setup import TakeEvent, TakeNotes, TakeSetup

ENDING = ".perftake"

# Readers of chunks that a take can do without.
_OPTIONAL: Mapping[int, Callable[[bytes, str], object]] = {
    ChunkKind.NOTES: TakeNotes.from_json,
    ChunkKind.EVENT: TakeEvent.from_json,
    ChunkKind.END: Footer.unpack,
}
_RECOVER = "perfanim take recover writes the intact part as a complete take"


@dataclass(frozen=True)
class Gap:
    """Frames that are missing because one of the capture's processes was replaced.

    Args:
        after: Number of the last frame before the gap.
        seconds: Missing time; 0 if the source was read again from there.
    """

    after: int
    seconds: float
    text: str


@dataclass(frozen=True)
class TakeFile:
    """Recorded take: intact chunks in order, faults, and whether its end mark was found (`ended`)."""

    path: Path
    chunks: tuple[Chunk, ...]
    faults: tuple[Fault, ...]
    ended: bool

    @property
    def complete(self) -> bool:
        """Whether the take has its end mark and no damage."""
        return self.ended and not self.faults

    @cached_property
    def setup(self) -> TakeSetup:
        """Set-up of the take; TakeError if it is lost."""
        for chunk in self._of(ChunkKind.SETUP):
            return TakeSetup.from_json(bytes(chunk.payload), str(self.path))
        raise TakeError(
            "has lost its calibration and subject",
            where=str(self.path),
            advice="record it again: it cannot be used without them",
        )

    @cached_property
    def notes(self) -> TakeNotes:
        """The user's last notes; a take without a name gets the file's."""
        chunks = self._of(ChunkKind.NOTES)
        last = TakeNotes.from_json(bytes(chunks[-1].payload), str(self.path)) if chunks else TakeNotes()
        return last if last.name else replace(last, name=take_name(self.path))

    @property
    def events(self) -> tuple[str, ...]:
        """Messages about incidents during the recording."""
        return tuple(event.text for event in self._events)

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Gaps where one of the capture's processes was replaced."""
        return tuple(Gap(event.gap.after, event.gap.seconds, event.text) for event in self._events if event.gap)

    @cached_property
    def _events(self) -> tuple[TakeEvent, ...]:
        return tuple(TakeEvent.from_json(bytes(chunk.payload), str(self.path)) for chunk in self._of(ChunkKind.EVENT))

    @cached_property
    def stamped_frames(self) -> tuple[tuple[float, MarkerFrame], ...]:
        """Marker frames, each with the `time.perf_counter()` at the arrival of its images."""
        return tuple(self._records(ChunkKind.FRAMES, unpack_stamped))

    @property
    def frames(self) -> tuple[MarkerFrame, ...]:
        """Marker frames."""
        return tuple(frame for _, frame in self.stamped_frames)

    @cached_property
    def poses(self) -> tuple[TimedPose, ...]:
        """Poses as solved live; fewer than frames if the solver could not keep up."""
        return tuple(self._records(ChunkKind.POSES, unpack_solved))

    @property
    def recorded_poses(self) -> tuple[ScenePose, ...]:
        """Poses between the countdown and the automatic end."""
        return tuple(solved.pose for solved in self.poses if self.is_recorded(solved.pose.number))

    def recorded_poses_of(self, performer: int = 0) -> list[PerformerPose]:
        """Return `recorded_poses` of one performer; TakeError if the take was not solved."""
        if not self.poses:
            raise TakeError("has no poses", where=str(self.path), advice="solve it, which also labels its markers")
        return [pose.performers[performer] for pose in self.recorded_poses]

    def is_recorded(self, number: int) -> bool:
        """Return whether a frame lies between the countdown and the automatic end."""
        span = self.notes.recorded
        return span is None or span[0] <= number <= span[1]

    @cached_property
    def frame_count(self) -> int:
        """Number of readable marker frames."""
        return sum(1 for chunk in self._of(ChunkKind.FRAMES) for _ in split_records(chunk.payload))

    @property
    def declared_frames(self) -> int:
        """Number of frames according to the end mark; without one, of readable frames."""
        ends = self._of(ChunkKind.END)
        if not ends:
            return self.frame_count
        return Footer.unpack(ends[0].payload, str(self.path)).facts.frames

    @property
    def problems(self) -> list[str]:
        """Messages about faults in the file, with advice."""
        faults = [str(fault) for fault in self.faults]
        if not self.ended and not any(fault.cut for fault in self.faults):
            faults.append("the file ends without its end mark")
        missing = self.declared_frames - self.frame_count
        if missing > 0:
            faults.append(f"the damaged part held {missing} of {self.declared_frames} frames")
        return [f"{line}; {_RECOVER}" for line in faults]

    def _of(self, kind: ChunkKind) -> list[Chunk]:
        return [chunk for chunk in self.chunks if chunk.kind == kind]

    def _records(self, kind: ChunkKind, unpack: Callable[[bytes], Any]) -> Iterable[Any]:
        for chunk in self._of(kind):
            try:
                for record in split_records(chunk.payload):
                    yield unpack(record)
            except (CaptureError, TakeError) as error:  # this is not damage, because the checksum is correct
                raise TakeError(
                    f"chunk {chunk.sequence} was written by another version ({error.what})",
                    where=str(self.path),
                    advice=f"read it with {self.setup.software or 'the version that recorded it'}",
                ) from error


def read_take_file(path: Path | str) -> TakeFile:
    """Return the intact part of a recorded take, even while it is being written.

    Notes, events and end marks with invalid contents count as damaged.

    Raises:
        TakeError: The file is not a take, is of another version, or has no intact part.
        FormatError: The file cannot be read.
    """
    chunks, faults = scan(read_bytes(path), str(path))
    known: list[Chunk] = []
    for chunk in chunks:
        fault = _fault_of_facts(chunk, str(path))
        if fault is not None:
            faults.append(fault)
        elif chunk.kind in ChunkKind._value2member_map_:
            known.append(chunk)
    ended = any(chunk.kind == ChunkKind.END for chunk in known)
    return TakeFile(Path(path), tuple(known), tuple(faults), ended)


def _fault_of_facts(chunk: Chunk, where: str) -> Fault | None:
    """Return the fault of a chunk that has a correct checksum but invalid contents, or None."""
    read = _OPTIONAL.get(chunk.kind)
    try:
        if read is not None:
            read(bytes(chunk.payload), where)
    except TakeError as error:
        name = ChunkKind(chunk.kind).name.lower()
        what = f"chunk {chunk.sequence} ({name}) is unreadable: {error.what}"
        return Fault(chunk.offset, HEADER_BYTES + len(chunk.payload), what)
    return None


def take_name(path: Path | str) -> str:
    """Return the name of a take from its file name."""
    return Path(path).name.removesuffix(ENDING)


def unused_path(folder: Path, name: str, ending: str = ENDING) -> Path:
    """Return an unused path in a folder for a file with this name, cut to 200 bytes."""
    stem = "".join("-" if letter in '<>:"/\\|?*' or ord(letter) < 32 else letter for letter in name)
    stem = stem.encode("utf-8", "replace")[:200].decode("utf-8", "ignore").strip(". ") or "take"
    path, count = folder / f"{stem}{ending}", 2
    while exists(path):
        path, count = folder / f"{stem} ({count}){ending}", count + 1
    return path


@dataclass(frozen=True)
class TakeSummary:
    """Summary of a take for lists, read from the end of the file.

    Args:
        complete: The take has its end mark; earlier damage is ignored.
        frames, duration_s: Length of the recording, 0 if it is incomplete.
        created: Date and time, ISO 8601.
        orphaned: The recording outlived Blender.
        marker_set: Name of the first performer's marker set.
        method, database: Names; "" for the default or if unknown.
    """

    path: Path
    complete: bool
    frames: int = 0
    duration_s: float = 0.0
    created: str = ""
    notes: TakeNotes = field(default_factory=TakeNotes)
    orphaned: bool = False
    performers: tuple[str, ...] = ()
    marker_set: str = ""
    method: str = ""
    database: str = ""


def summarise(path: Path | str) -> TakeSummary:
    """Return the summary of a take; TakeError if the file is of the wrong kind or unreadable."""
    path = Path(path)
    with open_foreign(path, TakeError) as file, reading(path, TakeError, what="cannot be read"):
        preamble_faults(file.read(PREAMBLE_BYTES + HEADER_BYTES), str(path))
        footer = find_footer(file)
        if footer is None:
            return TakeSummary(path, False, notes=TakeNotes(take_name(path)))
        return _listed(path, file, footer)


def has_frames(path: Path | str) -> bool:
    """Return whether a take contains a frame; errors are those of `summarise`."""
    with open_foreign(path, TakeError) as file, reading(path, TakeError, what="cannot be read"):
        preamble_faults(file.read(PREAMBLE_BYTES + HEADER_BYTES), str(path))
        chunk = read_chunk(file, PREAMBLE_BYTES)
        while chunk is not None and chunk.kind != ChunkKind.FRAMES:
            chunk = read_chunk(file, file.tell())
        return chunk is not None


def _listed(path: Path, file: BinaryIO, footer: Footer) -> TakeSummary:
    """Return the summary from the last notes and set-up in the index of a take."""
    last = {kind: offset for kind, offset in footer.index if kind in (ChunkKind.SETUP, ChunkKind.NOTES)}
    known: dict[str, Any] = {}
    notes = TakeNotes()
    for kind, offset in last.items():
        chunk = read_chunk(file, offset)
        if chunk is not None and kind == ChunkKind.SETUP:
            known = _known(TakeSetup.from_json(bytes(chunk.payload), str(path)))
        elif chunk is not None:
            with suppress(TakeError):
                notes = TakeNotes.from_json(bytes(chunk.payload), str(path))
    notes = notes if notes.name else replace(notes, name=take_name(path))
    facts = footer.facts
    return TakeSummary(path, True, facts.frames, facts.duration_s, notes=notes, orphaned=facts.orphaned, **known)


def _known(setup: TakeSetup) -> dict[str, Any]:
    """Return the fields of a summary that come from a set-up."""
    worn = setup.performers[0].get("marker_set") if setup.performers else None
    return {
        "created": setup.created,
        "marker_set": str(worn.get("name", "")) if isinstance(worn, Mapping) else "",
        "method": str(setup.settings.get("method", "")),
        "database": PurePath(str(setup.database.get("path", ""))).stem,
        "performers": tuple(str(table.get("name", "")) for table in setup.performers),
    }
