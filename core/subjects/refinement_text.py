"""Description in words of the changes that a refinement made to a performer."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import counted
from ..markers.subject import Subject
from .refine_body import Refinement


@dataclass(frozen=True)
class TextSettings:
    """Thresholds for the changes that are described."""

    least_share: float = 0.01  # relative change of a bone's length from which poses change visibly
    least_m: float = 0.003  # shift of a marker from which poses change visibly
    most_markers: int = 4  # largest number of markers that are named, so that the text fits a panel
    least_evidence: float = 25.0  # nats; with motion unlike the database's, correct bodies reach 10 to 20, some more
    sigmas: float = 2.0  # number of standard deviations that contain 95 % of the values
    sigmas_in_space: float = 2.5  # the same for the length of a vector
    shifted: float = 1.5  # factor by which a marker's shift must exceed its limit: many markers are tested


SETTINGS = TextSettings()
PART_WORDS = {
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
        size: Size of the change relative to the smallest one worth a line.
        is_sure: Whether the change exceeds its uncertainty.
    """

    text: str
    size: float
    is_sure: bool


def worthwhile(before: Subject, found: Refinement) -> tuple[Subject, list[str]]:
    """Return the refined body and its changes in words, or the old body without any if that fits the take."""
    changes = describe_changes(before, found)
    return (found.subject, changes) if changes else (before, [])


def describe_changes(before: Subject, found: Refinement) -> list[str]:
    """Return the changes of the whole body, of its parts and of its markers in words, the largest of each first.

    The true value lies within the limits after ± in 95 % of cases. The list is empty if no change is significant, or if
    the evidence is small: then the body fits, and changing a correct body would make it worse.
    """
    whole = _bone("whole body", "larger", "smaller", found.whole, found.whole_sigma)
    parts = [_bone(*PART_WORDS[part], size, found.size_sigmas[part]) for part, size in found.sizes.items()]
    markers = _markers(before, found)
    is_sure = any(change.is_sure for change in (whole, *parts, *markers))
    if not is_sure or found.evidence < SETTINGS.least_evidence:
        return []
    moved = _worth(markers)
    named, rest = moved[: SETTINGS.most_markers], moved[SETTINGS.most_markers :]
    shown = [change.text for change in (*_worth([whole]), *_worth(parts), *named)]
    if rest:
        most_mm = 1e3 * SETTINGS.least_m * rest[0].size
        shown.append(f"{counted(len(rest), 'more marker')} by up to {most_mm:.0f} mm")
    return shown


def _worth(changes: Sequence[_Change]) -> list[_Change]:
    """Return the changes that are worth a line, largest first."""
    return sorted((change for change in changes if change.size >= 1.0), key=lambda change: -change.size)


def _bone(name: str, more: str, less: str, share: float, sigma: float) -> _Change:
    within = max(SETTINGS.sigmas * sigma, SETTINGS.least_share)
    text = f"{name} {100.0 * abs(share):.0f} % {more if share > 0.0 else less} (± {100.0 * within:.0f} %)"
    return _Change(text, abs(share) / SETTINGS.least_share, abs(share) > within)


def _markers(before: Subject, found: Refinement) -> list[_Change]:
    moved_m = np.linalg.norm(found.subject.marker_set.offsets_m - before.marker_set.offsets_m, axis=1)
    changes = []
    for marker, moved in zip(before.marker_set.markers, moved_m.tolist(), strict=True):
        within_m = SETTINGS.sigmas_in_space * found.offset_sigmas_m[marker.name]
        text = f"marker {marker.text or marker.name} {1e3 * moved:.0f} mm (± {1e3 * within_m:.0f} mm)"
        changes.append(_Change(text, moved / SETTINGS.least_m, moved > SETTINGS.shifted * within_m))
    return changes
