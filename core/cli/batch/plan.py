"""Plan of a batch: its takes, and the steps for each.

A plan is TOML: settings of all takes at its top level, and `[[take]]` tables with the settings of the takes they name.
Keys are the long options of `perfanim track`, `solve` and `retarget`, with _ for -; paths are relative to the plan.
"""

import glob
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path, PurePath
from typing import Any

from ...errors import SettingsError
from ...formats.markers.marker_files import READABLE, is_recorded
from ...formats.motion.write_motion import ANGLES, BVH, MOTION_ENDINGS
from ...system import schema
from ...system.files import is_file, is_folder, read_toml

Value = str | float | bool | list[str]


class Kind(Enum):
    """Kind of a key's value."""

    FILE = "a file"
    NAME_OR_FILE = "a name or a file"
    SOURCE = "a video, a folder or pattern of images"
    SOURCES = "a list of videos, folders or patterns of images"
    CAMERAS = "a list of NAME=SOURCE"
    WORD = "a word"
    NUMBER = "a number"
    MOTIONS = "a list of angles.csv, vrma"
    CHARACTER = "one of blend, fbx, glb"
    SWITCH = "true or false"


@dataclass(frozen=True)
class Key:
    """Kind of a key's value, and the commands that take it as an option."""

    kind: Kind
    commands: tuple[str, ...]


ALSO = tuple(ending.removeprefix(".") for ending in MOTION_ENDINGS if ending != BVH)
SAVED_AS = ("blend", "fbx", "glb")
_KEYS = (  # "label": options of track by which it labels the markers of videos
    (Kind.FILE, ("track",), "cameras"),  # of a recorded take an option of solve, see `options_of`
    (Kind.SOURCE, ("track",), "left right"),
    (Kind.CAMERAS, ("track",), "camera"),
    (Kind.SOURCES, ("track",), "background"),
    (Kind.NUMBER, ("track",), "fps"),
    (Kind.WORD, ("track",), "floor"),
    (Kind.SWITCH, ("track",), "no_time_offset"),
    (Kind.NAME_OR_FILE, ("track", "solve"), "marker_set"),
    (Kind.FILE, ("label", "solve"), "database subject skeleton"),
    (Kind.FILE, ("solve",), "names"),
    (Kind.WORD, ("solve",), "use up method feet units naming"),
    (Kind.NUMBER, ("solve",), "smooth rate"),
    (Kind.SWITCH, ("solve",), "refine_body"),
    (Kind.MOTIONS, (), "also"),
    (Kind.FILE, ("retarget",), "to blender"),
    (Kind.NAME_OR_FILE, ("retarget",), "map"),
    (Kind.WORD, ("retarget",), "root_motion"),
    (Kind.CHARACTER, (), "save_as"),
)
KEYS = {name: Key(kind, commands) for kind, commands, names in _KEYS for name in names.split()}


def _row(name: str, kind: Kind) -> schema.Key:
    about = f"{kind.value}: as `--{name.replace('_', '-')}`"
    if kind is Kind.NUMBER:
        return schema.Key(name, about, float, (), _UNITS[name], 0.0, 1e6, optional=True)
    if kind is Kind.SWITCH:
        return schema.Key(name, about, bool, optional=True)
    lists = kind in (Kind.SOURCES, Kind.CAMERAS, Kind.MOTIONS)
    choices = {Kind.MOTIONS: ALSO, Kind.CHARACTER: SAVED_AS}.get(kind, ())
    return schema.Key(name, about, str, (None,) if lists else (), least=1, choices=choices, optional=True)


_UNITS = {"fps": "frames per second", "rate": "frames per second", "smooth": "ms"}
PLAN = schema.Schema(
    "Plan of a batch",
    "For `perfanim batch`. Paths are relative to the plan.",
    (
        schema.Key("out", "folder of the results", str, optional=True),
        schema.Key("take", "the takes", (), (None,)),
    ),
    SettingsError,
    'add [[take]] tables with take = "FILE"',
)
TAKE = schema.Schema(
    "Take of a plan",
    "Of each table `[[take]]`; it may have each of the settings below, too.",
    (
        schema.Key("take", "file, folder or pattern; left out for videos", str, optional=True),
        schema.Key("name", "of the results; left out, the file's", str, optional=True),
    ),
    SettingsError,
    "see TOML files in the manual",
)
SETTINGS = schema.Schema(
    "Settings of a plan",
    "At the plan's top level for all takes, or in a take's table for that one.",
    tuple(_row(name, key.kind) for name, key in KEYS.items()),
    SettingsError,
    "see TOML files in the manual",
    closed=True,
)
_BODIES = ("subject", "skeleton")  # a take's own of either takes the place of both that all takes share
_PATTERN = "*?["
_MOST_FILES = 50_000  # that are looked at: a whole disk, named by mistake, is an error soon
_FORBIDDEN = '<>:"/\\|?*'  # in file names, on some system


@dataclass(frozen=True)
class TakePlan:
    """Plan of one take; plain values, to go to other processes as JSON.

    Args:
        source: the take as the plan names it.
        take: the file that is solved; "" when it is tracked from the videos of the options.
        options: values of `KEYS`, paths absolute.
        digest: hash of all that its outputs depend on (see `take_digest`); "" until it is computed.
    """

    name: str
    source: str
    take: str
    options: Mapping[str, Value] = field(default_factory=dict)
    digest: str = ""

    @property
    def is_tracked(self) -> bool:
        """Whether it begins with videos."""
        return not self.take

    def options_of(self, command: str) -> list[str]:
        """Return the command line options that the take's settings give a command."""
        line: list[str] = []
        for key, value in self.options.items():
            commands = KEYS[key].commands
            if key == "cameras" and not self.is_tracked:
                commands = ("solve",) if is_recorded(self.take) else ()
            if key in ("up", "names") and (self.is_tracked or is_recorded(self.take)):
                commands = ()  # takes of cameras have y up, and the set's names
            if key == "use" and is_recorded(self.take):
                commands = ()  # for marker takes
            if key == "blender" and "to" not in self.options:
                commands = ()
            if command not in commands or value is False:
                continue
            flag = f"--{key.replace('_', '-')}"
            if KEYS[key].kind is Kind.CAMERAS and isinstance(value, list):
                line += [part for camera in value for part in (flag, camera)]
            elif isinstance(value, list):
                line += [flag, *value]
            else:
                line += [flag] if value is True else [flag, str(value)]
        return line


@dataclass(frozen=True)
class Plan:
    """The takes of a batch, sorted by name, and its folder for results ("" for none)."""

    takes: tuple[TakePlan, ...]
    out: str = ""


def read_plan(path: Path | str, given: Mapping[str, Value]) -> Plan:
    """Return the plan of a TOML file.

    Args:
        given: options with priority over its shared ones; paths relative to the current folder.

    Raises:
        FormatError: it cannot be read. SettingsError: its keys or values are wrong.
    """
    where = str(path)
    tables = dict(read_toml(path))
    PLAN.check(tables, where)
    folder = Path(path).absolute().parent
    rows, out = tables.pop("take"), tables.pop("out", "")
    if not rows:
        raise SettingsError("names no takes", where=where, advice=PLAN.advice)
    shared = _merge(_resolve_paths(tables, folder, where), _resolve_paths(given, Path.cwd(), "options"))
    found: list[tuple[str, TakePlan]] = []
    for number, row in enumerate(rows, 1):
        found += _row_takes(row, shared, folder, f"{where}, take {number}")
    return Plan(_name_takes(found), str(folder / out) if out else "")


def plan_of(sources: Sequence[str], given: Mapping[str, Value]) -> Plan:
    """Return the plan for files, folders and patterns, with shared options."""
    shared = _resolve_paths(given, Path.cwd(), "options")
    takes = [take for source in sources for take in _find_takes(source, Path.cwd(), "takes")]
    return Plan(_name_takes([("", TakePlan("", label, path, shared)) for label, path in takes]))


def _row_takes(
    row: Mapping[str, Any], shared: Mapping[str, Value], folder: Path, where: str
) -> list[tuple[str, TakePlan]]:
    """Return the takes of one table, and the name that it gives, "" when none."""
    TAKE.check(row, where)
    own = dict(row)
    take, name = own.pop("take", ""), own.pop("name", "")
    if name and (set(name) & set(_FORBIDDEN) or name != name.strip(". ")):
        raise SettingsError(f"{name!r} cannot be the name of a file", where=where, advice="choose another name")
    options = _merge(shared, _resolve_paths(own, folder, where))
    if take:
        takes = _find_takes(take, folder, where)
        if name and len(takes) > 1:
            raise SettingsError(f"{len(takes)} takes have one name", where=where, advice="leave name out")
        return [(name, TakePlan("", label, path, options)) for label, path in takes]
    images = [key for key in ("left", "camera") if own.get(key)]
    if not images:
        raise SettingsError("has neither take nor left", where=where, advice="name a marker take, or videos")
    if "cameras" not in options:
        raise SettingsError("has videos without cameras", where=where, advice="name their calibration")
    first = own[images[0]]
    first = first[0].rpartition("=")[2] if isinstance(first, list) else first
    return [(name, TakePlan("", first, "", options))]


def _merge(shared: Mapping[str, Value], own: Mapping[str, Value]) -> dict[str, Value]:
    """Return a take's settings: its own have priority over the shared ones."""
    left = {key: value for key, value in shared.items() if key not in _BODIES or not set(_BODIES) & set(own)}
    return {**left, **own}


def _resolve_paths(table: Mapping[str, Any], folder: Path, where: str) -> dict[str, Value]:
    """Return the values of keys, checked, with absolute paths."""
    SETTINGS.check(table, where)
    return {key: _value(KEYS[key].kind, value, folder) for key, value in table.items()}


def _value(kind: Kind, value: Any, folder: Path) -> Value:
    """Return a value that the schema allows, its paths absolute."""
    if kind is Kind.NUMBER:
        return float(value)
    if kind is Kind.MOTIONS:
        return sorted(set(value))
    if kind in (Kind.SOURCES, Kind.CAMERAS):
        return [_source(text, folder, kind is Kind.CAMERAS) for text in value]
    is_path = kind in (Kind.FILE, Kind.SOURCE) or (kind is Kind.NAME_OR_FILE and is_file(folder / value))
    checked: Value = _absolute(value, folder) if is_path else value
    return checked


def _source(text: str, folder: Path, named: bool) -> str:
    name, equals, source = text.partition("=")
    return f"{name}={_absolute(source, folder)}" if named and equals else _absolute(text, folder)


def _absolute(text: str, folder: Path) -> str:
    return os.path.abspath(folder / text)  # noqa: PTH100 - links stay as they were named


def _find_takes(text: str, folder: Path, where: str) -> list[tuple[str, str]]:
    """Return label and path of each take of a file, folder or pattern."""
    path = Path(_absolute(text, folder))
    if is_folder(path):
        # names first: whether it is a file is asked of takes only
        files = (Path(place, name) for place, _, names in os.walk(path) for name in names)
        found = [file for file in _within_limit(files, where, text) if _is_take(file.name.lower()) and is_file(file)]
    elif is_file(path) or not set(text) & set(_PATTERN):
        found = [path]  # a missing file is a bad take; the others are done
    else:
        names = glob.iglob(str(path), recursive=True)  # noqa: PTH207 - a whole path
        found = [Path(name) for name in _within_limit(names, where, text)]
    if not found:
        raise SettingsError("there are no takes", where=f"{where}: {text}", advice="check the path")
    return [(_label(file, folder), str(file)) for file in sorted(found)]


def _within_limit(files: Iterable[Any], where: str, text: str) -> Iterator[Any]:
    """Yield files up to the most that a folder of takes may hold."""
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
    """Return takes under different names, sorted; the order given does not matter.

    A take is named after its file; takes with one file name get their folders, and then their endings, too.
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
