"""Prop in the simulated performer's right hand."""

from dataclasses import dataclass

import numpy as np

from ...body.skeleton import Skeleton
from ...geometry import rotations as rot
from ...geometry.arrays import Array
from ...markers.prop import Prop
from .performer_body import Body

HAND = "rhand"
_GRIP_RAD = np.deg2rad(50.0)  # angle of the shaft in the palm, from the thumb's side towards the fingers
_FIST_M = np.array([-0.045, -0.02, 0.0])  # centre of the fist in the hand's axes
# distance along the shaft from the prop's origin, which lies between the hands, to the right fist
_ORIGIN_TO_FIST_M = 0.09


@dataclass(frozen=True)
class Carried:
    """A prop that is fixed to a joint.

    Args:
        rotation: Joint-from-prop quaternion (4,).
        position_m: The prop's origin (3,) in the joint's axes.
    """

    prop: Prop
    rotation: Array
    position_m: Array

    @property
    def offsets_m(self) -> Array:
        """The prop's markers (M, 3) in the joint's axes."""
        return self.position_m + rot.rotate(self.rotation, self.prop.positions_m)


def in_hand(prop: Prop) -> Carried:
    """Return the prop gripped by the right fist, with y along its shaft."""
    along = np.array([-np.sin(_GRIP_RAD), 0.0, np.cos(_GRIP_RAD)])
    edge = np.array([-np.cos(_GRIP_RAD), 0.0, -np.sin(_GRIP_RAD)])
    turn = np.stack((np.cross(along, edge), along, edge), axis=1)
    return Carried(prop, rot.from_matrix(turn), _FIST_M - _ORIGIN_TO_FIST_M * along)


def with_prop(body: Body, skeleton: Skeleton, carried: Carried) -> Body:
    """Return the body with the prop: a shaft along y, and an arm to each marker off the shaft."""
    places = carried.prop.positions_m
    low, high = float(places[:, 1].min()), float(places[:, 1].max())
    starts, ends = [np.array([0.0, low, 0.0])], [np.array([0.0, high, 0.0])]
    for place in places:
        foot = np.array([0.0, place[1], 0.0])
        if np.linalg.norm(place - foot) > 0.03:
            starts.append(foot)
            ends.append(place)
    count = len(starts)
    radii = np.array([0.012] + [0.006] * (count - 1))

    def held(points: list[Array]) -> Array:
        return np.asarray(carried.position_m + rot.rotate(carried.rotation, np.array(points)))

    return body.with_wood(np.full(count, skeleton.index(HAND)), held(starts), held(ends), radii)
