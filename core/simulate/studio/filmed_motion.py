"""Body and markers in front of the cameras at any time of a motion."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ...body.motion import Motion
from ...body.skeleton import marker_positions
from ...geometry.arrays import Array
from .carried_prop import HAND, Carried, with_prop
from .cones import RoundCones
from .performer_body import Body, make_body, with_sticks


@dataclass(frozen=True)
class Performance:
    """A motion with body and markers that can be sampled between its frames.

    Args:
        starts_m: Starts (F, P, 3) of the body's cones in world axes.
        ends_m: Ends (F, P, 3) of the body's cones in world axes.
        markers_m: Marker centres (F, M, 3) in world axes.
        partners: Further performers; their markers come after the performer's.
    """

    motion: Motion
    body: Body
    marker_names: tuple[str, ...]
    starts_m: Array
    ends_m: Array
    markers_m: Array
    partners: "tuple[Performance, ...]" = ()

    @property
    def everybody(self) -> "tuple[Performance, ...]":
        """The first performer and the partners, each as a performance without partners."""
        return (replace(self, partners=()), *self.partners)

    def cones_at(self, time_s: float) -> RoundCones:
        """Return the performer's body at a time; before and after the motion it does not move."""
        times = np.array([time_s])
        return self.body.placed(*(_sampled(ends, self.motion.fps, times)[0] for ends in (self.starts_m, self.ends_m)))

    def markers_at(self, times_s: ArrayLike) -> Array:
        """Return all performers' marker centres (N, M, 3) at times (N,)."""
        times = np.asarray(times_s, dtype=np.float64)
        own = _sampled(self.markers_m, self.motion.fps, times)
        return np.concatenate((own, *(one.markers_at(times) for one in self.partners)), axis=1)


def make_performance(
    motion: Motion,
    marker_names: tuple[str, ...],
    joints: ArrayLike,
    offsets_m: ArrayLike,
    carried: Carried | None = None,
) -> Performance:
    """Return the performance of a motion by a body with markers.

    Args:
        joints: Joint (M,) that carries each marker.
        offsets_m: Markers (M, 3) in the joints' axes.
        carried: Prop in the hand; its markers come after the performer's.
    """
    carriers, places = np.asarray(joints, dtype=np.int64), np.asarray(offsets_m, dtype=np.float64)
    body = with_sticks(make_body(motion.skeleton), carriers, places)
    if carried is not None:
        body = with_prop(body, motion.skeleton, carried)
        marker_names = (*marker_names, *carried.prop.names)
        carriers = np.concatenate((carriers, np.full(len(carried.prop.names), motion.skeleton.index(HAND))))
        places = np.concatenate((places, carried.offsets_m))
    starts, ends = body.posed(motion.rotations, motion.root_positions_m)
    markers = marker_positions(motion.skeleton, carriers, places, motion.rotations, motion.root_positions_m)
    return Performance(motion, body, tuple(marker_names), starts, ends, markers)


def _sampled(values: Array, fps: float, times_s: Array) -> Array:
    """Return values (F, ...) at times (N,) on a Catmull-Rom curve, constant before and after it."""
    last = len(values) - 1
    place = np.clip(times_s * fps, 0.0, last)
    nearest = np.round(place)
    if np.all(np.abs(place - nearest) < 1e-9):
        return values[nearest.astype(np.int64)]
    before = np.minimum(place.astype(np.int64), last - 1)
    f = (place - before).reshape(-1, *([1] * (values.ndim - 1)))
    p0, p1 = values[np.maximum(before - 1, 0)], values[before]
    p2, p3 = values[before + 1], values[np.minimum(before + 2, last)]
    slope1, slope2 = 0.5 * (p2 - p0), 0.5 * (p3 - p1)
    f2, f3 = f * f, f * f * f
    curve: Array = (2 * f3 - 3 * f2 + 1) * p1 + (f3 - 2 * f2 + f) * slope1 + (3 * f2 - 2 * f3) * p2 + (f3 - f2) * slope2
    return curve
