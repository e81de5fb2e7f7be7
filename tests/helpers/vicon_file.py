"""A take as Vicon's programs write it: C3D with z up and the performer's name before each label."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from perfanim.core.formats.markers.c3d_write import write_c3d
from perfanim.core.markers.marker_take import MarkerTake


def write_vicon_file(take: MarkerTake, path: Path) -> None:
    """Write a take with y up so that z points up, and with labels such as "Anna:LFHD"."""
    x, y, z = take.positions_m[..., [0]], take.positions_m[..., [1]], take.positions_m[..., [2]]
    names = tuple(f"Anna:{name}" for name in take.names)
    write_c3d(replace(take, names=names, positions_m=np.concatenate([x, -z, y], axis=-1)), path)
