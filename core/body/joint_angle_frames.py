"""Frames and axes for the standard skeleton's joint angles: those of the CMU database.

The frames come from that database's ASF files, in which they are the same for all subjects.
"""

from dataclasses import replace

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array
from .skeleton import Skeleton
from .standard_skeleton import JOINT_NAMES, facts_of


def angle_frame(name: str) -> tuple[Array, str]:
    """Return a joint's rest-from-angle-frame quaternion (4,) and the order of its angles."""
    row = facts_of(name) if name in JOINT_NAMES else {}
    mirror = np.array([1.0, 1.0, 1.0] if name.startswith("l") else [1.0, -1.0, -1.0])
    x, y, z = np.radians(np.array(row.get("angle_frame_deg", (0.0, 0.0, 0.0))) * mirror)
    return rot.from_euler(np.array([z, y, x]), "ZYX"), row.get("angle_order", "ZYX")


def with_angle_frames(skeleton: Skeleton) -> Skeleton:
    """Return the skeleton with the angle frames of the standard skeleton's joints."""
    axes = skeleton.angle_axes.copy()
    orders = list(skeleton.angle_orders)
    for joint, name in enumerate(skeleton.names):
        axes[joint], orders[joint] = angle_frame(name)
    return replace(skeleton, angle_axes=axes, angle_orders=tuple(orders))
