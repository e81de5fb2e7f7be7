"""Marker takes and performers from files, as commands and scripts read them."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ..errors import SubjectError
from ..formats.markers.marker_files import is_recorded, read_take
from ..formats.motion.read_motion import read_skeleton
from ..labelling.take_import import import_take
from ..markers import subject as subject_files
from ..markers.label_matching import AUTO, choose_marker_set, load_names, rename_labels
from ..markers.marker_set import MarkerSet, load_marker_set
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from ..markers.take_frames import is_unnamed

Names = Mapping[str, str] | Path | str


def load_take(
    path: Path | str,
    marker_set: MarkerSet | Path | str = AUTO,
    up: str | None = "auto",
    names: Names | None = None,
) -> MarkerTake:
    """Return a marker take in metres, with y up and under the names of a marker set.

    Args:
        path: C3D, TRC, CSV, Qualisys' TSV, `.take.npz`; of a recorded take (`.perftake`) the labelled markers, which
            are returned as they are.
        marker_set: Marker set that was worn: a shipped one by name, a TOML file, or "auto" for the shipped one to which
            most labels belong. Labels match whatever their case, separators and the subject's name before them.
        up: Axis of the file that points up: "y", "z", "auto" for the axis along which the performer stands, "feet" for
            the floor on which the feet stand, which becomes y = 0; None to keep the file's axes.
        names: Marker of each label that matches none, or a TOML file with a table `[names]` of them.

    Raises:
        FormatError: The file is damaged or no marker take.
        TakeError: The labels are not those of the marker set, or the vertical cannot be found.
        MarkerSetError: There is no such marker set, or `up` needs its usual offsets and it has none.
    """
    take = read_labelled(path, names)
    if is_recorded(path) or is_unnamed(take):
        return take
    return fit_take(take, choose_worn(marker_set, take, str(path)), up)


def choose_worn(marker_set: MarkerSet | Path | str, take: MarkerTake, where: str = "") -> MarkerSet:
    """Return the marker set that is worn: given, named, or for "auto" the shipped one to which most labels belong."""
    if isinstance(marker_set, MarkerSet):
        return marker_set
    return choose_marker_set(str(marker_set), take.names, where or take.name)


def read_labelled(path: Path | str, names: Names | None) -> MarkerTake:
    """Return the take of a file with its labels renamed, in the file's axes."""
    take = read_take(path)
    if names is None:
        return take
    return rename_labels(take, names if isinstance(names, Mapping) else load_names(names))


def fit_take(take: MarkerTake, marker_set: MarkerSet, up: str | None) -> MarkerTake:
    """Return a take with y up and under the names of a marker set; None for `up` keeps the axes."""
    return import_take(take, marker_set, up)


def load_subject(path: Path | str, marker_set: MarkerSet | Path | str | None = None) -> Subject:
    """Return a performer: the skeleton, and the places of the markers on it.

    Args:
        path: Calibrated subject (TOML), or a skeleton (`.asf`, `.bvh`) that wears the marker set at its usual places.
        marker_set: Markers that are worn; None for those that the subject was calibrated with.

    Raises:
        SubjectError: The file is damaged, a skeleton has no marker set, or a marker's place is unknown.
    """
    worn = marker_set if marker_set is None or isinstance(marker_set, MarkerSet) else load_marker_set(marker_set)
    if Path(path).suffix.lower() in (".asf", ".bvh"):
        return skeleton_subject(path, worn)
    return wearing(subject_files.load_subject(path), worn, str(path))


def skeleton_subject(path: Path | str, marker_set: MarkerSet | None) -> Subject:
    """Return the subject with a file's skeleton that wears a marker set at its usual places.

    Raises:
        SubjectError: No marker set is named.
    """
    if marker_set is None:
        raise SubjectError("a skeleton carries no markers", where=str(path), advice="name the marker set that was worn")
    return Subject(Path(path).stem, read_skeleton(path), marker_set)


def wearing(subject: Subject, marker_set: MarkerSet | None, where: str) -> Subject:
    """Return the subject with the markers of a set, those without a calibrated place at their usual ones.

    Raises:
        SubjectError: A marker has neither.
    """
    if marker_set is None:
        return subject
    known = {marker.name: marker for marker in subject.marker_set.markers}
    unknown = [each.name for each in marker_set.markers if each.name not in known and each.offset_m is None]
    if unknown:
        advice = "calibrate the subject with this marker set"
        raise SubjectError(f"no offset is known for {', '.join(unknown)}", where=where, advice=advice)
    worn = tuple(known.get(marker.name, marker) for marker in marker_set.markers)
    return replace(subject, marker_set=replace(marker_set, markers=worn))
