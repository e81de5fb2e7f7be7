"""Conversion of a marker take to labelled marker frames."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..errors import TakeError
from ..geometry.arrays import Array, IntArray
from .marker_frame import MarkerFrame
from .marker_set import FEWEST_TORSO, MarkerSet
from .marker_take import MarkerTake

SIGMA_M = 0.001  # standard deviation of positions for which none is stated


def take_frames(take: MarkerTake, marker_set: MarkerSet) -> Iterator[MarkerFrame]:
    """Yield the frames of a take, labelled by marker name; other markers are left out.

    Markers that only one camera showed are rays. Those of a take of one camera are unlabelled, or have guessed depths.

    Raises:
        TakeError: The take has fewer than three of the set's torso markers.
    """
    if is_unnamed(take):
        yield from _unnamed_frames(take)
        return
    check_torso(take, marker_set)
    columns = {name: i for i, name in enumerate(take.names)}
    kept = np.array([i for i, name in enumerate(marker_set.names) if name in columns])
    order = [columns[marker_set.names[i]] for i in kept]
    positions = take.positions_m[:, order]
    single = take.single.select(markers=order) if take.single is not None else None
    for f, (number, time_s, row) in enumerate(zip(take.frame_numbers, take.times_s, positions, strict=True)):
        seen = np.all(np.isfinite(row), axis=-1)
        covariances = np.broadcast_to(SIGMA_M**2 * np.eye(3), (int(seen.sum()), 3, 3))
        frame = MarkerFrame(int(number), float(time_s), row[seen], covariances, kept[seen])
        yield frame if single is None else _with_rays(frame, single.cameras[f], single.points[f], kept)


def check_torso(take: MarkerTake, marker_set: MarkerSet) -> None:
    """Raise TakeError for a take with fewer than three of the set's torso markers."""
    torso = [marker.name for marker in marker_set.markers if marker.torso]
    if sum(name in take.names for name in torso) < FEWEST_TORSO:
        raise TakeError(
            "has fewer than three of the torso markers " + ", ".join(torso),
            where=take.name,
            advice="its markers are " + ", ".join(take.names) + "; choose the marker set that was worn",
        )


def is_unnamed(take: MarkerTake) -> bool:
    """Return whether a take has only rays of a single camera, so that its trajectories are not labelled yet."""
    return is_of_one_camera(take) and not take.visible.any()


def is_of_one_camera(take: MarkerTake) -> bool:
    """Return whether a single camera saw a take, so that depths are unknown or guessed."""
    return take.single is not None and len(take.single.rig) == 1


def _unnamed_frames(take: MarkerTake) -> Iterator[MarkerFrame]:
    if take.single is None:
        return
    rows = zip(take.frame_numbers, take.times_s, take.single.points, strict=True)
    for number, time_s, row in rows:
        points = row[np.isfinite(row[:, 0])]
        camera, unknown = np.zeros(len(points), dtype=np.int64), np.full(len(points), -1, dtype=np.int64)
        yield MarkerFrame(int(number), float(time_s), single_cameras=camera, single_blobs=unknown, single_points=points)


def _with_rays(frame: MarkerFrame, cameras: IntArray, points: Array, labels: IntArray) -> MarkerFrame:
    alone = cameras >= 0
    return replace(
        frame,
        single_cameras=cameras[alone],
        single_blobs=np.full(int(alone.sum()), -1, dtype=np.int64),
        single_points=points[alone],
        single_labels=labels[alone],
    )
