"""Motion of any skeleton, expressed on the product's joints with the source's own bone lengths."""

import numpy as np
from numpy.typing import NDArray

from .angle_frames import with_angle_frames
from .errors import SkeletonError
from .formats.source_motion import SourceMotion
from .motion import Motion
from .product_skeleton import JOINT_NAMES, default_skeleton
from .skeleton import Skeleton

Array = NDArray[np.float64]


def map_motion(source: SourceMotion) -> Motion:
    """Return the motion on the product's 29 joints."""
    if set(source.names) != set(JOINT_NAMES):
        raise SkeletonError("has other joints than the product's skeleton", where=source.where)
    return _renamed(source)


def _renamed(source: SourceMotion) -> Motion:
    """Return the motion of a file that already has the product's joints: reordered, nothing computed."""
    order = [source.names.index(name) for name in JOINT_NAMES]
    parents = [-1 if source.parents[i] < 0 else order.index(int(source.parents[i])) for i in order]
    tips = source.tips_m[order].copy()
    offsets = source.offsets_m[order].copy()
    offsets[0] = 0.0
    reference = default_skeleton()
    for joint in range(len(order)):
        children = [child for child, parent in enumerate(parents) if parent == joint]
        if children and not np.any(tips[joint]):
            tips[joint] = offsets[
                min(children, key=lambda c: float(np.linalg.norm(offsets[c] - reference.tips_m[joint])))
            ]
    skeleton = with_angle_frames(Skeleton(JOINT_NAMES, np.array(parents), offsets, tips))
    return Motion(source.name, source.fps, skeleton, source.rotations[:, order], source.translations_m[0])
