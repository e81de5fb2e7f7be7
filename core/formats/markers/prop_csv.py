"""Motion of a prop as a table for other programs, one row per frame at a steady rate."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...body.clock import Clock, clock_of
from ...body.scene_pose import ScenePose
from ...system.files import atomic_path

HEADER = ("frame", "time_s", "x", "y", "z", "qw", "qx", "qy", "qz", "rms_mm", "markers")


def write_prop_csv(poses: Sequence[ScenePose], index: int, name: str, path: Path | str) -> Clock:
    """Write a prop's position and rotation at a steady rate, blank while it was not found; return the clock used.

    Raises:
        FormatError: `path` cannot be written.
        TakeError: There are no two poses with different times.
    """
    clock = clock_of(np.array([pose.time_s for pose in poses]))
    props = [pose.props[index] for pose in poses]
    found = np.array([prop.found for prop in props])
    positions = clock.seen(np.array([prop.position_m for prop in props]), found)
    rotations = clock.seen(np.array([prop.rotation for prop in props]), found, is_rotation=True)
    nearest = clock.nearest
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.write(f"# prop of perfanim: {name}, metres, y up, fps={clock.fps!r}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEADER)
        for row, (time_s, frame) in enumerate(zip(clock.steady_s, nearest, strict=True)):
            fields = [str(poses[0].number + row), f"{time_s:.6f}"]
            if np.isfinite(positions[row, 0]):
                values = (*positions[row], *rotations[row])
                fields += [*(f"{value:.6f}" for value in values)]
                fields += [f"{1e3 * props[frame].rms_m:.3f}", str(props[frame].seen)]
            writer.writerow([*fields, *[""] * (len(HEADER) - len(fields))])
    return clock
