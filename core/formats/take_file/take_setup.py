"""Set-up and notes of a take; only the notes change after its beginning."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from typing import Any

from ... import __version__
from ...errors import TakeError
from ...geometry.camera import CameraRig
from ...geometry.rig_file import rig_from, rig_tables
from ...markers.prop import Prop, prop_from, prop_tables
from ...markers.subject import Subject, subject_from, subject_tables
from ...system.files import reading
from ...system.schema import Key, Schema

MOST_STARS = 5
_DEEPEST = 64  # of nested JSON: far below what Python can copy
_MOST = 1e15  # of frame numbers and seconds
_NOTES = Schema(
    "Notes of a take",
    "What the user wrote about a take.",
    (
        Key("name", "of the take", str, optional=True),
        Key("notes", "of the user", str, optional=True),
        Key("character", "that was animated live", str, optional=True),
        Key("recorded", "first and last wanted frame", int, (2,), "", -_MOST, _MOST, optional=True),
    ),
    TakeError,
    "check the file",
)
_EVENT = Schema(
    "Event of a take",
    "An incident while it was recorded.",
    (
        Key("text", "message", str, optional=True),
        Key(
            "gap",
            "frames that are missing",
            (
                Key("after", "number of the last frame before them", int, (), "", -_MOST, _MOST, optional=True),
                Key("seconds", "that are missing", float, (), "s", 0.0, _MOST, optional=True),
            ),
            optional=True,
        ),
    ),
    TakeError,
    "check the file",
)


@dataclass(frozen=True)
class TakeSetup:
    """Tables of a take's cameras, performers, props, database and settings, for JSON.

    Args:
        rig: as in its file; empty for imported markers without cameras.
        performers: subjects with marker sets as in their files; none where nobody said who was filmed.
        settings: of the solver, where they differ from its defaults.
        database: "path", "frames", "fps" and "sha256" (of its header).
        capture: sources and detection as requested.
        created: ISO 8601 with the time zone.
        software: program and version that recorded the take.
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
        """Return the set-up of a take that begins now."""
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
        return TakeSetup.from_json(made.to_json(), "")  # as a reader will see it, to the last digit

    def to_json(self) -> bytes:
        """Return JSON; first performer: "subject" ({}: none), further: "performers"."""
        tables = asdict(self)
        performers = tables.pop("performers")
        subject, further = performers[0] if performers else {}, performers[1:]
        facts = {"rig": tables.pop("rig"), "subject": subject, **tables, "performers": further}
        return json.dumps(facts, default=plain).encode("utf-8")

    @staticmethod
    def from_json(data: bytes, where: str) -> "TakeSetup":
        """Return the set-up of `to_json`; ignore new parts, TakeError for missing ones."""
        facts = json_object(data, where)
        with reading(where, TakeError, what="has an incomplete set-up"):
            parts = {name: dict(facts[name]) for name in ("rig", "settings", "database", "capture")}
            performers = tuple(dict(table) for table in (facts["subject"], *facts.get("performers", ())) if table)
            props = tuple(dict(table) for table in facts.get("props", ()))
        created, software = str(facts.get("created", "")), str(facts.get("software", ""))
        return TakeSetup(**parts, performers=performers, props=props, created=created, software=software)

    def camera_rig(self) -> CameraRig | None:
        """Return the cameras, None without any; TakeError for damaged tables."""
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
    """Notes of the user on a take.

    Args:
        name: "" for the file's.
        rating: 0 (none) to 5 stars.
        character: animated live, "" for none.
        played: whether the take was put onto a character later.
        recorded: first and last frame number between countdown and automatic end; None: all.
        filters: table of `FilterSettings` at the capture; None: not stored.
    """

    name: str = ""
    notes: str = ""
    rating: int = 0
    character: str = ""
    played: bool = False
    recorded: tuple[int, int] | None = None
    filters: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.rating <= MOST_STARS:
            raise TakeError(f"a rating of {self.rating} is out of range", advice=f"give 0 to {MOST_STARS} stars")

    def to_json(self) -> bytes:
        """Return the notes as JSON."""
        return json.dumps(asdict(self)).encode("utf-8")

    @staticmethod
    def from_json(data: bytes, where: str) -> "TakeNotes":
        """Return the notes of `to_json`, without later parts; TakeError for damaged ones."""
        facts = json_object(data, where)
        _NOTES.check(facts, f"{where}, notes")
        texts = {name: facts.get(name) or "" for name in ("name", "notes", "character")}
        rating = facts.get("rating", 0)
        stars = min(max(rating, 0), MOST_STARS) if isinstance(rating, int) else 0
        span = facts.get("recorded")
        recorded = (int(span[0]), int(span[1])) if span is not None else None
        table, played = facts.get("filters"), bool(facts.get("played", False))
        filters = table if isinstance(table, dict) else None
        return TakeNotes(**texts, rating=stars, played=played, recorded=recorded, filters=filters)


def event_facts(data: bytes, where: str) -> dict[str, Any]:
    """Return the facts of an event; TakeError for damaged ones."""
    facts = json_object(data, where)
    _EVENT.check(facts, f"{where}, event")
    return facts


def json_object(data: bytes, where: str) -> dict[str, Any]:
    """Return a JSON object; TakeError for other bytes, or if nested too deeply."""
    with reading(where, TakeError, what="holds no JSON where some was expected"):
        value = json.loads(data)
    if not isinstance(value, dict):
        raise TakeError("holds no JSON object where one was expected", where=where, advice="check the file")
    if _is_deeper(value, _DEEPEST):
        raise TakeError(f"holds JSON nested more than {_DEEPEST} deep", where=where, advice="check the file")
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
    """Return numpy values as Python's own, others as text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)
