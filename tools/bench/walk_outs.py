"""Performers out of both cameras' pictures, then back elsewhere and turned."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from perfanim.core.body.motion import Motion
from perfanim.core.geometry.arrays import Array, Mask
from perfanim.core.simulate.studio.studio_rig import default_rig

from .data import FPS
from .end_to_end import on_treadmill
from .random_cuts import AFTER, Cut, facing, markers_of, part_of

_WAY = 120  # frames of the way out, and of the way in
_SPEED_M_S = 1.4
_AWAY = (120, 180, 240, 300)  # frames between
_TURN_RAD, _SHIFT_M = 1.5, 0.5  # how far, at most, who is back faces and stands elsewhere


@dataclass(frozen=True)
class WalkOut(Cut):
    """Markers shown by both cameras, of somebody leaving and coming back.

    Args:
        again: first frame in which both cameras show the whole body again.
    """

    again: int

    @property
    def back(self) -> int:
        """First frame to have right labels."""
        return self.again


def walk_outs(takes: Mapping[str, Motion], count: int, generator: np.random.Generator) -> Iterator[WalkOut]:
    """Yield up to `count` walks out and in; the body is that of the first take."""
    names = [name for name, take in takes.items() if take.frames >= _WAY + AFTER]
    for _ in range(count if len(names) > 1 else 0):
        first, second = (str(name) for name in generator.choice(names, 2, replace=False))
        away, side = int(generator.choice(_AWAY)), float(generator.choice((-1.0, 1.0)))
        skeleton = takes[first].skeleton
        turn, (x, z) = generator.uniform(-_TURN_RAD, _TURN_RAD), generator.uniform(-_SHIFT_M, _SHIFT_M, 2)
        leaving = markers_of(facing(on_treadmill(part_of(takes[first], _WAY, generator)), 0.0, np.zeros(3)))
        coming = on_treadmill(part_of(takes[second], _WAY + AFTER, generator))
        back = markers_of(
            facing(
                Motion(second, FPS, skeleton, coming.rotations, coming.root_positions_m), turn, np.array([x, 0.0, z])
            )
        )
        steps_m = _SPEED_M_S / FPS * np.arange(_WAY)
        leaving[..., 0] += side * steps_m[:, None]
        back[:_WAY, :, 0] += side * steps_m[::-1, None]
        for markers in (leaving, back):
            markers[~_shown(markers)] = np.nan
        whole = np.flatnonzero(np.isfinite(back).all(axis=(1, 2)))
        if len(whole) == 0 or whole[0] + AFTER > len(back):
            continue
        gone = np.full((away, *back.shape[1:]), np.nan)
        positions = np.concatenate((leaving, gone, back[: whole[0] + AFTER]))
        yield WalkOut(f"{first}, out", second, first, away, skeleton, positions, _WAY + away + int(whole[0]))


def _shown(markers_m: Array) -> Mask:
    """Return whether each marker (F, M) is in all simulated pictures."""
    shown = np.ones(markers_m.shape[:2], dtype=bool)
    for camera in default_rig().cameras:
        pixels = camera.project(markers_m)
        shown &= np.all((pixels >= 0.0) & (pixels < camera.image_size), axis=-1)
    return shown
