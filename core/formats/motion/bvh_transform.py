"""Change of coordinates of BVH files written by Blender's exporter."""

import re

import numpy as np
from numpy.typing import ArrayLike

from ...geometry import rotations as rot
from .bvh_hierarchy import BvhHierarchy, read_hierarchy


def transform_bvh(text: str, matrices: ArrayLike) -> str:
    """Return a BVH file's text in other coordinates.

    Args:
        text: BVH with position channels in the order X, Y, Z.
        matrices: Transform (F, 4, 4) from the file's coordinates in each frame: a rotation, a translation, and a
            uniform scale that is the same in all frames.
    """
    space = np.asarray(matrices, dtype=np.float64)
    linear = space[0, :3, :3]  # for the rest pose
    turns = rot.from_matrix(space[:, :3, :3] / np.cbrt(np.linalg.det(linear)))
    head, _, motion = text.partition("\nMOTION\n")
    hierarchy = read_hierarchy(head, "BVH file")
    is_top = _is_top(hierarchy)
    frames, rate, *rows = motion.strip("\n").splitlines()
    values = np.array([row.split() for row in rows], dtype=np.float64).reshape(len(rows), -1)
    for columns, joints, _ in np.swapaxes(hierarchy.places.reshape(-1, 3, 3), 1, 2):
        if is_top[joints[0]]:
            values[:, columns] = np.einsum("fij,fj->fi", space[:, :3, :3], values[:, columns]) + space[:, :3, 3]
        else:
            values[:, columns] = values[:, columns] @ linear.T
    for turn in hierarchy.turns:
        for joint, columns in zip(turn.joints, turn.columns, strict=True):
            angles = np.radians(values[:, columns])
            before, after = turns if is_top[joint] else turns[:1], rot.conjugate(turns[:1])
            turned = rot.multiply(rot.multiply(before, rot.from_euler(angles, turn.order)), after)
            values[:, columns] = np.degrees(rot.unwrap_euler(rot.to_euler(turned, turn.order)))

    def moved(match: re.Match[str]) -> str:
        return "OFFSET " + " ".join(f"{value:.6f}" for value in linear @ np.array(match[1].split(), dtype=np.float64))

    written = [" ".join(f"{value:.6f}" for value in row) for row in values]
    return "\n".join([re.sub("OFFSET (.*)", moved, head), "MOTION", frames, rate, *written]) + "\n"


def _is_top(hierarchy: BvhHierarchy) -> list[bool]:
    """Return a mask (J,) of the joints whose ancestors have no channels."""
    animated = {int(joint) for turn in hierarchy.turns for joint in turn.joints} | set(hierarchy.places[:, 1].tolist())
    result: list[bool] = []
    for parent in hierarchy.parents.tolist():
        result.append(parent < 0 or (result[parent] and parent not in animated))
    return result
