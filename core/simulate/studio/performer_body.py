"""Body of the performer: round cones on a skeleton, with typical adult proportions.

The studio and the preview draw this body, and in the studio it hides markers from the cameras.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...body.skeleton import Skeleton, forward_kinematics
from ...body.standard_skeleton import JOINT_NAMES, default_skeleton
from ...geometry import rotations as rot
from ...geometry.arrays import Array, IntArray
from .cones import RoundCones, axis_distances
from .studio_settings import TABLES

_PARTS: dict[str, list[dict[str, Any]]] = TABLES["body"]
_THIN_CONE = {"ends": [[0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]], "radii": [0.03, 0.03], "material": "suit"}


@dataclass(frozen=True)
class Body:
    """P round cones fixed to the joints of one skeleton.

    Args:
        joints: Joint (P,) that carries each cone.
        starts_m: Starts (P, 3) of the cones' axes in the joint's axes.
        ends_m: Ends (P, 3) of the cones' axes in the joint's axes.
        start_radii_m: Radii (P,) at the starts.
        end_radii_m: Radii (P,) at the ends.
        materials: Material (P,) of each cone: "suit", "trousers", "skin", "shoes" or "wood".
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
        """Return world starts and ends (..., P, 3) of the axes for rotations (..., J, 4)."""
        positions, world = forward_kinematics(self.skeleton, rotations, root_position_m)
        origin, turn = positions[..., self.joints, :], world[..., self.joints, :]
        return origin + rot.rotate(turn, self.starts_m), origin + rot.rotate(turn, self.ends_m)

    def cones(self, rotations: Array, root_position_m: Array) -> RoundCones:
        """Return the body in one pose, given by rotations (J, 4) and root position (3,)."""
        return self.placed(*self.posed(rotations, root_position_m))

    def with_wood(self, joints: IntArray, starts_m: Array, ends_m: Array, radii_m: Array) -> "Body":
        """Return the body with more cones (P,) for a held object."""
        return replace(
            self,
            joints=np.concatenate((self.joints, joints)),
            starts_m=np.concatenate((self.starts_m, starts_m)),
            ends_m=np.concatenate((self.ends_m, ends_m)),
            start_radii_m=np.concatenate((self.start_radii_m, radii_m)),
            end_radii_m=np.concatenate((self.end_radii_m, radii_m)),
            materials=(*self.materials, *(["wood"] * len(joints))),
        )

    def placed(self, starts: Array, ends: Array) -> RoundCones:
        """Return the body's cones with their axes between world positions (P, 3)."""
        return RoundCones(starts, ends, self.start_radii_m, self.end_radii_m)


def make_body(skeleton: Skeleton) -> Body:
    """Return the body of a skeleton, with an adult's girth.

    Joints that are not in the standard skeleton get a thin cone along their bone.
    """
    scale = _size(skeleton)
    rows: list[tuple[Any, ...]] = []
    for joint, name in enumerate(skeleton.names):
        for part, mirror in _parts_of(name):
            tip, shift = skeleton.tips_m[joint], scale * mirror
            places = (place[0] * tip + shift * np.array(place[1:]) for place in part["ends"])
            rows.append((joint, *places, *(scale * radius for radius in part["radii"]), part["material"]))
    *columns, materials = zip(*rows, strict=True)
    joints, starts, ends, start_radii, end_radii = (np.array(column) for column in columns)
    return Body(skeleton, joints, starts, ends, start_radii, end_radii, materials)


def with_sticks(body: Body, joints: IntArray, offsets_m: Array) -> Body:
    """Return the body with a stick to each marker more than 0.2 m away from its joint's cones, such as a sword's tip.

    Args:
        joints: Joint (M,) that carries each marker.
        offsets_m: Markers (M, 3) in the joints' axes.
    """
    sticks = []
    for marker, joint in enumerate(joints):
        own = body.joints == joint
        cones = RoundCones(body.starts_m[own], body.ends_m[own], body.start_radii_m[own], body.end_radii_m[own])
        distance, radius = axis_distances(offsets_m[marker][None], cones)
        if own.any() and float((distance - radius).min()) > 0.2:
            sticks.append(marker)
    ends = offsets_m[sticks].reshape(-1, 3)
    return body.with_wood(joints[sticks], np.zeros(ends.shape), ends, np.full(len(sticks), 0.012))


def _parts_of(name: str) -> list[tuple[dict[str, Any], Array]]:
    """Return the cones of a joint, each with the factors (3,) that mirror it to the joint's side."""
    left, right = np.array([1.0, 1.0, 1.0]), np.array([-1.0, 1.0, 1.0])
    if name in _PARTS:
        return [(part, side) for part in _PARTS[name] for side in ((left, right) if "paired" in part else (left,))]
    if name.startswith("r") and "l" + name[1:] in _PARTS:
        return [(part, right) for part in _PARTS["l" + name[1:]]]
    return [] if name in JOINT_NAMES else [(_THIN_CONE, left)]  # lowerneck is drawn with the upper neck


def _limb(joint: str) -> str:
    side, part = joint[:1], joint[1:]
    if part in ("humerus", "radius", "wrist", "hand", "fingers", "thumb"):
        return side + "arm"
    if part in ("femur", "tibia", "foot", "toes"):
        return side + "leg"
    return "head" if joint == "head" else "trunk"


def _size(skeleton: Skeleton) -> float:
    """Return the sum of the bone lengths as a multiple of the default skeleton's."""
    reference = default_skeleton()
    common = [name for name in skeleton.names if name in reference.names]
    own, other = (
        np.linalg.norm(body.offsets_m[[body.index(name) for name in common]], axis=1).sum() if common else 0.0
        for body in (skeleton, reference)
    )
    return float(own / other) if own > 0.0 else 1.0
