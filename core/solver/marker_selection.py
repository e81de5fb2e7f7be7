"""Selection of a few markers that best determine the body.

The database's poses give a Gaussian of joints and markers in the root's frame, which itself moves freely. Markers are
chosen greedily: each minimises the remaining variance of the joints' world positions (Krause, Singh and Guestrin 2008).
"""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..body.skeleton import forward_kinematics
from ..database.store import Database
from ..errors import MarkerSetError, counted
from ..geometry.arrays import Array
from ..markers.marker_set import FEWEST_TORSO
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject
from ..markers.take_frames import is_unnamed
from .subject_model import ROOT_AT_REST, SubjectModel

_SAMPLES = 4096  # number of database poses used for the covariance
_MARKER_SIGMA_M = 0.005  # standard deviation of a marker due to skin motion and calibration
_ROOT_SIGMA_M, _ROOT_SIGMA_RAD = 10.0, 3.0  # standard deviations of a root that is unknown
_TORSO = 4  # number of torso markers that determine the root reliably: two pairs, as in the paper's sets
_PELVIS = 2  # number of these on the pelvis; with only one there, a bent back looks like a turned root


@dataclass(frozen=True)
class MarkerChoice:
    """Markers in the order in which they were chosen."""

    names: tuple[str, ...]
    expected_m: Array  # (N,) expected RMS error of the joints with the first 1, 2, ..., N markers


def choose_markers(
    subject: Subject, database: Database, count: int, among: Sequence[str] | None = None
) -> MarkerChoice:
    """Return the markers of a subject that together best determine the body.

    The first four are on the torso, and two of these on the pelvis, if there are that many.

    Args:
        subject: Subject for whom all markers are calibrated.
        database: Database with motion of the kind to be solved.
        count: Number of markers.
        among: Names to choose from; by default all.

    Raises:
        MarkerSetError: `count` is below three or above the number of markers, or fewer than three of these are on the
            torso.
    """
    markers = subject.marker_set.markers
    free = [i for i, marker in enumerate(markers) if among is None or marker.name in among]
    torso = [i for i in free if markers[i].torso]
    pelvis = [i for i in torso if markers[i].joint == subject.skeleton.names[0]]
    if not FEWEST_TORSO <= count <= len(free) or len(torso) < FEWEST_TORSO:
        raise MarkerSetError(
            f"cannot choose {count} of {counted(len(free), 'marker')}, {len(torso)} of them on the torso",
            where=f"marker set {subject.marker_set.name}",
            advice=f"choose at least {FEWEST_TORSO} that the take has, which needs {FEWEST_TORSO} on the torso",
        )
    covariance = _covariance(subject, database)
    size = 3 * len(subject.skeleton)
    chosen: list[int] = []
    expected = []
    for number in range(count):
        from_pelvis = len(pelvis) >= _PELVIS > number
        worth = pelvis if from_pelvis else torso if number < min(_TORSO, len(torso)) else free
        left = [i for i in worth if i not in chosen]
        gains = [_gain(covariance, size, i) for i in left]
        chosen.append(left[int(np.argmax(gains))])
        covariance = _given(covariance, size, chosen[-1])
        expected.append(np.sqrt(np.trace(covariance[:size, :size]) / len(subject.skeleton)))
    return MarkerChoice(tuple(markers[i].name for i in chosen), np.array(expected))


def with_markers(subject: Subject, names: Sequence[str]) -> Subject:
    """Return the subject with only these markers; MarkerSetError if one is unknown or there are too few."""
    unknown = [name for name in names if name not in subject.marker_set.names]
    if unknown:
        raise MarkerSetError(
            f"has no marker {', '.join(unknown)}",
            where=f"marker set {subject.marker_set.name}",
            advice="choose from " + ", ".join(subject.marker_set.names),
        )
    return replace(subject, marker_set=subject.marker_set.subset(names))


def worn_in(take: MarkerTake, subject: Subject) -> Subject:
    """Return the subject with only the markers that a take shows, however few of these are on the torso.

    It is returned unchanged if the take's markers are not labelled, or if fewer than three are on or next to the torso.
    """
    if is_unnamed(take):
        return subject
    seen = take.visible if take.single is None else take.visible | (take.single.cameras >= 0)
    shown = [name for name, own in zip(take.names, seen.T, strict=True) if own.any()]
    with contextlib.suppress(MarkerSetError):
        return replace(subject, marker_set=subject.marker_set.worn(shown))
    return subject


def _covariance(subject: Subject, database: Database) -> Array:
    """Return the covariance (3 J + 3 M, 3 J + 3 M) of the positions of joints and markers if the root is unknown."""
    frames = np.unique(np.linspace(0, database.frames - 1, _SAMPLES).astype(np.int64))
    model = SubjectModel(subject, database.reference_pose_of(subject.skeleton, subject.name))
    poses = np.asarray(database.poses[frames], dtype=np.float64)
    joints = forward_kinematics(subject.skeleton, model.rotations(poses, ROOT_AT_REST), np.zeros(3))[0]
    places = np.concatenate((joints, model.markers(poses)), axis=1)
    mean = places.mean(axis=0)
    deviations = (places - mean).reshape(len(frames), -1)
    rigid = np.zeros((places.shape[1], 3, 6))
    rigid[:, :, :3] = _ROOT_SIGMA_M * np.eye(3)
    rigid[:, :, 3:] = _ROOT_SIGMA_RAD * np.cross(np.eye(3), mean[:, None]).transpose(0, 2, 1)
    moved = rigid.reshape(-1, 6)
    return np.asarray(deviations.T @ deviations / len(frames) + moved @ moved.T)


def _seen(covariance: Array, size: int, marker: int) -> tuple[Array, Array]:
    """Return the covariances (N, 3) of all entries with a marker, and the covariance (3, 3) of its measurement."""
    columns = slice(size + 3 * marker, size + 3 * marker + 3)
    return covariance[:, columns], covariance[columns, columns] + _MARKER_SIGMA_M**2 * np.eye(3)


def _gain(covariance: Array, size: int, marker: int) -> float:
    """Return by how much a marker reduces the variance of the joints, m^2."""
    across, own = _seen(covariance, size, marker)
    return float(np.einsum("ij,ij->", np.linalg.solve(own, across[:size].T).T, across[:size]))


def _given(covariance: Array, size: int, marker: int) -> Array:
    """Return the covariance after a marker has been measured."""
    across, own = _seen(covariance, size, marker)
    return np.asarray(covariance - across @ np.linalg.solve(own, across.T))
