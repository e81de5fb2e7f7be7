"""Body of the performer: round cones on a skeleton, with usual adult proportions.

It is drawn by the studio and by the preview, and it hides markers from the cameras.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...body.skeleton import Skeleton, forward_kinematics
from ...body.standard_skeleton import JOINT_NAMES, default_skeleton
from ...geometry import rotations as rot
from ...geometry.arrays import Array, IntArray
from .cones import RoundCones, axis_distances

SUIT, TROUSERS, SKIN, SHOES, WOOD = "suit", "trousers", "skin", "shoes", "wood"

_HELD_M = 0.2  # a marker farther than this from the body sits on something that is held
_STICK_RADIUS_M = 0.012

# joint: list of (start, end, start radius, end radius, material) in metres for 1.75 m of height, left side.
# start and end are (share of the bone, x, y, z): a place on the bone from the joint (0) to its tip (1), then shifted.
_Place = tuple[float, float, float, float]
_Part = tuple[_Place, _Place, float, float, str]
_MIDDLE: dict[str, tuple[_Part, ...]] = {
    "root": (
        ((0.0, 0.070, -0.045, 0.022), (0.0, -0.070, -0.045, 0.022), 0.104, 0.104, TROUSERS),
        ((0.0, 0.052, 0.020, 0.022), (0.0, -0.052, 0.020, 0.022), 0.098, 0.098, TROUSERS),
    ),
    "lowerback": (((0.0, 0.0, 0.0, 0.026), (1.0, 0.0, 0.0, 0.024), 0.094, 0.091, SUIT),),
    "upperback": (((0.0, 0.0, 0.0, 0.016), (1.0, 0.0, 0.0, 0.014), 0.091, 0.103, SUIT),),
    "thorax": (((0.0, 0.0, 0.0, 0.014), (0.8, 0.0, 0.0, -0.008), 0.103, 0.070, SUIT),),
    "upperneck": (((-0.5, 0.0, 0.0, -0.006), (1.0, 0.0, 0.0, 0.0), 0.058, 0.054, SKIN),),
    "head": (
        ((0.0, 0.0, 0.005, 0.030), (1.0, 0.0, -0.010, 0.002), 0.071, 0.095, SKIN),
        ((0.5, 0.0, -0.012, 0.096), (0.5, 0.0, -0.022, 0.104), 0.013, 0.014, SKIN),
    ),
}
_PAIRED: dict[str, tuple[_Part, ...]] = {  # left and right of the middle on one joint
    "lowerback": (((0.0, 0.045, 0.02, 0.022), (1.0, 0.042, 0.0, 0.022), 0.096, 0.092, SUIT),),
    "upperback": (((0.0, 0.042, 0.0, 0.014), (1.0, 0.064, 0.0, 0.014), 0.092, 0.104, SUIT),),
    "thorax": (((0.0, 0.064, 0.0, 0.014), (0.8, 0.092, 0.0, -0.010), 0.104, 0.074, SUIT),),
}
_LEFT: dict[str, tuple[_Part, ...]] = {  # the right side mirrors it
    "lclavicle": (((0.15, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 0.058, 0.060, SUIT),),
    "lhumerus": (((0.02, 0.0, -0.004, 0.0), (1.0, 0.0, 0.0, 0.0), 0.055, 0.042, SUIT),),
    "lradius": (((0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 0.043, 0.032, SUIT),),
    "lwrist": (((0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 0.031, 0.027, SKIN),),
    "lhand": (
        ((-0.3, 0.0, 0.0, 0.018), (1.0, 0.0, 0.0, 0.020), 0.021, 0.020, SKIN),
        ((-0.3, 0.0, 0.0, -0.018), (1.0, 0.0, 0.0, -0.020), 0.021, 0.019, SKIN),
    ),
    "lfingers": (
        ((0.0, 0.0, 0.0, 0.020), (1.0, 0.0, 0.0, 0.014), 0.019, 0.011, SKIN),
        ((0.0, 0.0, 0.0, -0.020), (1.0, -0.008, 0.0, -0.014), 0.018, 0.010, SKIN),
    ),
    "lthumb": (((0.1, 0.0, 0.0, 0.0), (1.3, 0.0, 0.0, 0.0), 0.018, 0.013, SKIN),),
    "lfemur": (((0.0, 0.0, 0.0, -0.012), (1.0, 0.0, 0.0, 0.0), 0.092, 0.060, TROUSERS),),
    "ltibia": (
        ((0.0, 0.0, 0.0, 0.0), (0.32, 0.0, 0.0, -0.010), 0.059, 0.057, TROUSERS),
        ((0.32, 0.0, 0.0, -0.010), (1.0, 0.0, 0.0, 0.0), 0.057, 0.040, TROUSERS),
    ),
    "lfoot": (
        ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, -0.030, -0.040), 0.044, 0.038, SHOES),
        ((0.0, 0.0, -0.026, -0.030), (1.0, 0.0, 0.0, 0.0), 0.040, 0.034, SHOES),
    ),
    "ltoes": (((0.0, 0.0, 0.0, 0.0), (1.0, 0.0, -0.006, 0.0), 0.034, 0.026, SHOES),),
}


@dataclass(frozen=True)
class Body:
    """P round cones fixed to the joints of one skeleton.

    Args:
        joints: (P,) joint that carries each cone.
        starts_m, ends_m: (P, 3) ends of the cones' axes in the joint's own axes, metres.
        start_radii_m, end_radii_m: (P,) radii there, metres.
        materials: (P) "suit", "trousers", "skin", "shoes" or "wood".
    """

    skeleton: Skeleton
    joints: IntArray
    starts_m: Array
    ends_m: Array
    start_radii_m: Array
    end_radii_m: Array
    materials: tuple[str, ...]

    @cached_property
    def limbs(self) -> tuple[IntArray, ...]:
        """Indices of the cones by limb: trunk, head, each arm and each leg."""
        names = [_limb(self.skeleton.names[joint]) for joint in self.joints]
        return tuple(np.array([i for i, name in enumerate(names) if name == limb]) for limb in sorted(set(names)))

    def posed(self, rotations: Array, root_position_m: Array) -> tuple[Array, Array]:
        """Return the axes' world starts and ends (..., P, 3) for rotations (..., J, 4)."""
        positions, world = forward_kinematics(self.skeleton, rotations, root_position_m)
        origin, turn = positions[..., self.joints, :], world[..., self.joints, :]
        return origin + rot.rotate(turn, self.starts_m), origin + rot.rotate(turn, self.ends_m)

    def cones(self, rotations: Array, root_position_m: Array) -> RoundCones:
        """Return the body in one pose: (J, 4) rotations, (3,) root position."""
        starts, ends = self.posed(rotations, root_position_m)
        return self.placed(starts, ends)

    def placed(self, starts: Array, ends: Array) -> RoundCones:
        """Return the body with its axes at the given world positions, (P, 3) each."""
        return RoundCones(starts, ends, self.start_radii_m, self.end_radii_m)


def make_body(skeleton: Skeleton) -> Body:
    """Return the body of a skeleton: limbs with its lengths and an adult's girths.

    Joints that the product does not know get a thin cone along their bone.
    """
    scale = _size(skeleton)
    rows: list[tuple[int, Array, Array, float, float, str]] = []
    for joint, name in enumerate(skeleton.names):
        for (start, end, r0, r1, material), mirror in _parts_of(name):
            shift = scale * mirror
            tip = skeleton.tips_m[joint]
            places = [place[0] * tip + shift * np.array(place[1:]) for place in (start, end)]
            rows.append((joint, places[0], places[1], scale * r0, scale * r1, material))
    return Body(
        skeleton=skeleton,
        joints=np.array([row[0] for row in rows]),
        starts_m=np.array([row[1] for row in rows]),
        ends_m=np.array([row[2] for row in rows]),
        start_radii_m=np.array([row[3] for row in rows]),
        end_radii_m=np.array([row[4] for row in rows]),
        materials=tuple(row[5] for row in rows),
    )


def with_sticks(body: Body, joints: IntArray, offsets_m: Array) -> Body:
    """Return the body with a stick to every marker far from it, such as a sword's tip.

    joints (M,) carry the markers at offsets_m (M, 3) in their axes, metres.
    """
    sticks = []
    for marker, joint in enumerate(joints):
        own = body.joints == joint
        cones = RoundCones(body.starts_m[own], body.ends_m[own], body.start_radii_m[own], body.end_radii_m[own])
        distance, radius = axis_distances(offsets_m[marker][None], cones)
        if own.any() and float((distance - radius).min()) > _HELD_M:
            sticks.append(marker)
    count = len(sticks)
    radii = np.full(count, _STICK_RADIUS_M)
    return replace(
        body,
        joints=np.concatenate((body.joints, joints[sticks])),
        starts_m=np.concatenate((body.starts_m, np.zeros((count, 3)))),
        ends_m=np.concatenate((body.ends_m, offsets_m[sticks].reshape(count, 3))),
        start_radii_m=np.concatenate((body.start_radii_m, radii)),
        end_radii_m=np.concatenate((body.end_radii_m, radii)),
        materials=(*body.materials, *([WOOD] * count)),
    )


def _parts_of(name: str) -> list[tuple[_Part, Array]]:
    """Return the cones of a joint, and factors that mirror them to its side."""
    left, right = np.array([1.0, 1.0, 1.0]), np.array([-1.0, 1.0, 1.0])
    if name in _MIDDLE or name in _PAIRED:
        paired = [(part, side) for part in _PAIRED.get(name, ()) for side in (left, right)]
        return [(part, left) for part in _MIDDLE.get(name, ())] + paired
    if name in _LEFT:
        return [(part, left) for part in _LEFT[name]]
    if name.startswith("r") and "l" + name[1:] in _LEFT:
        return [(part, right) for part in _LEFT["l" + name[1:]]]
    if name in JOINT_NAMES:  # lowerneck: drawn with the upper neck
        return []
    return [(((0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 0.03, 0.03, SUIT), left)]


def _limb(joint: str) -> str:
    side, part = joint[:1], joint[1:]
    if part in ("humerus", "radius", "wrist", "hand", "fingers", "thumb"):
        return side + "arm"
    if part in ("femur", "tibia", "foot", "toes"):
        return side + "leg"
    return "head" if joint == "head" else "trunk"


def _size(skeleton: Skeleton) -> float:
    """Return the mean ratio of the bone lengths to the default skeleton's."""
    reference = default_skeleton()
    common = [name for name in skeleton.names if name in reference.names]
    if not common:
        return 1.0
    own = np.linalg.norm(skeleton.offsets_m[[skeleton.index(name) for name in common]], axis=1).sum()
    other = np.linalg.norm(reference.offsets_m[[reference.index(name) for name in common]], axis=1).sum()
    return float(own / other) if own > 0.0 else 1.0
