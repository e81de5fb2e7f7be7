"""A recorded take as trajectories of labelled markers."""

from pathlib import Path

import numpy as np

from ...errors import TakeError
from ...markers.frame_rate import frame_rate
from ...markers.marker_take import MarkerTake
from ..take_file.reading import TakeFile, read_take_file


def read_recorded_take(path: Path | str) -> MarkerTake:
    """Return the markers of a recorded take as they were labelled live.

    Raises:
        TakeError: no take, nothing of it is left, or no pose was solved.
    """
    return marker_take(read_take_file(path))


def marker_take(take: TakeFile) -> MarkerTake:
    """Return a recorded take's labelled markers in its world.

    What single cameras showed is left out: a recorded take keeps it by blob, not by marker.
    """
    poses = take.recorded_poses_of()
    if len(poses) < 2:
        raise TakeError(
            f"has {len(poses)} solved frames", where=str(take.path), advice="markers are labelled with the poses"
        )
    times_s, numbers = np.array([p.time_s for p in poses]), np.array([p.number for p in poses])
    return MarkerTake(
        take.notes.name,
        frame_rate(times_s, numbers),
        take.setup.subjects()[0].marker_set.names,
        np.array([p.observed_m for p in poses]),
        numbers,
        times_s - times_s[0],
    )
