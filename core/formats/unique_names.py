"""Unique names for joints and markers in files that repeat names."""

from collections.abc import Sequence


def unique_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names made unique by a number: "a", "a_2"."""
    taken: dict[str, None] = {}
    counts: dict[str, int] = {}
    for name in names:
        unique = name
        while unique in taken:
            counts[name] = counts.get(name, 1) + 1
            unique = f"{name}_{counts[name]}"
        taken[unique] = None
        counts.setdefault(unique, 1)
    return tuple(taken)
