"""Skeletons as facts of a database's header."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..body.skeleton import Skeleton
from ..body.standard_skeleton import JOINT_NAMES


def skeleton_facts(skeleton: Skeleton) -> dict[str, Any]:
    """Return a standard skeleton's numbers, for JSON."""
    return {
        "offsets_m": skeleton.offsets_m.tolist(),
        "tips_m": skeleton.tips_m.tolist(),
        "angle_axes": skeleton.angle_axes.tolist(),
        "angle_orders": list(skeleton.angle_orders),
        "parents": skeleton.parents.tolist(),
    }


def skeleton_from_facts(row: Mapping[str, Any]) -> Skeleton:
    """Return the skeleton of `skeleton_facts`."""
    return Skeleton(
        JOINT_NAMES,
        np.array(row["parents"]),
        np.array(row["offsets_m"]),
        np.array(row["tips_m"]),
        np.array(row["angle_axes"]),
        tuple(row["angle_orders"]),
    )
