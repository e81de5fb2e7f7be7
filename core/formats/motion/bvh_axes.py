"""Change of space of BVH files, as Blender's exporter writes them."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ...geometry import rotations as rot
from ...geometry.arrays import Array

_DECIMALS = 6


@dataclass
class _Joint:
    """Where a joint's channels are in a row of the motion."""

    is_top: bool  # nothing above it moves
    place: list[int] = field(default_factory=list)
    angles: list[int] = field(default_factory=list)
    order: str = ""


def transform_bvh(text: str, matrices: ArrayLike) -> str:
    """Return a BVH file's text in another space; the motion is the same.

    Args:
        text: with positions X, Y, Z before the angles of a joint, each absolute as its parent sees it.
        matrices: (F, 4, 4) from the file's space to the other in each frame: a rotation, one scale for all axes, the
            same in all frames, and a place.
    """
    space = np.asarray(matrices, dtype=np.float64)
    turns = rot.from_matrix(space[:, :3, :3] / np.cbrt(np.linalg.det(space[0, :3, :3])))
    linear = space[0, :3, :3]  # of the rest pose
    hierarchy, _, motion = text.partition("\nMOTION\n")
    lines, joints = _hierarchy(hierarchy, linear)
    head, rate, *rows = motion.strip("\n").splitlines()
    values = np.array([row.split() for row in rows], dtype=np.float64).reshape(len(rows), -1)
    for joint in joints:
        if joint.place and joint.is_top:
            values[:, joint.place] = np.einsum("fij,fj->fi", space[:, :3, :3], values[:, joint.place]) + space[:, :3, 3]
        elif joint.place:
            values[:, joint.place] = values[:, joint.place] @ linear.T
        if joint.angles:
            angles = np.radians(values[:, joint.angles])
            before, after = turns if joint.is_top else turns[:1], rot.conjugate(turns[:1])
            turned = rot.multiply(rot.multiply(before, rot.from_euler(angles, joint.order)), after)
            values[:, joint.angles] = np.degrees(rot.unwrap_euler(rot.to_euler(turned, joint.order)))
    written = [" ".join(f"{value:.{_DECIMALS}f}" for value in row) for row in values]
    return "\n".join([*lines, "MOTION", head, rate, *written]) + "\n"


def _hierarchy(text: str, linear: Array) -> tuple[list[str], list[_Joint]]:
    """Return the lines with their offsets moved, and the joints with their channels."""
    lines: list[str] = []
    joints: list[_Joint] = []
    above: list[bool] = []  # of the joints that are open: whether it or one above it has channels
    column = 0
    for line in text.splitlines():
        words = line.split()
        indent = line[: len(line) - len(line.lstrip())]
        if words[:1] == ["{"]:
            above.append(above[-1] if above else False)
        elif words[:1] == ["}"]:
            above.pop()
        elif words[:1] == ["OFFSET"]:
            x, y, z = linear @ np.array([float(word) for word in words[1:]])
            line = f"{indent}OFFSET {x:.{_DECIMALS}f} {y:.{_DECIMALS}f} {z:.{_DECIMALS}f}"
        elif words[:1] == ["CHANNELS"]:
            joint = _Joint(not above[-1])
            for name in words[2:]:
                (joint.place if name.endswith("position") else joint.angles).append(column)
                joint.order += name[0] if name.endswith("rotation") else ""
                column += 1
            joints.append(joint)
            above[-1] = above[-1] or len(words) > 2
        lines.append(line)
    return lines, joints
