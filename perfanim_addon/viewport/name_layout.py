"""Layout of the markers' names without overlaps."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count

from ...core.geometry.arrays import Array

Box = tuple[float, float, float, float]  # left, bottom, right, top


@dataclass(frozen=True)
class Lettering:
    """Heights relative to the text size, measured with Blender's font."""

    above: float = 0.95  # highest point of letters above the baseline
    below: float = 0.25  # lowest point of letters below the baseline
    middle: float = 0.35  # middle of letters above the baseline
    line: float = 1.25  # distance between two lines


_LETTERS = Lettering()


@dataclass(frozen=True)
class PlacedName:
    """Position of a name in pixels."""

    start: tuple[float, float]  # left end of the letters' baseline
    box: Box  # covered area
    near: tuple[float, float]  # middle of the side that faces the named point
    is_away: bool  # whether the name is so far from its point that it needs a leader line


def place_names(points: Array, widths: Sequence[float], size: float, beside: float, dot: float) -> list[PlacedName]:
    """Return a position for each name, the first free one near its point; earlier names choose first.

    Args:
        points: Named points (N, 2).
        widths: Widths of the names.
        size: Size of the text.
        beside: Distance from a point to its name.
        dot: Radius of the dots at the points, which names must not cover.
    """
    taken: list[Box] = [(x - dot, y - dot, x + dot, y + dot) for x, y in points.tolist()]
    placed = []
    for (x, y), width in zip(points.tolist(), widths, strict=True):
        name = next(
            each for each in _candidates(x, y, width, size, beside) if not any(_overlap(each.box, box) for box in taken)
        )
        taken.append(name.box)
        placed.append(name)
    return placed


def _candidates(x: float, y: float, width: float, size: float, beside: float) -> Iterator[PlacedName]:
    """Yield positions right and left of a point, then farther and farther above and below it."""
    for lines in count():
        for up in (lines, -lines) if lines else (0,):
            aside = beside * (1 + lines)  # slanting lines to neighbours can be told apart
            middle = y + up * _LETTERS.line * size
            base = middle - _LETTERS.middle * size
            for left, near in ((x + aside, x + aside), (x - aside - width, x - aside)):
                box = (left, base - _LETTERS.below * size, left + width, base + _LETTERS.above * size)
                yield PlacedName((left, base), box, (near, middle), lines > 0)


def _overlap(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
