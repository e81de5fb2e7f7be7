"""Keypoint files of markerless tools: finding the names, unit and rate that they do not state.

FreeMoCap writes arrays (.npy) and tables of points in millimetres, without stating rate or unit. They can include
points on hands and face and centres of mass, which say nothing about the body's joints.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...body.body_size import HUMAN
from ...body.clock import seconds_of
from ...errors import FormatError, TakeError
from ...geometry.arrays import Array
from ...geometry.npz import read_array
from ...markers.label_matching import match_best_set
from ...markers.marker_set import PointKind, load_marker_set
from ...markers.marker_take import MarkerTake
from .reader_parts import make_take

BODY = "body_"  # FreeMoCap's prefix for the names of body points

_ORDERS = {17: "coco-17", 25: "body-25", 26: "halpe-26", 33: "blazepose-33"}  # marker set by number of points
_HOLISTIC = (543, 553)  # number of points in MediaPipe's holistic model: the body's come first, then hands and face
_UNITS_M = (1.0, 0.01, 0.001)  # likely units, metres


@dataclass(frozen=True)
class KeypointFileSettings:
    """Assumptions about files that state neither rate nor unit."""

    usual_fps: float = 30.0  # frame rate of webcams and phones, Hz
    body_share: float = 0.5  # smallest share of points that a frame must show for its extent to count


_S = KeypointFileSettings()


def are_keypoints(names: Sequence[str]) -> bool:
    """Return whether the names are those of a shipped keypoint set."""
    try:
        return match_best_set(names, "").marker_set.points is PointKind.KEYPOINTS
    except TakeError:
        return False


def read_npy(path: Path | str) -> MarkerTake:
    """Return the take from an array (F, J, 3) of keypoints, named by their index.

    Raises:
        FormatError: The file is damaged, or the array has another shape.
    """
    where, points = str(path), read_array(path)
    count = points.shape[1] if points.ndim == 3 else 0
    known = _ORDERS.get(33 if count in _HOLISTIC else count)
    if known is None or points.shape[2] != 3 or points.dtype.kind not in "iuf":
        sizes = ", ".join(f"{size} ({name})" for size, name in _ORDERS.items())
        raise FormatError(
            f"holds an array of shape {points.shape}, which cannot be keypoints", where=where,
            advice=f"write it with shape (frames, points, 3), where the number of points is one of {sizes}",
        )  # fmt: skip
    names = load_marker_set(known).names
    take = keypoint_take(where, names, points[:, : len(names)].astype(np.float64), float("nan"))
    return replace(take, notes=(*take.notes, f"the points are named as in {known}, judging by their number"))


def keypoint_take(
    where: str, names: Sequence[str], points: Array, fps: float,
    frame_numbers: Array | None = None, times_s: Array | None = None,
) -> MarkerTake:  # fmt: skip
    """Return a take with the body's keypoints in metres.

    The unit is the one that gives the body a human size. A rate that is not stated is found from the time stamps in the
    recording's folder; without these, a typical rate is assumed.

    Args:
        points: Keypoints (F, J, 3) in an unknown unit.
        fps: Frame rate; zero or negative if it is not stated.
        times_s: Times (F,) of the frames, NaN where they are not known.
    """
    if any(name.startswith(BODY) for name in names):
        kept = [place for place, name in enumerate(names) if name.startswith(BODY)]
        names, points = [names[place].removeprefix(BODY) for place in kept], points[:, kept]
    notes: tuple[str, ...] = ()
    if times_s is None or not np.all(np.isfinite(times_s)):
        times_s, notes = _recorded_times(Path(where), len(points))
    if times_s is None and not fps > 0.0:
        fps = _S.usual_fps
        notes = (*notes, f"neither a rate nor times are stated: {fps:g} frames per second are assumed")
    take = make_take(where, fps, names, points * _metres_per_unit(points, where), frame_numbers, times_s)
    return replace(take, notes=(*take.notes, *notes))


def _metres_per_unit(points: Array, where: str) -> float:
    """Return the metres per unit of points (F, J, 3), from the median extent of the body."""
    seen = np.all(np.isfinite(points), axis=-1) & np.any(points != 0.0, axis=-1)
    whole = points[np.sum(seen, axis=1) > _S.body_share * points.shape[1]]
    if len(whole) == 0:
        raise FormatError("never shows most of the body in one frame", where=where, advice="record the whole body")
    whole = np.where(
        np.all(np.isfinite(whole), axis=-1, keepdims=True) & np.any(whole != 0.0, -1, keepdims=True), whole, np.nan
    )
    extent = float(np.median(np.max(np.nanmax(whole, axis=1) - np.nanmin(whole, axis=1), axis=-1)))
    return next((metres for metres in _UNITS_M if extent * metres <= HUMAN.largest_m), _UNITS_M[-1])


def _recorded_times(path: Path, frames: int) -> tuple[Array | None, tuple[str, ...]]:
    """Return the times (F,) that FreeMoCap's cameras wrote beside a file, or None; and notes about unreadable files."""
    notes: list[str] = []
    for folder in path.absolute().parents[:2]:
        stamps = []
        for file in sorted((folder / "synchronized_videos" / "timestamps").glob("*.npy")):
            try:
                stamps.append(read_array(file))
            except FormatError as error:
                notes.append(f"a camera's times are not used: {file.name} {error.what}")
        known = [each.astype(np.float64) for each in stamps if each.shape == (frames,) and each.dtype.kind in "iuf"]
        if known:
            return seconds_of(np.mean(known, axis=0)), tuple(notes)
    return None, tuple(notes)
