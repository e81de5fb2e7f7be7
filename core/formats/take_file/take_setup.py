"""Set-up and notes of a take; only the notes change after the recording has started."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from typing import Annotated, Any

from ... import __version__
from ...errors import TakeError
from ...geometry.camera import CameraRig
from ...geometry.rig_file import rig_from, rig_tables
from ...markers.prop import Prop, prop_from, prop_tables
from ...markers.subject import Subject, subject_from, subject_tables
from ...system.files import reading
from ...system.schema import About, Schema, Table, table_of

MOST_STARS = 5
_DEEPEST = 64  # deepest nesting of JSON accepted, far below Python's recursion limit
_MOST = 1e15  # largest frame number, and number of seconds


@dataclass(frozen=True)
class TakeSetup:
    """Tables with a take's cameras, performers, props, database and settings, for JSON.

    Args:
        rig: Tables as in a rig file; empty for imported markers without cameras.
        performers: Subjects with marker sets as in their files; empty if the performers are unknown.
        settings: Solver settings that differ from the defaults.
        database: "path", "frames", "fps" and "sha256" (of its header).
        capture: Sources and detection settings as requested.
        created: Date and time, ISO 8601 with the time zone.
        software: Program and version that recorded the take.
    """

    rig: Mapping[str, Any]
    performers: tuple[Mapping[str, Any], ...]
    settings: Mapping[str, Any] = field(default_factory=dict)
    database: Mapping[str, Any] = field(default_factory=dict)
    capture: Mapping[str, Any] = field(default_factory=dict)
    props: tuple[Mapping[str, Any], ...] = ()
    created: str = ""
    software: str = ""

    @staticmethod
    def of(
        rig: CameraRig | None,
        performers: Sequence[Subject],
        settings: Mapping[str, Any],
        database: Mapping[str, Any],
        capture: Mapping[str, Any],
        props: Sequence[Prop] = (),
    ) -> "TakeSetup":
        """Return the set-up of a take that starts now."""
        made = TakeSetup(
            rig=rig_tables(rig) if rig is not None else {},
            performers=tuple(subject_tables(subject) for subject in performers),
            settings=settings,
            database=database,
            capture=capture,
            props=tuple(prop_tables(prop) for prop in props),
            created=datetime.now(UTC).astimezone().isoformat(timespec="seconds"),
            software=f"perfanim {__version__}",
        )
        return TakeSetup.from_json(made.to_json(), "")  # the same object that a reader will get, to the last digit

    def to_json(self) -> bytes:
        """Return JSON; the first performer is "subject" ({} if there is none), others are in "performers"."""
        tables = asdict(self)
        performers = tables.pop("performers")
        subject, further = performers[0] if performers else {}, performers[1:]
        facts = {"rig": tables.pop("rig"), "subject": subject, **tables, "performers": further}
        return json.dumps(facts, default=plain).encode("utf-8")

    @staticmethod
    def from_json(data: bytes, where: str) -> "TakeSetup":
        """Return the set-up from `to_json`; unknown parts are ignored, missing ones raise TakeError."""
        facts = json_object(data, where)
        with reading(where, TakeError, what="has an incomplete set-up"):
            parts = {name: dict(facts[name]) for name in ("rig", "settings", "database", "capture")}
            performers = tuple(dict(table) for table in (facts["subject"], *facts.get("performers", ())) if table)
            props = tuple(dict(table) for table in facts.get("props", ()))
        created, software = str(facts.get("created", "")), str(facts.get("software", ""))
        return TakeSetup(**parts, performers=performers, props=props, created=created, software=software)

    def camera_rig(self) -> CameraRig | None:
        """Return the cameras, or None if there are none; TakeError for damaged tables."""
        if not self.rig:
            return None
        return _made("calibration", lambda: rig_from(self.rig, "calibration of the take"))

    def subjects(self) -> tuple[Subject, ...]:
        """Return the performers with their markers; TakeError for damaged tables."""
        return _made("subject", lambda: tuple(subject_from(table, "subject of the take") for table in self.performers))

    def carried_props(self) -> tuple[Prop, ...]:
        """Return the props; TakeError or PropError for damaged tables."""
        return _made("prop", lambda: tuple(prop_from(table, "prop of the take") for table in self.props))


@dataclass(frozen=True)
class TakeNotes:
    """The user's notes on a take."""

    name: Annotated[str, About("name of the take; empty for the file's")] = ""
    notes: Annotated[str, About("notes of the user")] = ""
    rating: Annotated[int, About("stars, 0 for none", "", 0, MOST_STARS)] = 0
    character: Annotated[str, About("character that was animated live")] = ""
    played: Annotated[bool, About("whether the take was later applied to a character")] = False
    recorded: Annotated[
        tuple[int, int] | None,
        About("first and last frame number between countdown and automatic end; by default all", "", -_MOST, _MOST),
    ] = None
    filters: Annotated[Table | None, About("`FilterSettings` at the capture")] = None
    project: Annotated[str, About("Blender file in which the take was captured or first put on a character")] = ""
    verdict: Annotated[str, About("verdict of the solve: good, or why not; empty if it was not solved offline")] = ""

    def __post_init__(self) -> None:
        if not 0 <= self.rating <= MOST_STARS:
            raise TakeError(f"a rating of {self.rating} is out of range", advice=f"give 0 to {MOST_STARS} stars")

    def to_json(self) -> bytes:
        """Return the notes as JSON."""
        return json.dumps(table_of(self)).encode("utf-8")

    @staticmethod
    def from_json(data: bytes, where: str) -> "TakeNotes":
        """Return the notes from `to_json`, ignoring unknown parts; TakeError if they are damaged."""
        facts = json_object(data, where)
        rating = facts.get("rating")
        stars = min(max(rating, 0), MOST_STARS) if isinstance(rating, int) else 0
        return _NOTES.read(facts | {"rating": int(stars)}, f"{where}, notes")


@dataclass(frozen=True)
class MissingFrames:
    """Frames that are missing because one of the capture's processes was replaced."""

    after: Annotated[int, About("number of the last frame before them", "", -_MOST, _MOST)] = -1
    seconds: Annotated[float, About("duration", "s", 0.0, _MOST)] = 0.0


@dataclass(frozen=True)
class TakeEvent:
    """Incident during the recording of a take."""

    text: Annotated[str, About("message")] = ""
    gap: Annotated[MissingFrames | None, About("frames that are missing")] = None

    @staticmethod
    def from_json(data: bytes, where: str) -> "TakeEvent":
        """Return the event in a chunk; TakeError if it is damaged."""
        return _EVENT.read(json_object(data, where), f"{where}, event")


_NOTES = Schema(
    TakeNotes, "Notes of a take", "What the user wrote about a take.", TakeError, "restore the file from a copy"
)
_EVENT = Schema(
    TakeEvent, "Event of a take", "An incident while it was recorded.", TakeError, "restore the file from a copy"
)


def json_object(data: bytes, where: str) -> dict[str, Any]:
    """Return a JSON object; TakeError for other bytes, or if it is nested too deeply."""
    with reading(where, TakeError, what="holds invalid JSON"):
        value = json.loads(data)
    if not isinstance(value, dict):
        raise TakeError("holds JSON that is not an object", where=where, advice="restore the file from a copy")
    if _is_deeper(value, _DEEPEST):
        raise TakeError(
            f"holds JSON nested more than {_DEEPEST} deep", where=where, advice="restore the file from a copy"
        )
    return value


def _is_deeper(value: Any, levels: int) -> bool:
    if not isinstance(value, dict | list):
        return False
    items = value.values() if isinstance(value, dict) else value
    return levels == 0 or any(_is_deeper(item, levels - 1) for item in items)


def _made(what: str, make: Any) -> Any:
    with reading("", TakeError, f"give another {what}", f"has an unusable {what}"):
        return make()


def plain(value: Any) -> Any:
    """Return numpy values as Python's own types, and others as strings."""
    return value.tolist() if hasattr(value, "tolist") else str(value)
