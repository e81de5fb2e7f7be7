"""Schemas: dataclasses that describe the valid values in files, requests and settings.

A field is annotated with its meaning, unit and range:

    height_m: Annotated[float, About("body height", "m", least=0.5, most=2.5)] = 1.75

A `Schema` reads tables (TOML, JSON) as such a dataclass, reports invalid values, and makes rows for the manual.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from enum import Enum, EnumType
from numbers import Real
from types import NoneType, UnionType
from typing import Annotated, Any, Generic, TypeAlias, TypeVar, Union, get_args, get_origin, get_type_hints

from ..errors import PerfanimError, SettingsError, shorten

Table: TypeAlias = Mapping[str, Any]
Shape: TypeAlias = tuple[int | None, ...]
_T = TypeVar("_T")
_VERSION = 1  # version of all files that state a kind
_LARGEST = 1e300  # largest number accepted: Python's integers have no limit
_COUNTS = {2: "two", 3: "three", 4: "four"}


@dataclass(frozen=True)
class About:
    """Meaning and range of a field.

    Args:
        text: Meaning, for the manual.
        unit: Unit of the numbers.
        least: Smallest number, or smallest length of a string.
        most: Largest number.
        above: Number that must be exceeded.
        fewest: Fewest entries of a list.
        choices: Valid strings; empty for any.
        shape: Shape of an array; None for any length.
        or_shape: Another possible shape.
        key: Key in the table, if it differs from the field's name.
        optional: Whether the key may be left out; by default it may if the field has a default value.
    """

    text: str
    unit: str = ""
    least: float = -math.inf
    most: float = math.inf
    above: float = -math.inf
    fewest: int = 0
    choices: tuple[str, ...] = ()
    shape: Shape = ()
    or_shape: Shape = ()
    key: str = ""
    optional: bool | None = None


@dataclass(frozen=True)
class Via:
    """Alternative form of a value in tables.

    Args:
        form: Type of the form.
        read: Turns the form into the value; the second argument says where the value is, for error messages.
        write: Turns the value into the form.
    """

    form: Any
    read: Callable[[Any, str], Any]
    write: Callable[[Any], Any]


class _WrongError(Exception):
    """A value is not valid for its key."""


class _MisfitError(Exception):
    """A table is not valid; the arguments say where it is and what is wrong."""


class Key:
    """A dataclass field as a key of its table."""

    about = About("")
    holds: tuple[Any, ...] = ()  # valid types: str, bool, int, float, Mapping, Enums or dataclasses
    _shape: Shape = ()  # lengths of nested lists
    _is_named = False  # a table of values with arbitrary names
    _array: Any = None  # type of an array's numbers
    _or_none = False  # whether values of a list or table may be null
    _via: Via | None = None
    _item_via: Via | None = None  # for each value of a list

    def __init__(self, field: "Field[Any]", hint: Any) -> None:
        self._add(hint)
        self.field, self.name = field.name, self.about.key or field.name
        self.default = field.default if field.default_factory is MISSING else field.default_factory()
        self.optional = self.default is not MISSING if self.about.optional is None else self.about.optional
        enums = [kind for kind in self.holds if isinstance(kind, EnumType)]
        self.choices = self.about.choices or tuple(str(value) for kind in enums for value in plain(list(kind)))
        self.is_table = self.holds[0] is Mapping or is_dataclass(self.holds[0])

    def _add(self, hint: Any) -> None:
        """Adopt the parts of a type annotation."""
        origin, parts = get_origin(hint), get_args(hint)
        if origin is Annotated:
            self.about = next((note for note in parts if isinstance(note, About)), self.about)
            via = next((note for note in parts if isinstance(note, Via)), None)
            if via and self._shape:
                self._item_via = via
            elif via:
                self._via = via
            self._add(via.form if via else parts[0])
        elif origin in (Union, UnionType):
            self._or_none |= NoneType in parts and (self._is_named or bool(self._shape))
            self.holds = tuple(part for part in parts if part is not NoneType)
            if len(self.holds) == 1:
                self._add(self.holds[0])
        elif origin is tuple:
            self._shape = (*self._shape, None if parts[-1] is ... else len(parts))
            self._add(parts[0])
        elif getattr(origin, "__name__", "") == "ndarray":
            self._array, self._shape = get_args(parts[1])[0], self.about.shape
            self.holds = (float if "float" in self._array.__name__ else int,)
        elif origin in (Mapping, dict) and parts[1] is not Any:
            self._is_named = True
            self._add(parts[1])
        else:
            self.holds = (origin or hint,)

    @property
    def is_list(self) -> bool:
        """Whether the field contains a list of values."""
        return bool(self._shape)

    @property
    def text(self) -> str:
        """Valid values in plain words, such as "three numbers from -1 to 1 m"."""
        shapes = [self._shape, *([self.about.or_shape] if self.about.or_shape else [])]
        amounts = " or ".join(map(self._amount, shapes)) + self._range
        return f"a table [{self.name}] of names, each with {amounts}" if self._is_named else amounts

    def _amount(self, shape: Shape) -> str:
        one, many = self._nouns
        if not shape:
            return one
        counts = [_COUNTS.get(length or 0, str(length)) for length in shape]
        if shape[0] is not None:
            return f"{counts[0] if len(shape) == 1 else ' x '.join(map(str, shape))} {many}"
        many = f"{self.about.fewest} or more {many}" if self.about.fewest else many
        return f"a list of {many}" if len(shape) == 1 else f"a list of rows of {counts[1]} {many}"

    @property
    def _nouns(self) -> tuple[str, str]:
        if self.choices:
            return f"one of {', '.join(self.choices)}", f"strings out of {', '.join(self.choices)}"
        if self.is_table:
            return ("a table", "tables") if self._is_named else (f"a table [{self.name}]", f"tables [[{self.name}]]")
        nouns = {
            str: ("a non-empty string", "non-empty strings") if self.about.least > 0 else ("a string", "strings"),
            bool: ("true or false", "booleans"),
            int: ("a whole number", "whole numbers"),
            float: ("a number", "numbers"),
        }
        one, many = zip(*(nouns[kind] for kind in self.holds), strict=True)
        return " or ".join(one), " or ".join(many)

    @property
    def _range(self) -> str:
        about = self.about
        if not {int, float} & set(self.holds):
            return ""
        unit = f" {about.unit}" if about.unit else ""
        most = f"{about.most:,.12g}{unit}"
        if math.isfinite(about.above):
            return f" above {about.above:,.12g}{unit}" + (f" up to {most}" if math.isfinite(about.most) else "")
        if math.isinf(about.least):
            return f" up to {most}" if math.isfinite(about.most) else unit
        least = f"{about.least:,.12g}"
        return f" of at least {least}{unit}" if math.isinf(about.most) else f" from {least} to {most}"

    def read(self, value: Any, where: str) -> Any:
        """Return the field's value; raise _WrongError for an invalid one."""
        if self._is_named:
            if not isinstance(value, Mapping):
                raise _WrongError
            return {name: self._one(item, f"{where}, {shorten(name, 40)}") for name, item in value.items()}
        try:
            made = self._listed(value, self._shape, where)
        except _WrongError:
            if not self.about.or_shape:
                raise
            made = self._listed(value, self.about.or_shape, where)
        if self._array is not None:
            import numpy as np  # imported here, so that the preferences work even if NumPy is broken

            made = np.array(made, dtype=self._array)
        return made if self._via is None else self._via.read(made, where)

    def _listed(self, value: Any, shape: Shape, where: str) -> Any:
        if not shape:
            return self._one(value, f"{where}, {_row_name(value, self.name)}" if self.is_table else where)
        if isinstance(value, str | Mapping) or not hasattr(value, "__len__") or shape[0] not in (None, len(value)):
            raise _WrongError
        if len(value) < self.about.fewest:
            raise _WrongError
        if not self.is_table:
            return tuple(self._listed(item, shape[1:], where) for item in value)
        names = [_row_name(row, f"{self.name} {number}") for number, row in enumerate(value, 1)]
        return tuple(self._one(row, f"{where}, {name}") for row, name in zip(value, names, strict=True))

    def _one(self, value: Any, where: str) -> Any:
        if value is None and self._or_none:
            return None
        if not self.is_table:
            return self._single(value)
        if not isinstance(value, Mapping):
            raise _WrongError
        made = value if self.holds[0] is Mapping else _read(self._kind(value, where), value, where)
        return made if self._item_via is None else self._item_via.read(made, where)

    def _kind(self, table: Table, where: str) -> Any:
        """Return the dataclass of a table, chosen by the key "kind" if there are several."""
        kinds = {getattr(each, "kind", ""): each for each in self.holds}
        kind = table.get("kind") if len(kinds) > 1 else next(iter(kinds))
        if not isinstance(kind, str) or kind not in kinds:
            raise _MisfitError(where, f"kind must be one of {', '.join(kinds)}")
        return kinds[kind]

    def _single(self, value: Any) -> Any:
        """Return a valid string, boolean or number."""
        about = self.about
        for kind in self.holds:
            if kind is str or isinstance(kind, EnumType):
                fits = isinstance(value, str) and len(value) >= about.least and "\0" not in value
                fits = fits and (not self.choices or value in self.choices)
            elif kind is bool:
                fits = isinstance(value, bool)
            else:
                fits = _is_number(value) and abs(value) <= _LARGEST  # false for NaN, too
                fits = fits and about.least <= value <= about.most and value > about.above
                fits = fits and (kind is float or type(value) is int or (len(self.holds) == 1 and value == int(value)))
            if fits:
                return kind(value)
        raise _WrongError

    def form(self, value: Any) -> Any:
        """Return a value of the field in the form that tables use."""
        if self._item_via is not None:
            return [plain(self._item_via.write(item)) for item in value]
        return plain(value if self._via is None else self._via.write(value))


@dataclass(frozen=True)
class Schema(Generic[_T]):
    """Tables of one kind of file or request.

    Args:
        cls: Dataclass that the tables become.
        title: Kind of file.
        about: Origin of the file and further rules, for the manual.
        error: Class of the error raised for invalid tables.
        advice: Advice in these errors.
        closed: Whether unknown keys are rejected, for tables in which a misspelt key would go unnoticed.
        kind: Value of the key "kind" in such a file, which then also has a "version".
    """

    cls: type[_T]
    title: str
    about: str
    error: type[PerfanimError]
    advice: str = ""
    closed: bool = False
    kind: str = ""

    def read(self, table: Table, where: str) -> _T:
        """Return what a table describes; unknown keys are ignored unless the schema is closed.

        Raises:
            PerfanimError: A value is not valid; the class is the schema's `error`.
        """
        if self.kind and (table.get("kind") != self.kind or table.get("version") != _VERSION):
            kind = self.kind.removeprefix("perfanim ")
            raise self.error(f"is not a {kind} file of this version", where=where, advice=self.advice)
        names = sorted(key.name for key in keys_of(self.cls))
        unknown = sorted(set(table) - set(names)) if self.closed else ()
        if unknown:
            advice = f"known keys: {', '.join(names)}"
            raise self.error(f"has an unknown key {shorten(unknown[0], 40)!r}", where=where, advice=advice)
        try:
            return _read(self.cls, table, where)
        except _MisfitError as error:
            place, fact = error.args
            raise self.error(fact, where=place, advice=self.advice) from None

    def read_each(self, tables: Table, where: str) -> dict[str, _T]:
        """Return what each of several named tables describes; the name is also the default of the key "name".

        Errors are those of `read`.
        """
        for name, table in tables.items():
            if not isinstance(table, Mapping):
                raise self.error(f"{shorten(name, 40)} must be a table", where=where, advice=self.advice)
        named = {name: {"name": name} | dict(table) for name, table in tables.items()}
        return {name: self.read(table, f"{where}, {shorten(name, 40)}") for name, table in named.items()}

    def table(self, value: _T) -> dict[str, Any]:
        """Return the table for a value, with kind and version."""
        return ({"kind": self.kind, "version": _VERSION} if self.kind else {}) | table_of(value)

    def manual_lines(self) -> list[str]:
        """Return the section for the manual, in Markdown."""
        lines = [f"## {self.title}", "", self.about, "", "| key | holds | value |", "|---|---|---|"]
        kind = [f'| `kind` | "{self.kind}" | a string |', f"| `version` | {_VERSION} | a whole number |"]
        return [*lines, *(kind if self.kind else []), *_rows(self.cls, ""), ""]


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and value is not True and value is not False  # bool is a Real, too


def table_of(value: Any) -> dict[str, Any]:
    """Return a dataclass as a table; optional values that equal their defaults are left out."""
    table = {}
    for key in keys_of(type(value)):
        own = getattr(value, key.field)
        is_default = not own.size if hasattr(own, "size") else own == key.default
        if own is not None and not (key.optional and is_default):
            table[key.name] = key.form(own)
    return table


def check_ranges(value: Any) -> None:
    """Raise SettingsError if a number or string of a dataclass is out of range."""
    for key in keys_of(type(value)):
        own = getattr(value, key.field)
        try:
            if own is not None and not key.is_table:
                key.read(key.form(own), "")
        except _WrongError:
            raise SettingsError(f"{key.name} must be {key.text}") from None


_known_keys: dict[Any, Sequence[Key]] = {}


def _read(cls: type[_T], table: Table, where: str) -> _T:
    """Return what a table describes; unknown keys are rejected if the dataclass has `is_closed`."""
    unknown = sorted(set(table) - {key.name for key in keys_of(cls)}) if getattr(cls, "is_closed", False) else ()
    if unknown:
        raise _MisfitError(where, f"has an unknown setting {shorten(unknown[0], 40)!r}")
    values = {}
    for key in keys_of(cls):
        value = table.get(key.name)
        if value is None:
            if not key.optional:
                raise _MisfitError(where, f"lacks {key.name!r}, {key.text}")
            continue
        try:
            values[key.field] = key.read(value, where)
        except _WrongError:
            raise _MisfitError(where, f"{key.name} must be {key.text}") from None
    return cls(**values)


def plain(value: Any) -> Any:
    """Return a value in the form that tables use, with Python's own types."""
    if is_dataclass(value):
        return table_of(value)
    if isinstance(value, Enum):
        return value.value
    if hasattr(value, "tolist"):  # a NumPy value
        return value.tolist()
    if isinstance(value, Mapping):
        return {name: plain(item) for name, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value


def _rows(cls: Any, prefix: str) -> Iterator[str]:
    for key in keys_of(cls):
        optional = "; may be left out" if key.optional else ""
        yield f"| `{prefix}{key.name}` | {key.about.text} | {key.text}{optional} |"
        for kind in filter(is_dataclass, key.holds):
            yield from _rows(kind, f"{prefix}{key.name}.")


def keys_of(cls: Any) -> Sequence[Key]:
    """Return the keys of a dataclass's table."""
    if cls not in _known_keys:
        hints = get_type_hints(cls, include_extras=True)
        _known_keys[cls] = [Key(each, hints[each.name]) for each in fields(cls) if each.init]
    return _known_keys[cls]


def _row_name(row: Any, otherwise: str) -> str:
    name = row.get("name") if isinstance(row, Mapping) else None
    return shorten(name if isinstance(name, str) and name else otherwise, 40)
