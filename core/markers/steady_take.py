"""Resampling marker takes at a steady rate."""

from dataclasses import replace

import numpy as np

from ..body.clock import Clock, clock_of
from ..geometry.arrays import Array
from .marker_take import MarkerTake


def take_clock(take: MarkerTake) -> Clock:
    """Return the clock of a take's frames; if all times are equal, it follows from frame numbers and nominal rate."""
    clock = clock_of(take.times_s, take.fps, take.frame_numbers)
    if len(clock.rows) > 1 or take.frames == 1:
        return clock
    return clock_of(take.frame_numbers / take.fps, take.fps, take.frame_numbers)


def frame_times(take: MarkerTake) -> Array:
    """Return ascending times (F,) of all frames, s; a frame without a time gets one between its neighbours'."""
    clock = take_clock(take)
    rows, times_s = clock.rows, clock.times_s
    between = np.interp(np.arange(take.frames), rows, times_s)
    beyond = np.arange(take.frames) - np.clip(np.arange(take.frames), rows[0], rows[-1])
    return between + beyond / clock.fps


def steady_take(take: MarkerTake) -> MarkerTake:
    """Return the take at a steady rate, for formats that state a rate; a take with a steady rate is unchanged.

    Positions are interpolated by their times. They are NaN where frames of a steady rate were lost, between frames that
    are far apart, and next to frames in which the marker is hidden. Markers that single cameras saw are left out.
    """
    clock = take_clock(take)
    if clock.is_whole and clock.fps == take.fps and np.all(np.diff(take.frame_numbers) == 1):
        return replace(take, times_s=clock.times_s)
    visible = take.visible
    positions = np.stack(
        [clock.seen(take.positions_m[:, marker], visible[:, marker]) for marker in range(len(take.names))], axis=1
    )
    numbers = take.frame_numbers[0] + np.arange(len(positions))
    return replace(
        take, fps=clock.fps, positions_m=positions, frame_numbers=numbers, times_s=clock.steady_s, single=None
    )
