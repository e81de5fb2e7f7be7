"""Schemas of files: each key's values, unit and range, in one place.

A reader holds a file's tables against its schema before it uses them, so errors name the key and what it may be; the
same rows are the file's page in the manual.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from ..errors import PerfanimError, shorten

Shape: TypeAlias = tuple[int | None, ...]
_LARGEST = 1e300  # whole numbers have no end
_NUMBERS = (int, float, np.int64, np.float64)  # no truth values, which are int's
_COUNTS = {2: "two", 3: "three", 4: "four"}


@dataclass(frozen=True)
class Key:
    """A key of a table.

    Args:
        about: what it holds, for the manual.
        holds: str, bool, int or float; or the keys of a table, () where others look at them.
        shape: lengths of nested lists, None for any; () for a single value.
        or_shape: another one that will do.
        unit: of a number; least, most: its range; least of a text: characters.
        choices: the texts that are possible, () for any.
        named: whether it is a table of such values under names of the file's own.
        optional: whether it may be left out.
    """

    name: str
    about: str
    holds: "type | tuple[Key, ...]"
    shape: Shape = ()
    unit: str = ""
    least: float = -math.inf
    most: float = math.inf
    optional: bool = False
    or_shape: Shape = ()
    choices: tuple[str, ...] = ()
    named: bool = False

    @property
    def text(self) -> str:
        """Possible values in plain words: "three numbers from -1 to 1 m"."""
        shapes = [self.shape, *([self.or_shape] if self.or_shape else [])]
        amounts = " or ".join(map(self._amount, shapes)) + self._range
        return f"a table [{self.name}] of names, each with {amounts}" if self.named else amounts

    def allows(self, value: Any) -> bool:
        """Return whether a value is possible, apart from a table's keys."""
        if self.named:
            return isinstance(value, Mapping) and all(map(self._allows_one, value.values()))
        return self._allows_one(value)

    def rows(self, value: Any) -> Iterator[tuple[str, Any]]:
        """Yield the name and the keys of each table of a value that is allowed."""
        if self.named:
            yield from value.items()
            return
        for number, row in enumerate(value if self.shape else [value], 1):
            name = row.get("name")
            yield name if isinstance(name, str) and name else f"{self.name} {number}" if self.shape else self.name, row

    def _allows_one(self, value: Any) -> bool:
        return _fits(value, self, self.shape) or (self.or_shape != () and _fits(value, self, self.or_shape))

    def _amount(self, shape: Shape) -> str:
        one, many = self._names
        if not shape:
            return one
        counts = [_COUNTS.get(length or 0, str(length)) for length in shape]
        if shape[0] is not None:
            return f"{counts[0] if len(shape) == 1 else ' x '.join(map(str, shape))} {many}"
        return f"a list of {many}" if len(shape) == 1 else f"a list of rows of {counts[1]} {many}"

    @property
    def _names(self) -> tuple[str, str]:
        if self.choices:
            return f"one of {', '.join(self.choices)}", f"texts out of {', '.join(self.choices)}"
        if isinstance(self.holds, tuple):
            if self.named:
                return "a table", "tables"
            return f"a table [{self.name}]", f"tables [[{self.name}]]"
        return {
            str: ("a text that is not empty", "texts that are not empty") if self.least > 0 else ("a text", "texts"),
            bool: ("true or false", "of true or false"),
            int: ("a whole number", "whole numbers"),
        }.get(self.holds, ("a number", "numbers"))

    @property
    def _range(self) -> str:
        if self.holds is str:
            return ""
        unit = f" {self.unit}" if self.unit else ""
        low, high = (f"{limit:,.12g}" for limit in (self.least, self.most))
        if math.isinf(self.least):
            return f" up to {high}{unit}" if math.isfinite(self.most) else unit
        return f" from {low}{unit} on" if math.isinf(self.most) else f" from {low} to {high}{unit}"


@dataclass(frozen=True)
class Schema:
    """The tables of a kind of file.

    Args:
        title: what the file is; about: where it comes from, and what else holds, for the manual.
        error, advice: of a file that does not fit.
        closed: whether keys of no row are refused: where a slip of the pen would pass unseen.
    """

    title: str
    about: str
    keys: tuple[Key, ...]
    error: type[PerfanimError]
    advice: str = ""
    closed: bool = False

    def check(self, tables: Mapping[str, Any], where: str) -> None:
        """Raise the schema's error for the first value that does not fit.

        Keys that the schema does not name are left to their readers, unless it is closed.
        """
        unknown = sorted(set(tables) - {key.name for key in self.keys}) if self.closed else ()
        if unknown:
            names = ", ".join(sorted(key.name for key in self.keys))
            raise self.error(f"there is no key {shorten(unknown[0], 40)!r}", where=where, advice=f"keys: {names}")
        for place, fact in _misfits(tables, self.keys, where):
            raise self.error(fact, where=place, advice=self.advice)

    def check_each(self, tables: Mapping[str, Any], where: str) -> None:
        """Raise the schema's error unless each value is a table that fits."""
        for name, table in tables.items():
            if not isinstance(table, Mapping):
                raise self.error(f"{shorten(name, 40)} must be a table", where=where, advice=self.advice)
            self.check(table, f"{where}, {shorten(name, 40)}")


def _misfits(table: Mapping[str, Any], keys: Sequence[Key], where: str) -> Iterator[tuple[str, str]]:
    """Yield place and fact of values that do not fit."""
    for key in keys:
        if table.get(key.name) is None:
            if not key.optional:
                yield where, f"lacks {key.name!r}, {key.text}"
        elif not key.allows(table[key.name]):
            yield where, f"{key.name} must be {key.text}"
        elif isinstance(key.holds, tuple):
            for name, row in key.rows(table[key.name]):
                yield from _misfits(row, key.holds, f"{where}, {shorten(name, 40)}")


def _fits(value: Any, key: Key, shape: Shape) -> bool:
    """Return whether a value, or the values of a list, are possible for a key."""
    if shape:
        if isinstance(value, str | Mapping) or not hasattr(value, "__len__"):
            return False
        return shape[0] in (None, len(value)) and all(_fits(item, key, shape[1:]) for item in value)
    if isinstance(key.holds, tuple):
        return isinstance(value, Mapping)
    if key.holds is str:
        return isinstance(value, str) and len(value) >= key.least and (not key.choices or value in key.choices)
    if key.holds is bool:
        return isinstance(value, bool)
    if type(value) not in _NUMBERS or not abs(value) <= _LARGEST:  # NaN, too
        return False
    return bool(key.least <= value <= key.most and (key.holds is float or value == int(value)))


def manual_lines(schema: Schema) -> list[str]:
    """Return a schema's section of the manual, Markdown."""
    lines = [f"## {schema.title}", "", schema.about, "", "| key | holds | value |", "|---|---|---|"]
    return [*lines, *_rows(schema.keys, ""), ""]


def _rows(keys: Sequence[Key], prefix: str) -> Iterator[str]:
    for key in keys:
        optional = "; may be left out" if key.optional else ""
        yield f"| `{prefix}{key.name}` | {key.about} | {key.text}{optional} |"
        if isinstance(key.holds, tuple):
            yield from _rows(key.holds, f"{prefix}{key.name}.")
