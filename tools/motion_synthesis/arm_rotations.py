"""Two-bone limbs: analytic inverse kinematics, and orientations of arms and hands.

The world and chest frames below are those of the rest pose: x to the left, y up, z forward. The "hinge" is the axis
about which the limb's middle joint flexes for positive angles.
"""

import numpy as np
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.two_bone_ik import triangle_angle

from .curves import Array
from .proportions import about, outward

# shares of a limb's length: up to the first it reaches exactly, and it never exceeds the second, because a limb that
# snaps straight has infinite joint speed and no defined plane
_LEG_REACH, ARM_REACH = (0.9990, 0.9998), (0.92, 0.9975)
_ELBOW_TILT_RAD = np.deg2rad(30.0)  # CMU's T pose: the crook of the elbow faces forward and up
# unrestricted up to the first angle, never beyond the second
_WRIST_RANGE_RAD, _TWIST_RANGE_RAD = np.deg2rad((55.0, 80.0)), np.deg2rad((100.0, 130.0))


def unit(vectors: Array) -> Array:
    """Return vectors of length one."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def frame_from(rest_bone: Array, rest_hinge: Array, bone: Array, hinge: Array) -> Array:
    """Return rotations (T, 4) that turn a rest bone and hinge to world ones; each bone is orthogonal to its hinge."""
    rest = np.stack((rest_hinge, rest_bone, np.cross(rest_hinge, rest_bone)), axis=-1)
    world = np.stack((hinge, bone, np.cross(hinge, bone)), axis=-1)
    return rot.from_matrix(world @ rest.T)


def two_bones(
    start: Array,
    target: Array,
    hinge_hint: Array,
    lengths: tuple[float, float],
    rest: tuple[Array, Array],
    reach_shares: tuple[float, float] = _LEG_REACH,
) -> tuple[Array, Array]:
    """Return how two bones reach from `start` to `target` (T, 3).

    Args:
        hinge_hint: Desired hinge axis (T, 3); its component perpendicular to the line start-target is used.
        lengths: Lengths of the first and second bone.
        rest: Direction of the (straight) limb and hinge axis in the rest pose.
        reach_shares: Largest exact reach and largest reach, as shares of the limb's length.

    Returns:
        World orientation of the first bone (T, 4), flexion of the joint (T,), radians.
    """
    first, second = lengths
    line = target - start
    distance = np.linalg.norm(line, axis=1)
    reach = (first + second) * soft_limit(distance / (first + second), *reach_shares)
    reach = np.maximum(reach, 1.02 * abs(first - second) + 1e-6)
    along = line / distance[:, None]
    hinge = unit(hinge_hint - np.sum(hinge_hint * along, axis=1, keepdims=True) * along)
    at_start = triangle_angle(first, reach, second)[:, None]
    # the first bone turns against the flexion; the second follows with it
    bone = np.cos(at_start) * along - np.sin(at_start) * np.cross(hinge, along)
    return frame_from(*rest, bone, hinge), np.pi - triangle_angle(first, second, reach)


def arm_rest(side: str) -> tuple[Array, Array]:
    """Return the arm's direction and the elbow's hinge in the rest pose."""
    s = outward(side)
    return np.array([s, 0.0, 0.0]), s * np.array([0.0, -np.cos(_ELBOW_TILT_RAD), np.sin(_ELBOW_TILT_RAD)])


def hand_rest(side: str) -> tuple[Array, Array]:
    """Return the directions of fingers and palm in the rest pose."""
    return np.array([outward(side), 0.0, 0.0]), np.array([0.0, -1.0, 0.0])


def leg_rest(flat: Array) -> tuple[Array, Array]:
    """Return the leg's direction and the knee's hinge in the rest pose; `flat` makes the shank vertical."""
    back = rot.conjugate(flat)
    return rot.rotate(back, np.array([0.0, -1.0, 0.0])), rot.rotate(back, np.array([1.0, 0.0, 0.0]))


def hanging_arm(side: str, flex_rad: Array, abduct_rad: Array, twist_rad: Array) -> Array:
    """Return chest-from-humerus of an arm swung forward and sideways from hanging.

    With `twist` 0 the elbow of a hanging arm flexes straight forward; positive twist turns the forearm inwards.
    abduct 90 and twist -30 degrees is the rest pose.
    """
    s = outward(side)
    swing = rot.multiply(about("X", -flex_rad), about("Z", s * abduct_rad))
    hanging = frame_from(*arm_rest(side), np.array([[0.0, -1.0, 0.0]]), np.array([[-1.0, 0.0, 0.0]]))
    return rot.multiply(rot.multiply(swing, about("Y", -s * twist_rad)), hanging)


def elbow(side: str, flexion_rad: Array) -> Array:
    """Return the elbow's local rotation."""
    return rot.from_rotation_vector(arm_rest(side)[1] * np.asarray(flexion_rad)[..., None])


def soft_limit(angles: Array, free_rad: float, limit_rad: float) -> Array:
    """Return angles gently limited to `limit_rad`, unchanged up to `free_rad`."""
    room = limit_rad - free_rad
    beyond = np.maximum(np.abs(angles) - free_rad, 0.0)
    return np.asarray(np.sign(angles) * (np.minimum(np.abs(angles), free_rad) + room * np.tanh(beyond / room)))


def limited(rotations: Array, free_rad: float, limit_rad: float) -> Array:
    """Return rotations by angles gently limited to `limit_rad`."""
    vector = rot.to_rotation_vector(rotations)
    angle = np.linalg.norm(vector, axis=-1, keepdims=True)
    return rot.from_rotation_vector(vector * (soft_limit(angle, free_rad, limit_rad) / np.maximum(angle, 1e-9)))


def forearm_and_hand(side: str, world_from_radius: Array, world_from_hand: Array) -> tuple[Array, Array]:
    """Return local rotations of wrist (pure forearm twist) and hand for a world hand."""
    axis, _ = arm_rest(side)
    radius_from_hand = rot.multiply(rot.conjugate(world_from_radius), world_from_hand)
    angle = 2.0 * np.arctan2(radius_from_hand[..., 1:] @ axis, radius_from_hand[..., 0])
    angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
    bend = rot.multiply(rot.from_rotation_vector(-axis * angle[..., None]), radius_from_hand)
    held = soft_limit(angle, *_TWIST_RANGE_RAD)
    return rot.from_rotation_vector(axis * held[..., None]), limited(bend, *_WRIST_RANGE_RAD)
