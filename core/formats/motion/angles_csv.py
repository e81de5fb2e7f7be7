"""Joint angles as a table (CSV) for spreadsheets and statistics.

Comment lines with "#" state the convention, followed by a header and one row per frame: number from 0, time in seconds,
position of the root in metres, and three angles in degrees for each joint, the root first.

Angles describe the rotation relative to the parent joint (the root's relative to the world) about the joint's own axes,
which in the rest pose are the world's (x to the performer's left, y up, z forward). They are intrinsic in the order Z,
X, Y, so R = Rz Rx Ry, as in the BVH files, and continuous from frame to frame, beyond 180 degrees if need be.
"""

from pathlib import Path

import numpy as np

from ...body.motion import Motion
from ...geometry import rotations as rot
from ...system.files import atomic_path

_ORDER = "ZXY"
_CONVENTION = (
    "joint angles of perfanim, fps={fps!r}",
    "angles: degrees about the joint's own axes relative to its parent, intrinsic order z x y (R = Rz Rx Ry)",
    "axes in the rest pose: x to the performer's left, y up, z forward; the root is relative to the world",
)


def write_angles_csv(motion: Motion, path: Path | str) -> None:
    """Write a motion's joint angles; the convention is described in the module."""
    names = motion.skeleton.names
    header = ["frame", "time_s", *(f"{names[0]}_{axis}_m" for axis in "xyz")]
    header += [f"{name}_{axis}_deg" for name in names for axis in _ORDER.lower()]
    euler = rot.to_euler(motion.rotations, _ORDER)
    angles = np.concatenate([rot.unwrap_euler(euler[:, joint]) for joint in range(len(names))], axis=1)
    rows = np.round(np.concatenate((motion.root_positions_m, np.degrees(angles)), axis=1), 6) + 0.0  # avoids -0.0
    pattern = ",".join(["%.6f"] * rows.shape[1])
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(f"# {line}\n" for line in "\n".join(_CONVENTION).format(fps=motion.fps).split("\n"))
        file.write(",".join(header) + "\n")
        file.writelines(f"{n},{n / motion.fps:.6f},{pattern % tuple(row)}\n" for n, row in enumerate(rows.tolist()))
