"""A marker take as a source of marker frames whose labels are known."""

from collections.abc import Iterator

import numpy as np

from ..errors import TakeError
from ..marker_frame import MarkerFrame
from ..marker_set import MarkerSet
from ..marker_take import MarkerTake

_SIGMA_M = 0.001  # uncertainty given to positions that come without one


def take_frames(take: MarkerTake, marker_set: MarkerSet) -> Iterator[MarkerFrame]:
    """Yield the frames of a take, labelled by marker name; markers that the set lacks are left out.

    Raises:
        TakeError: the take has fewer than three of the set's torso markers.
    """
    columns = {name: i for i, name in enumerate(take.names)}
    torso = [marker.name for marker in marker_set.markers if marker.torso]
    if sum(name in columns for name in torso) < 3:
        raise TakeError(
            "has fewer than three of the torso markers " + ", ".join(torso),
            where=take.name,
            advice="its markers are " + ", ".join(take.names) + "; choose the marker set that was worn",
        )
    kept = np.array([i for i, name in enumerate(marker_set.names) if name in columns])
    positions = take.positions_m[:, [columns[marker_set.names[i]] for i in kept]]
    for number, time_s, row in zip(take.frame_numbers, take.times_s, positions, strict=True):
        seen = np.all(np.isfinite(row), axis=-1)
        covariances = np.broadcast_to(_SIGMA_M**2 * np.eye(3), (int(seen.sum()), 3, 3))
        yield MarkerFrame(int(number), float(time_s), row[seen], covariances, kept[seen])
