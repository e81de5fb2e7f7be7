"""Schemas of files: each key's values, unit and range, in one place.

A reader holds a file's tables against its schema before it uses them, so errors name the key and what it may be; the
same rows are the file's page in the manual.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from ..errors import PerfanimError

Shape: TypeAlias = tuple[int | None, ...]
_LARGEST = 1e300  # whole numbers have no end
_NUMBERS = (int, float, np.int64, np.float64)  # no truth values, which are int's
_COUNTS = {2: "two", 3: "three", 4: "four"}


@dataclass(frozen=True)
class Key:
    """A key of a table.

    Args:
        about: what it holds, for the manual.
        holds: str, bool, int or float; or the keys of a table.
        shape: lengths of nested lists, None for any; () for a single value.
        or_shape: another one that will do.
        unit: of a number; least, most: its range.
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

    @property
    def text(self) -> str:
        """Possible values in plain words: "three numbers from -1 to 1 m"."""
        shapes = [self.shape, *([self.or_shape] if self.or_shape else [])]
        return " or ".join(map(self._amount, shapes)) + self._range

    def allows(self, value: Any) -> bool:
        """Return whether a value is possible, apart from a table's keys."""
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
        if isinstance(self.holds, tuple):
            return f"a table [{self.name}]", f"tables [[{self.name}]]"
        return {
            str: ("a text", "texts"),
            bool: ("true or false", "of true or false"),
            int: ("a whole number", "whole numbers"),
        }.get(self.holds, ("a number", "numbers"))

    @property
    def _range(self) -> str:
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
    """

    title: str
    about: str
    keys: tuple[Key, ...]
    error: type[PerfanimError]
    advice: str = ""

    def check(self, tables: Mapping[str, Any], where: str) -> None:
        """Raise the schema's error for the first value that does not fit.

        Keys that the schema does not name are left to their readers.
        """
        for place, fact in _misfits(tables, self.keys, where):
            raise self.error(fact, where=place, advice=self.advice)


def _misfits(table: Mapping[str, Any], keys: Sequence[Key], where: str) -> Iterator[tuple[str, str]]:
    """Yield place and fact of values that do not fit."""
    for key in keys:
        if table.get(key.name) is None:
            if not key.optional:
                yield where, f"lacks {key.name!r}, {key.text}"
        elif not key.allows(table[key.name]):
            yield where, f"{key.name} must be {key.text}"
        elif isinstance(key.holds, tuple):
            rows = table[key.name] if key.shape else [table[key.name]]
            for number, row in enumerate(rows, 1):
                name = row.get("name")
                own = f"{key.name} {number}" if key.shape else key.name
                yield from _misfits(row, key.holds, f"{where}, {name if isinstance(name, str) and name else own}")


def _fits(value: Any, key: Key, shape: Shape) -> bool:
    """Return whether a value, or the values of a list, are possible for a key."""
    if shape:
        if isinstance(value, str | Mapping) or not hasattr(value, "__len__"):
            return False
        return shape[0] in (None, len(value)) and all(_fits(item, key, shape[1:]) for item in value)
    if isinstance(key.holds, tuple):
        return isinstance(value, Mapping)
    if key.holds in (str, bool):
        return isinstance(value, key.holds)
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
