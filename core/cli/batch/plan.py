"""Plan of a batch: its takes, and the steps for each.

A plan is a TOML file: settings for all takes at its top level, and `[[take]]` tables with settings for the takes they
name. Keys are the long options of `perfanim track`, `solve` and `retarget` with _ for -; paths are relative to the
plan.
"""

import glob
import json
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from enum import Enum
from pathlib import Path, PurePath
from typing import Annotated, Any, TypeAlias

from ...database.starter_database import STARTER, starter_database
from ...errors import PerfanimError, SettingsError
from ...formats.markers.marker_files import READABLE, is_recorded
from ...formats.motion.write_motion import ANGLES, BVH, MOTION_ENDINGS
from ...system.files import is_file, is_folder, read_bytes, read_toml
from ...system.schema import About, Schema, Table

Value = str | float | bool | list[str]

REPORT = "report"  # folder of records and pictures, inside the folder of results
SUMMARY = "summary.csv"
MOST_RECORD_BYTES = 1 << 20


ALSO = tuple(ending.removeprefix(".") for ending in MOTION_ENDINGS if ending != BVH)
SAVED_AS = ("blend", "fbx", "glb")
_Text: TypeAlias = str | None
_Texts: TypeAlias = tuple[str, ...] | None
_Number: TypeAlias = float | None
_Switch: TypeAlias = bool | None


class Holds(Enum):
    """Kind of paths that a setting contains."""

    FILE = "a file"
    NAME_OR_FILE = "a name or a file"
    SOURCE = "videos, folders or patterns of images"
    CAMERAS = "sources, each NAME=SOURCE"


# command -> settings that are its options; "label": options of track that label the markers of videos
_COMMANDS = {
    "track": "cameras left right camera background fps floor no_time_offset marker_set",
    "label": "database subject skeleton",
    "solve": "marker_set database subject skeleton names use up method feet units naming smooth rate refine_body "
    "trust_labels",
    "retarget": "to blender map root_motion",
}
_PATHS = {
    Holds.FILE: "cameras database subject skeleton names to blender",
    Holds.NAME_OR_FILE: "marker_set map",
    Holds.SOURCE: "left right background",
    Holds.CAMERAS: "camera",
}
HOLDS = {name: holds for holds, names in _PATHS.items() for name in names.split()}


def _text(about: str) -> About:
    return About(about, least=1)


def _rate(about: str, unit: str = "frames per second") -> About:
    return About(about, unit, 0.0, 1e6)


@dataclass(frozen=True)
class TakeOptions:
    """Settings of takes; None means the command's default."""

    cameras: Annotated[_Text, _text("calibration of the videos, or of recorded takes")] = None
    left: Annotated[_Text, _text("video, folder or pattern of images of the left camera")] = None
    right: Annotated[_Text, _text("the same for the right camera")] = None
    camera: Annotated[_Texts, _text("further cameras, each NAME=SOURCE")] = None
    background: Annotated[_Texts, _text("videos, folders or patterns of the empty capture space")] = None
    fps: Annotated[_Number, _rate("frame rate of sources that do not state it")] = None
    floor: Annotated[_Text, _text('"feet": fit the floor to the feet')] = None
    no_time_offset: Annotated[_Switch, About("whether the cameras are assumed to be synchronised")] = None
    marker_set: Annotated[_Text, _text("name of a shipped marker set, or a file")] = None
    database: Annotated[_Text, _text("motion database")] = None
    subject: Annotated[_Text, _text("calibrated subject")] = None
    skeleton: Annotated[_Text, _text("motion file with the bones to use")] = None
    names: Annotated[_Text, _text("file with the marker for each label")] = None
    use: Annotated[_Text, _text("number or names of the markers to use")] = None
    up: Annotated[_Text, _text("axis of marker files that points up")] = None
    method: Annotated[_Text, _text("solver method")] = None
    feet: Annotated[_Text, _text("how feet are held in place")] = None
    units: Annotated[_Text, _text("unit of BVH files")] = None
    naming: Annotated[_Text, _text("names of the joints in BVH files")] = None
    smooth: Annotated[_Number, _rate("cut-off of the low-pass filter of markers and motion", "Hz")] = None
    rate: Annotated[_Number, _rate("rate of the motion")] = None
    refine_body: Annotated[_Switch, About("whether bones and marker offsets are fitted to the take first")] = None
    trust_labels: Annotated[_Switch, About("whether the labels of marker takes are used as they are")] = None
    also: Annotated[_Texts, About("formats of further files for each motion", choices=ALSO)] = None
    to: Annotated[_Text, _text("character file to retarget to")] = None
    blender: Annotated[_Text, _text("Blender executable that retargets")] = None
    map: Annotated[_Text, _text("bone map: name of a shipped one, or a file")] = None
    root_motion: Annotated[_Text, _text("bone or object that receives the root motion")] = None
    save_as: Annotated[_Text, About("format of the character file", choices=SAVED_AS)] = None


@dataclass(frozen=True)
class _TakeRow:
    """Keys of a plan's `[[take]]` table other than settings: which takes it names."""

    take: Annotated[str, About("file, folder or pattern; left out for videos")] = ""
    name: Annotated[str, About("name of the results; by default the file's")] = ""


@dataclass(frozen=True)
class _PlanFile:
    """Contents of a plan, in addition to the shared settings."""

    take: Annotated[tuple[Table, ...], About("the takes")]
    out: Annotated[str, About("folder of the results")] = ""


OPTIONS = tuple(each.name for each in fields(TakeOptions))
PLAN = Schema(
    _PlanFile,
    "Plan of a batch",
    "For `perfanim batch`. Paths are relative to the plan.",
    SettingsError,
    'add [[take]] tables with take = "FILE"',
)
TAKE = Schema(
    _TakeRow,
    "Take of a plan",
    "For each `[[take]]` table, which may also contain any of the settings below.",
    SettingsError,
    "see TOML files in the manual",
)
SETTINGS = Schema(
    TakeOptions,
    "Settings of a plan",
    "At the plan's top level for all takes, or in a take's table for that one. They have the names of the commands' "
    "options, with _ for -.",
    SettingsError,
    "see TOML files in the manual",
    closed=True,
)
_BODIES = ("subject", "skeleton")  # if a take sets either of these, neither shared setting applies to it
_PATTERN = "*?["
_MOST_FILES = 50_000  # largest number of files searched, so that a whole disk named by mistake soon ends in an error
_FORBIDDEN = '<>:"/\\|?*'  # forbidden in file names on at least one operating system


@dataclass(frozen=True)
class TakePlan:
    """Plan of one take, in plain values that can be passed to other processes as JSON.

    Args:
        source: The take as the plan names it.
        take: File that is solved; "" if it is tracked from the videos in the options.
        options: Values of `TakeOptions` that are set, with absolute paths.
        digest: Hash of everything that the take's outputs depend on (see `take_digest`); "" until it is computed.
    """

    name: str
    source: str
    take: str
    options: Mapping[str, Value] = field(default_factory=dict)
    digest: str = ""

    @property
    def is_tracked(self) -> bool:
        """Whether the take starts from videos."""
        return not self.take

    def options_of(self, command: str) -> list[str]:
        """Return the command line options for a command according to the take's settings."""
        line: list[str] = []
        for key, value in self.options.items():
            if value is False or not self._is_option(key, command):
                continue
            flag = f"--{key.replace('_', '-')}"
            if key == "camera" and isinstance(value, list):
                line += [part for camera in value for part in (flag, camera)]
            elif isinstance(value, list):
                line += [flag, *value]
            else:
                line += [flag] if value is True else [flag, str(value)]
        return line

    def _is_option(self, key: str, command: str) -> bool:
        """Return whether a setting is an option of a command for this take."""
        is_from_cameras = self.is_tracked or is_recorded(self.take)
        if key == "cameras" and not self.is_tracked:
            return command == "solve" and is_recorded(self.take)
        if key in ("up", "names") and is_from_cameras:  # such takes have y up and the marker set's names
            return False
        if key == "use" and is_recorded(self.take):  # for marker takes only
            return False
        if key == "blender" and "to" not in self.options:
            return False
        return key in _COMMANDS[command].split()


@dataclass(frozen=True)
class Plan:
    """The takes of a batch, sorted by name, and its folder for results ("" if not set)."""

    takes: tuple[TakePlan, ...]
    out: str = ""


def read_plan(path: Path | str, given: Mapping[str, Value]) -> Plan:
    """Return the plan of a TOML file.

    Args:
        given: Options that override the plan's shared ones; paths are relative to the working folder.

    Raises:
        FormatError: The plan cannot be read. SettingsError: Its keys or values are wrong.
    """
    where = str(path)
    tables = read_toml(path)
    plan = PLAN.read(tables, where)
    folder = Path(path).absolute().parent
    if not plan.take:
        raise SettingsError("names no takes", where=where, advice=PLAN.advice)
    tables = {key: value for key, value in tables.items() if key not in ("take", "out")}
    shared = _merge(_resolve_paths(tables, folder, where), _resolve_paths(given, Path.cwd(), "options"))
    found: list[tuple[str, TakePlan]] = []
    for number, row in enumerate(plan.take, 1):
        found += _row_takes(row, shared, folder, f"{where}, take {number}")
    return Plan(_name_takes(found), str(folder / plan.out) if plan.out else "")


def plan_of(sources: Sequence[str], given: Mapping[str, Value]) -> Plan:
    """Return the plan for files, folders and patterns, with shared options."""
    shared = _resolve_paths(given, Path.cwd(), "options")
    takes = [take for source in sources for take in _find_takes(source, Path.cwd(), "takes")]
    return Plan(_name_takes([("", TakePlan("", label, path, shared)) for label, path in takes]))


def _row_takes(row: Table, shared: Mapping[str, Value], folder: Path, where: str) -> list[tuple[str, TakePlan]]:
    """Return the takes of one table, and the name that the table gives them, or ""."""
    found = TAKE.read(row, where)
    take, name = found.take, found.name
    own = {key: value for key, value in row.items() if key not in ("take", "name")}
    if name and (set(name) & set(_FORBIDDEN) or name != name.strip(". ")):
        raise SettingsError(f"{name!r} cannot be the name of a file", where=where, advice="choose another name")
    options = _merge(shared, _resolve_paths(own, folder, where))
    if take:
        takes = _find_takes(take, folder, where)
        if name and len(takes) > 1:
            raise SettingsError(
                f"the name {name!r} is given to {len(takes)} takes",
                where=where,
                advice="leave `name` out, and each take is named after its file",
            )
        return [(name, TakePlan("", label, path, options)) for label, path in takes]
    images = [key for key in ("left", "camera") if own.get(key)]
    if not images:
        raise SettingsError(
            "names neither a take nor videos", where=where, advice="name a take, or the videos of its cameras"
        )
    if "cameras" not in options:
        raise SettingsError(
            "has videos but no calibration", where=where, advice="add the key 'cameras' with the calibration file"
        )
    first = own[images[0]]
    first = first[0].rpartition("=")[2] if isinstance(first, list) else first
    return [(name, TakePlan("", first, "", options))]


def _merge(shared: Mapping[str, Value], own: Mapping[str, Value]) -> dict[str, Value]:
    """Return a take's settings: its own override the shared ones."""
    left = {key: value for key, value in shared.items() if key not in _BODIES or not set(_BODIES) & set(own)}
    return {**left, **own}


def _resolve_paths(table: Table, folder: Path, where: str) -> dict[str, Value]:
    """Return the options of a table, checked, with absolute paths."""
    options = SETTINGS.read(table, where)
    named = {"database": str(starter_database())} if options.database == STARTER else {}  # built before it is shared
    return {key: _resolved(getattr(options, key), HOLDS.get(key), folder) for key in table} | named


def _resolved(value: Any, holds: Holds | None, folder: Path) -> Value:
    """Return a value with absolute paths."""
    if isinstance(value, tuple):
        return sorted(set(value)) if holds is None else [_source(text, folder, holds) for text in value]
    is_path = holds in (Holds.FILE, Holds.SOURCE) or (holds is Holds.NAME_OR_FILE and is_file(folder / value))
    resolved: Value = _absolute(value, folder) if is_path else value
    return resolved


def _source(text: str, folder: Path, holds: Holds | None) -> str:
    name, equals, source = text.partition("=")
    is_named = holds is Holds.CAMERAS and equals
    return f"{name}={_absolute(source, folder)}" if is_named else _absolute(text, folder)


def _absolute(text: str, folder: Path) -> str:
    return os.path.abspath(folder / text)  # noqa: PTH100 - `Path.resolve` would follow links


def _find_takes(text: str, folder: Path, where: str) -> list[tuple[str, str]]:
    """Return label and path of each take of a file, folder or pattern."""
    path = Path(_absolute(text, folder))
    if is_folder(path):
        # the name is checked first, because asking the disk whether each name is a file is slow
        files = (Path(place, name) for place, _, names in os.walk(path) for name in names)
        found = [file for file in _within_limit(files, where, text) if _is_take(file.name.lower()) and is_file(file)]
        found = _without_results(found)
    elif is_file(path) or not set(text) & set(_PATTERN):
        found = [path]  # a missing file counts as a bad take; the others are still done
    else:
        names = glob.iglob(str(path), recursive=True)  # noqa: PTH207 - `Path.glob` rejects absolute patterns
        found = _without_results([Path(name) for name in _within_limit(names, where, text)])
    if not found:
        raise SettingsError("there are no takes", where=f"{where}: {text}", advice="check the path")
    return [(_label(file, folder), str(file)) for file in sorted(found)]


def _without_results(files: Sequence[Path]) -> list[Path]:
    """Return the files that were not written by a batch: results may lie beside or below the takes."""
    results = {folder: _results_in(folder) for folder in {file.parent for file in files}}
    return [file for file in files if file.name not in results[file.parent]]


def _results_in(folder: Path) -> set[str]:
    """Return the names of the files in a folder that the records of a batch list."""
    found = set[str]()
    for record in (folder / REPORT).glob("*.json"):
        with suppress(PerfanimError, ValueError, AttributeError, KeyError, TypeError):  # it may be any file
            found |= {SUMMARY, *map(str, json.loads(read_bytes(record, MOST_RECORD_BYTES))["outputs"].values())}
    return found


def _within_limit(files: Iterable[Any], where: str, text: str) -> Iterator[Any]:
    """Yield files, up to the largest number that a folder of takes may contain."""
    for count, file in enumerate(files):
        if count == _MOST_FILES:
            raise SettingsError(
                f"holds more than {_MOST_FILES:,} files", where=f"{where}: {text}", advice="name a folder of takes"
            )
        yield file


def _is_take(name: str) -> bool:
    return name.endswith(READABLE) and not name.endswith(ANGLES)


def _label(path: Path, folder: Path) -> str:
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else str(path)


def _name_takes(found: Sequence[tuple[str, TakePlan]]) -> tuple[TakePlan, ...]:
    """Return takes with unique names, sorted; the given order does not matter.

    A take is named after its file; if names are equal, folders and then extensions are added.
    """
    chosen = [name or _stem(take.source) for name, take in found]
    for wider in (_with_folders, _whole):
        counts = Counter(map(str.casefold, chosen))
        chosen = [
            wider(take.source) if not name and counts[own.casefold()] > 1 else own
            for own, (name, take) in zip(chosen, found, strict=True)
        ]
    taken: dict[str, str] = {}
    for name, (_, take) in zip(chosen, found, strict=True):
        if name.casefold() in taken:
            raise SettingsError(
                f"{taken[name.casefold()]} and {take.source} would both be called {name}",
                advice='leave one out, or give it another name (name = "...")',
            )
        taken[name.casefold()] = take.source
    named = [
        TakePlan(name, take.source, take.take, take.options) for name, (_, take) in zip(chosen, found, strict=True)
    ]
    return tuple(sorted(named, key=lambda take: take.name))


def _stem(source: str) -> str:
    name = PurePath(source).name
    ending = next((ending for ending in READABLE if name.lower().endswith(ending)), PurePath(name).suffix)
    return _safe(name[: len(name) - len(ending)] or name)


def _with_folders(source: str) -> str:
    return _safe("-".join((*PurePath(source).parent.parts, _stem(source))))


def _whole(source: str) -> str:
    return _safe("-".join(PurePath(source).parts))


def _safe(name: str) -> str:
    return "".join("_" if c in _FORBIDDEN or ord(c) < 32 else c for c in name).strip(". ") or "take"
