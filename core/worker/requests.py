"""Contents of the jobs' requests; the modules of the jobs say their meaning."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..errors import SettingsError, shorten

_LONGEST_S = 3600.0
_LARGEST = 1e12
_MOST_PORT = 65_535


@dataclass(frozen=True)
class Kind:
    """A kind of value in JSON.

    Args:
        words: for messages.
        fields: of a table, or of each table of a list.
        is_optional: whether null, or no value at all, will do.
    """

    words: str
    holds: Callable[[Any], bool]
    fields: Mapping[str, "Kind"] = field(default_factory=dict)
    is_optional: bool = False


_NO_FIELDS: Mapping[str, Kind] = {}


def optional(kind: Kind) -> Kind:
    """Return the kind that may be left out."""
    return Kind(kind.words, kind.holds, kind.fields, is_optional=True)


def number(words: str, least: float, most: float, whole: bool = False) -> Kind:
    """Return the kind of finite numbers in a range."""
    types = int if whole else int | float

    def holds(value: Any) -> bool:
        return isinstance(value, types) and not isinstance(value, bool) and least <= value <= most

    return Kind(f"{words} from {least:g} to {most:g}", holds)


def table(fields: Mapping[str, Kind] = _NO_FIELDS) -> Kind:
    """Return the kind of tables with these fields; others are not looked at."""
    return Kind("a table", lambda value: isinstance(value, dict), fields)


def rows(fields: Mapping[str, Kind] = _NO_FIELDS) -> Kind:
    """Return the kind of lists of such tables, one at least."""
    return Kind("a list of tables", lambda value: bool(value) and _is_list(value, table().holds), fields)


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and "\0" not in value


def _is_list(value: Any, holds: Callable[[Any], bool]) -> bool:
    return isinstance(value, list) and all(map(holds, value))


def _is_place(value: Any) -> bool:
    return _is_list(value, _NUMBER.holds) and len(value) == 3


def _is_address(value: Any) -> bool:
    return isinstance(value, list) and (not value or (len(value) == 2 and _is_text(value[0]) and _PORT.holds(value[1])))


_TEXT, _FLAG = Kind("text", _is_text), Kind("true or false", lambda value: isinstance(value, bool))
_TEXTS = Kind("a list of texts", lambda value: _is_list(value, _is_text))
_NUMBER = number("a number", -_LARGEST, _LARGEST)
_COUNT = number("a whole number", 0, 1_000_000, whole=True)
_SECONDS = number("seconds", 0.0, _LONGEST_S)
_PORT = number("a port", 0, _MOST_PORT, whole=True)
_PLACES = Kind("a list of places, each a camera's number, x and y", lambda value: _is_list(value, _is_place))
_ADDRESS = Kind("a host and a port", _is_address)

_SOURCE = table(
    {
        "kind": _TEXT,
        "paths": optional(_TEXTS),
        "cameras": optional(number("a whole number", 1, 8, whole=True)),
        "port": optional(_PORT),
        "sender": optional(_TEXT),
    }
)
_AFTER = table(
    {
        "number": number("a whole number", -_LARGEST, _LARGEST, whole=True),
        "time_s": _NUMBER,
        "stamp_s": _NUMBER,
        "period_s": number("seconds", 1e-6, 60.0),
    }
)
_CAMERAS = {
    "source": _SOURCE,
    "rig": optional(table()),
    "background_s": optional(_SECONDS),
    "threshold": optional(number("grey levels", 0.0, 255.0)),
    "in_flight": optional(_COUNT),
    "preview": optional(_FLAG),
    "background_file": optional(_TEXT),
    "after": optional(_AFTER),
}
_TRACKERS = {
    "source": table({"port": _PORT, "sender": optional(_TEXT)}),
    "marker_set": table(),
    "after": optional(_AFTER),
}
_CAPTURE = {
    "cameras": table(_CAMERAS),
    "performers": rows({"marker_set": table()}),
    "props": optional(Kind("a list of tables", lambda value: _is_list(value, table().holds))),
    "database": _TEXT,
    "settings": optional(table()),
    "take": optional(_TEXT),
    "character": optional(_TEXT),
    "shape": optional(table()),
    "vmc": optional(_ADDRESS),
    "after": optional(_AFTER),
    "cause": optional(_TEXT),
}
_BOARD = {"source": _SOURCE, "board": _TEXT, "preview": optional(_FLAG)}
_POSE = {
    **_CAMERAS,
    "marker_set": _TEXT,
    "poses": _TEXTS,
    "countdown_s": optional(_SECONDS),
    "between_s": optional(_SECONDS),
    "seconds": _SECONDS,
    "out": _TEXT,
    "floor_out": optional(_TEXT),
}
_SKETCH = {"sketch": table(), "settings": table(), "number": optional(_COUNT), "frame": optional(_NUMBER)}
_REQUESTS: dict[str, Mapping[str, Kind]] = {
    "capture": _CAPTURE,
    "cameras": _CAMERAS,
    "trackers": _TRACKERS,
    "command": {"arguments": _TEXTS, "gently": optional(_FLAG)},
    "record board": {
        **_BOARD,
        "limit": number("a whole number", 1, 10_000, whole=True),
        "every_s": optional(_SECONDS),
        "out": _TEXT,
    },
    "record floor": {**_BOARD, "rig": table()},
    "record floor markers": {
        **_CAMERAS,
        "height_m": optional(number("metres", -10.0, 10.0)),
        "longest_m": optional(number("metres", 0.0, 100.0)),
    },
    "record pose": _POSE,
    "calibrate performer": {**_POSE, "name": _TEXT, "subject_out": _TEXT},
    "show cameras": {},
    "check setup": {
        **_CAMERAS,
        "marker_set": _TEXT,
        "countdown_s": optional(_SECONDS),
        "fault": optional(_TEXT),
        "ignored": optional(_PLACES),
    },
    "sketch": {"skeleton": rows(), "database": _TEXT, "live": optional(_FLAG), **_SKETCH},
    "sketch edit": {**_SKETCH, "number": _COUNT, "frame": _NUMBER},
}


def check_request(job: str, request: Mapping[str, Any]) -> None:
    """Check that a job's request has all that it must, of the right kinds.

    Raises:
        SettingsError: a value is missing, of another kind, or out of its range.
    """
    _check(_REQUESTS[job], request, f"request of the job {job}", "")


def _check(fields: Mapping[str, Kind], values: Mapping[str, Any], where: str, path: str) -> None:
    for key, kind in fields.items():
        value: Any = values.get(key)
        name = f"{path}{key}"
        if value is None and kind.is_optional:
            continue
        if not kind.holds(value):
            given = "missing" if value is None else shorten(repr(value), 40)
            raise SettingsError(f"{name!r} must be {kind.words}, it is {given}", where=where, advice="start it again")
        for row in (value if isinstance(value, list) else [value]) if kind.fields else ():
            _check(kind.fields, row, where, f"{name}.")
