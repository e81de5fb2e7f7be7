"""Matching a take's labels to a set's markers, tolerant of spelling."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from ..errors import MarkerSetError, TakeError
from ..system.files import read_toml
from ..system.schema import About, Schema
from .marker_set import FEWEST_TORSO, MarkerSet, load_marker_set, marker_set_names
from .marker_take import MarkerTake

AUTO = "auto"

_MOST_NAMES = 12  # most names listed in a message


@dataclass(frozen=True)
class _Names:
    """Contents of a file with names for a take's markers."""

    names: Annotated[Mapping[str, str], About("marker of each label", least=1)]


NAMES = Schema(
    _Names,
    "Names of a take's markers",
    "For `perfanim solve`, and `names` of a plan.",
    MarkerSetError,
    'write [names] and lines such as "Knee 1" = "LKNE"',
)


@dataclass(frozen=True)
class LabelMatch:
    """Result of matching a marker set to the labels of a take."""

    marker_set: MarkerSet
    label_of: Mapping[str, str]  # marker's name -> label in the take

    @property
    def has_torso(self) -> bool:
        """Whether enough torso markers were matched to find the root."""
        torso = [marker.name for marker in self.marker_set.markers if marker.torso]
        return sum(name in self.label_of for name in torso) >= FEWEST_TORSO

    def rename(self, take: MarkerTake) -> MarkerTake:
        """Return the take with matched labels replaced by the markers' names; other labels are unchanged."""
        marker_of = {label: marker for marker, label in self.label_of.items()}
        return replace(take, names=tuple(marker_of.get(name, name) for name in take.names))


def match_labels(labels: Sequence[str], marker_set: MarkerSet) -> LabelMatch:
    """Match labels to the markers of a set.

    A label matches a marker's name or one of its other names. Case, punctuation and a subject's name in front of it are
    ignored: "Anna:R.ASIS", "anna_rasis".
    """
    known: dict[str, str] = {}
    for marker in marker_set.markers:
        for spelling in (marker.name, *marker.also):
            known.setdefault(normalise_label(spelling), marker.name)
    found = {name: name for name in marker_set.names if name in labels}
    # a word that precedes an underscore in three or more labels is a subject's name
    words = Counter(label.rpartition(":")[2].partition("_")[0] for label in labels if "_" in label)
    for label in labels:
        own = label.rpartition(":")[2]
        word, _, rest = own.partition("_")
        for name in (own, rest if words[word] >= 3 else ""):
            if label not in found and normalise_label(name) in known:
                found.setdefault(known[normalise_label(name)], label)
                break
    return LabelMatch(marker_set, found)


def normalise_label(name: str) -> str:
    """Return the letters and digits of a name in lower case."""
    return "".join(c for c in name.casefold() if c.isalnum())


def match_best_set(labels: Sequence[str], where: str) -> LabelMatch:
    """Return the shipped marker set that matches most of the labels.

    Raises:
        TakeError: For no set are there enough torso markers among the labels.
    """
    matches = [match_labels(labels, load_marker_set(name)) for name in marker_set_names()]
    matches = [match for match in matches if match.has_torso]
    if not matches:
        raise TakeError(
            f"its markers ({join_names(labels)}) do not match any shipped marker set",
            where=where,
            advice="choose the marker set that was worn, or give a file with the marker's name for each label",
        )
    return max(matches, key=lambda match: (len(match.label_of), -len(match.marker_set)))


def choose_marker_set(name_or_path: str, labels: Sequence[str], where: str) -> MarkerSet:
    """Return the named marker set; for AUTO, the one that matches the labels best."""
    return match_best_set(labels, where).marker_set if name_or_path == AUTO else load_marker_set(name_or_path)


def join_names(names: Sequence[str]) -> str:
    """Return names joined for a message; long lists are shortened."""
    left = len(names) - _MOST_NAMES
    return ", ".join(names[:_MOST_NAMES]) + (f" and {left} more" if left > 0 else "")


def load_names(path: Path | str) -> dict[str, str]:
    """Return the marker's name for each label, from the table `[names]` of a TOML file.

    Raises:
        MarkerSetError: The table is missing, or it contains values that are not strings.
    """
    return dict(NAMES.read(read_toml(path), str(path)).names)


def rename_labels(take: MarkerTake, names: Mapping[str, str]) -> MarkerTake:
    """Rename labels; if the new name is already another label, that label gets the prefix "other".

    Raises:
        TakeError: None of the labels is in the take, or two of them are mapped to the same marker.
    """
    given = {label: marker for label, marker in names.items() if label in take.names}
    if not given:
        raise TakeError(
            f"has none of the labels {join_names(list(names))}, only {join_names(take.names)}",
            where=take.name,
            advice="check the file of names",
        )
    double = [marker for marker, count in Counter(given.values()).items() if count > 1]
    if double:
        raise TakeError(
            f"several labels are mapped to {join_names(double)}", where=take.name, advice="check the file of names"
        )
    taken = set(given.values())
    renamed = [given.get(name, f"other {name}" if name in taken else name) for name in take.names]
    return replace(take, names=tuple(renamed))
