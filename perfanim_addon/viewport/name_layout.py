"""Layout of the markers' names, so that no two lie over each other."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count

from ...core.geometry.arrays import Array

_ABOVE, _BELOW = 0.95, 0.25  # how far letters reach from their line, in sizes of the text
_MIDDLE = 0.35  # of letters above their line
_LINE = 1.25  # from one line to the next

Box = tuple[float, float, float, float]  # left, bottom, right, top


@dataclass(frozen=True)
class PlacedName:
    """A name's place, all in pixels.

    Args:
        start: left end of the line that its letters stand on.
        box: what it covers.
        near: middle of the side that looks at what it names.
        is_away: it had to go from beside what it names, so that a line between both is needed.
    """

    start: tuple[float, float]
    box: Box
    near: tuple[float, float]
    is_away: bool


def place_names(points: Array, widths: Sequence[float], size: float, beside: float, dot: float) -> list[PlacedName]:
    """Return a place for each name: beside its point, or near it.

    It is the first free one; earlier names come first.

    Args:
        points: (N, 2) that they name.
        widths: of the names.
        size: of the text.
        beside: from a point to its name.
        dot: radius of the dots at the points, which no name covers.
    """
    taken: list[Box] = [(x - dot, y - dot, x + dot, y + dot) for x, y in points.tolist()]
    placed = []
    for (x, y), width in zip(points.tolist(), widths, strict=True):
        for name in _candidates(x, y, width, size, beside):
            if not any(_overlap(name.box, box) for box in taken):
                break
        taken.append(name.box)
        placed.append(name)
    return placed


def _candidates(x: float, y: float, width: float, size: float, beside: float) -> Iterator[PlacedName]:
    """Yield places right and left of a point, then ever farther above and below it."""
    for lines in count():
        for up in (lines, -lines) if lines else (0,):
            aside = beside * (1 + lines)  # slanting lines to neighbours can be distinguished
            middle = y + up * _LINE * size
            base = middle - _MIDDLE * size
            for left, near in ((x + aside, x + aside), (x - aside - width, x - aside)):
                box = (left, base - _BELOW * size, left + width, base + _ABOVE * size)
                yield PlacedName((left, base), box, (near, middle), lines > 0)


def _overlap(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
