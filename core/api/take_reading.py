"""Reading marker takes and performers, for commands and scripts."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ..database.store import Database
from ..errors import SubjectError, TakeError
from ..formats.markers.marker_files import is_recorded, read_take
from ..formats.motion.read_motion import read_skeleton
from ..labelling.take_import import import_take
from ..markers import subject as subject_files
from ..markers.label_matching import AUTO, choose_marker_set, load_names, rename_labels
from ..markers.marker_set import MarkerSet, load_marker_set
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from ..markers.take_frames import is_unnamed
from ..subjects.label_distances import contradiction
from ..subjects.suit_recognition import recognise_suit
from ..system.progress import Progress, no_progress

Names = Mapping[str, str] | Path | str


def load_take(
    path: Path | str,
    marker_set: MarkerSet | Path | str = AUTO,
    up: str | None = "auto",
    names: Names | None = None,
) -> MarkerTake:
    """Return a marker take in metres, with y up and with the marker names of a marker set.

    Args:
        path: C3D, TRC, CSV, Qualisys TSV or `.take.npz`; from a recorded take (`.perftake`) the labelled markers are
            returned unchanged.
        marker_set: Marker set that was worn: name of a shipped set, a TOML file, or "auto" for the shipped set that
            matches most labels. Case, separators and a subject's name in front of a label are ignored.
        up: Axis of the file that points up: "y", "z", "auto" for the axis along which the performer stands, "feet" to
            fit the floor to the feet and make it y = 0; None to keep the file's axes.
        names: Marker for each label that matches none, or a TOML file with a table `[names]` of them.

    Raises:
        FormatError: The file is damaged or is not a marker take.
        TakeError: The labels are not those of the marker set, or the vertical cannot be found.
        MarkerSetError: The marker set does not exist, or `up` needs usual offsets that the set lacks.
    """
    take = read_labelled(path, names)
    if is_recorded(path) or is_unnamed(take):
        return take
    return fit_take(take, choose_worn(marker_set, take, str(path)), up)


def choose_worn(marker_set: MarkerSet | Path | str, take: MarkerTake, where: str = "") -> MarkerSet:
    """Return the marker set: the given or named one, or for "auto" the shipped set that matches most labels."""
    if isinstance(marker_set, MarkerSet):
        return marker_set
    return choose_marker_set(str(marker_set), take.names, where or take.name)


def labelled_by(
    marker_set: MarkerSet | Path | str,
    take: MarkerTake,
    database: Database | None,
    where: str = "",
    progress: Progress = no_progress,
) -> tuple[MarkerTake, MarkerSet]:
    """Return a take and the marker set that is worn; for "auto", unusable labels are recognised from the motion.

    Labels are unusable if no set knows them, or if the distances between these markers fit no body.

    Args:
        marker_set: As for `load_take`.
        take: Take under the names of its file.
        database: Motion database from which markers are recognised; None to refuse unknown labels.

    Raises:
        TakeError: The labels are unusable, and the markers cannot be recognised from the motion.
    """
    if marker_set != AUTO or database is None or take.single is not None or is_unnamed(take):
        return take, choose_worn(marker_set, take, where)
    try:
        worn = choose_worn(marker_set, take, where)
        if contradiction(take, worn, database) < 1.0:
            return take, worn
        why = f"its labels are wrong: the distances between the markers of {worn.name} fit no body"
    except TakeError as error:
        why = error.what
    suit = recognise_suit(replace(take, name=where or take.name), database, why, progress)
    shown = int(take.visible.any(axis=0).sum())
    found = f"{len(suit.names)} of {shown} markers were recognised from their motion: {suit.marker_set.name}"
    named = rename_labels(take, suit.names)
    return replace(named, notes=(*take.notes, f"{why}; {found}"), is_guessed=not suit.is_clear), suit.marker_set


def read_labelled(path: Path | str, names: Names | None) -> MarkerTake:
    """Return a file's take with its labels renamed, in the file's axes."""
    take = read_take(path)
    if names is None:
        return take
    return rename_labels(take, names if isinstance(names, Mapping) else load_names(names))


def fit_take(take: MarkerTake, marker_set: MarkerSet, up: str | None) -> MarkerTake:
    """Return a take with y up and the names of a marker set; if `up` is None, the axes are kept."""
    return import_take(take, marker_set, up)


def load_subject(path: Path | str, marker_set: MarkerSet | Path | str | None = None) -> Subject:
    """Return a performer: the skeleton and the marker positions on it.

    Args:
        path: Calibrated subject (TOML), or a skeleton (`.asf`, `.bvh`) with the marker set at its usual positions.
        marker_set: Markers that are worn; None for those that the subject was calibrated with.

    Raises:
        SubjectError: The file is damaged, a skeleton has no marker set, or a marker's position is unknown.
    """
    worn = marker_set if marker_set is None or isinstance(marker_set, MarkerSet) else load_marker_set(marker_set)
    if Path(path).suffix.lower() in (".asf", ".bvh"):
        return skeleton_subject(path, worn)
    return wearing(subject_files.load_subject(path), worn, str(path))


def skeleton_subject(path: Path | str, marker_set: MarkerSet | None) -> Subject:
    """Return a subject that has a file's skeleton and a marker set at its usual positions.

    Raises:
        SubjectError: No marker set is named.
    """
    if marker_set is None:
        raise SubjectError("a skeleton carries no markers", where=str(path), advice="name the marker set that was worn")
    return Subject(Path(path).stem, read_skeleton(path), marker_set)


def wearing(subject: Subject, marker_set: MarkerSet | None, where: str) -> Subject:
    """Return the subject with the markers of a set; markers without a calibrated position get the usual one.

    Raises:
        SubjectError: A marker has neither a calibrated nor a usual position.
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
