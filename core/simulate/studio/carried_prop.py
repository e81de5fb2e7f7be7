"""Prop in the simulated performer's right hand: markers and shape."""

from dataclasses import dataclass

import numpy as np

from ...body.skeleton import Skeleton
from ...geometry import rotations as rot
from ...geometry.arrays import Array
from ...markers.prop import Prop
from .performer_body import Body

HAND = "rhand"
_SHAFT_RADIUS_M, _ARM_RADIUS_M = 0.012, 0.006
_ON_SHAFT_M = 0.03  # markers nearer to the shaft than this need no arm
# In the hand's axes: from the thumb's side towards the fingers, as a grip lies aslant in the palm.
_ASLANT_RAD = np.deg2rad(50.0)
_FIST_M = np.array([-0.045, -0.02, 0.0])
_FIST_ALONG_M = 0.09  # from the prop's origin, which lies between the hands


@dataclass(frozen=True)
class Carried:
    """A prop that is fixed to a joint.

    Args:
        rotation: (4,) joint-from-prop quaternion.
        position_m: (3,) the prop's origin in the joint's axes.
    """

    prop: Prop
    rotation: Array
    position_m: Array

    @property
    def offsets_m(self) -> Array:
        """(M, 3) the prop's markers in the joint's axes."""
        return self.position_m + rot.rotate(self.rotation, self.prop.positions_m)


def in_hand(prop: Prop) -> Carried:
    """Return the prop gripped by the right fist, y along its shaft."""
    along = np.array([-np.sin(_ASLANT_RAD), 0.0, np.cos(_ASLANT_RAD)])
    edge = np.array([-np.cos(_ASLANT_RAD), 0.0, -np.sin(_ASLANT_RAD)])
    turn = np.stack((np.cross(along, edge), along, edge), axis=1)
    return Carried(prop, rot.from_matrix(turn), _FIST_M - _FIST_ALONG_M * along)


def with_prop(body: Body, skeleton: Skeleton, carried: Carried) -> Body:
    """Return the body with the prop: a shaft along y, an arm to each marker beside it."""
    places = carried.prop.positions_m
    low, high = float(places[:, 1].min()), float(places[:, 1].max())
    starts, ends = [np.array([0.0, low, 0.0])], [np.array([0.0, high, 0.0])]
    for place in places:
        foot = np.array([0.0, place[1], 0.0])
        if np.linalg.norm(place - foot) > _ON_SHAFT_M:
            starts.append(foot)
            ends.append(place)
    count = len(starts)
    radii = np.array([_SHAFT_RADIUS_M] + [_ARM_RADIUS_M] * (count - 1))

    def held(points: list[Array]) -> Array:
        return np.asarray(carried.position_m + rot.rotate(carried.rotation, np.array(points)))

    return body.with_wood(np.full(count, skeleton.index(HAND)), held(starts), held(ends), radii)
