"""Motion of a prop as a table for other programs, one row per frame."""

import csv
from collections.abc import Sequence
from pathlib import Path

from ...body.scene_pose import ScenePose
from ...system.files import atomic_path

HEADER = ("frame", "time_s", "x", "y", "z", "qw", "qx", "qy", "qz", "rms_mm", "markers")


def write_prop_csv(poses: Sequence[ScenePose], index: int, name: str, fps: float, path: Path | str) -> None:
    """Write a prop's position and rotation, blank while it was not found; FormatError if `path` cannot be written."""
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.write(f"# prop of perfanim: {name}, metres, y up, fps={fps!r}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEADER)
        for pose in poses:
            prop = pose.props[index]
            fields = [str(pose.number), f"{pose.time_s:.6f}"]
            if prop.found:
                values = (*prop.position_m, *prop.rotation)
                fields += [*(f"{value:.6f}" for value in values), f"{1e3 * prop.rms_m:.3f}", str(prop.seen)]
            writer.writerow([*fields, *[""] * (len(HEADER) - len(fields))])
