"""Prototype bodies from which measured subjects are interpolated (assets/skeletons.json)."""

import json
from pathlib import Path

import numpy as np

from ..body.skeleton import Skeleton
from ..body.standard_skeleton import JOINT_NAMES, default_skeleton
from ..errors import SkeletonError
from ..system.assets import SKELETONS


def load_bodies(path: Path | str = SKELETONS) -> tuple[Skeleton, ...]:
    """Return the prototype bodies from a file; by default the shipped ones.

    Raises:
        SkeletonError: The file cannot be read, is of another kind, or has other joints.
    """
    plain = default_skeleton()
    try:
        facts = json.loads(Path(path).read_text(encoding="utf-8"))
        if facts["version"] != 1 or tuple(facts["joints"]) != JOINT_NAMES:
            advice = "use the file that came with this version"
            raise SkeletonError("was written by another version, or for other joints", where=str(path), advice=advice)
        return tuple(
            Skeleton(plain.names, plain.parents, np.array(row["offsets_m"]), np.array(row["tips_m"]))
            for row in facts["skeletons"]
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SkeletonError(
            f"cannot be read as skeletons ({error})", where=str(path), advice="use the file that came with this version"
        ) from error
