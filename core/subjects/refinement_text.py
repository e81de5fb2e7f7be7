"""Changes of a refined performer in words."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..markers.subject import Subject
from .refine_body import Refinement

_LEAST_SHARE = 0.01  # smaller changes of bones change no pose that one sees
_LEAST_M = 0.003  # nor do those of markers
_MOST_MARKERS = 4  # that are named, to fit a panel
_LEAST_EVIDENCE = 25.0  # right bodies of other takes than the database's reach 10 to 20, some more
_SURE = 2.0  # standard deviations that hold 19 values of 20,
_SURE_IN_SPACE = 2.5  # and of the distance by three axes of one deviation each
_SHIFTED = 1.5  # times as far, a marker alone is off: many are looked at, and the pose explains much of it
_WORDS = {
    "hips": ("hips", "wider", "narrower"),
    "trunk": ("trunk", "longer", "shorter"),
    "thighs": ("thighs", "longer", "shorter"),
    "shanks": ("lower legs", "longer", "shorter"),
    "feet": ("feet", "longer", "shorter"),
    "arms": ("arms", "longer", "shorter"),
}


@dataclass(frozen=True)
class _Change:
    """A change in words.

    Args:
        size: over the least that is worth a line.
        is_sure: whether it is more than the take leaves open.
    """

    text: str
    size: float
    is_sure: bool


def worthwhile(before: Subject, found: Refinement) -> tuple[Subject, list[str]]:
    """Return the refined body and its changes in words; the old one if it fits."""
    changes = describe_changes(before, found)
    return (found.subject, changes) if changes else (before, [])


def describe_changes(before: Subject, found: Refinement) -> list[str]:
    """Return the changes of the whole body, its parts and markers, the largest first.

    The right value lies within the limits after ±, 19 times of 20. [] if no change is sure, or the take is hardly
    likelier with them: the body fits as far as the take shows. A right body that was changed would be worse.
    """
    whole = _bone("whole body", "larger", "smaller", found.whole, found.whole_sigma)
    parts = [_bone(*_WORDS[part], size, found.size_sigmas[part]) for part, size in found.sizes.items()]
    markers = _markers(before, found)
    is_sure = any(change.is_sure for change in (whole, *parts, *markers))
    if not is_sure or found.evidence < _LEAST_EVIDENCE:
        return []
    moved = _worth(markers)
    named, rest = moved[:_MOST_MARKERS], moved[_MOST_MARKERS:]
    shown = [change.text for change in (*_worth([whole]), *_worth(parts), *named)]
    if rest:
        shown.append(f"{len(rest)} more marker{'s' * (len(rest) > 1)} by up to {1e3 * _LEAST_M * rest[0].size:.0f} mm")
    return shown


def _worth(changes: Sequence[_Change]) -> list[_Change]:
    """Return the changes that are worth a line, the largest first."""
    return sorted((change for change in changes if change.size >= 1.0), key=lambda change: -change.size)


def _bone(name: str, more: str, less: str, share: float, sigma: float) -> _Change:
    within = max(_SURE * sigma, _LEAST_SHARE)
    text = f"{name} {100.0 * abs(share):.0f} % {more if share > 0.0 else less} (± {100.0 * within:.0f} %)"
    return _Change(text, abs(share) / _LEAST_SHARE, abs(share) > within)


def _markers(before: Subject, found: Refinement) -> list[_Change]:
    moved_m = np.linalg.norm(found.subject.marker_set.offsets_m - before.marker_set.offsets_m, axis=1)
    changes = []
    for marker, moved in zip(before.marker_set.markers, moved_m.tolist(), strict=True):
        within_m = _SURE_IN_SPACE * found.offset_sigmas_m[marker.name]
        text = f"marker {marker.text or marker.name} {1e3 * moved:.0f} mm (± {1e3 * within_m:.0f} mm)"
        changes.append(_Change(text, moved / _LEAST_M, moved > _SHIFTED * within_m))
    return changes
