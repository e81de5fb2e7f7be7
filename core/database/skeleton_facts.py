"""Skeletons in a database's header."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..body.skeleton import Skeleton
from ..body.standard_skeleton import JOINT_NAMES
from ..system.schema import Key

_J = len(JOINT_NAMES)
BODY = (
    Key("offsets_m", "joints from their parents", float, (_J, 3), "m", -10.0, 10.0),
    Key("tips_m", "ends of bones from their joints", float, (_J, 3), "m", -10.0, 10.0),
    Key("angle_axes", "frames of the angles", float, (_J, 4), "", -1.1, 1.1),
    Key("angle_orders", "axes that turn, in their order", str, (_J,)),
    Key("parents", "parents of joints", int, (_J,), "", -1, _J - 1),
)


def skeleton_facts(skeleton: Skeleton) -> dict[str, Any]:
    """Return a standard skeleton for JSON."""
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
