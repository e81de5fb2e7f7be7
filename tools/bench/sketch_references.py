"""Other methods from the curves of a sketch to a body, for comparison."""

import numpy as np
from perfanim.core.body.calibration_poses import standing
from perfanim.core.body.motion import Motion
from perfanim.core.body.skeleton import Skeleton, forward_kinematics
from perfanim.core.database.store import Database
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array
from perfanim.core.geometry.two_bone_ik import reach_with_two_bones
from perfanim.core.markers.marker_set import Marker, MarkerSet
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.subject import Subject
from perfanim.core.session.solve_take import solve_take
from perfanim.core.sketch.sketch_file import Sketch
from perfanim.core.solver.settings import SolveSettings

_UP = np.array([0.0, 1.0, 0.0])
_KNEE, _ELBOW = np.array([1.0, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0])  # knees bend forwards, elbows backwards
_SPINE = ("lowerback", "upperback", "thorax")
_MOST_TWIST_RAD = np.radians(60.0)  # of the chest against the hips
_BENT_RAD = 0.2
_STRAIGHTEST = 0.995


def solved_as_markers(sketch: Sketch, skeleton: Skeleton, database: Database, settings: SolveSettings) -> Motion:
    """Return the motion of a method that takes the curves for markers.

    All count as the torso's: else nothing would tell where the root is.
    """
    joints = [control.joint for control in sketch.controls]
    markers = MarkerSet("controls", tuple(Marker(name, name, (0.0, 0.0, 0.0), torso=True) for name in joints))
    curves = np.stack([control.curve(sketch.frames) for control in sketch.controls], axis=1)
    take = MarkerTake(sketch.name, sketch.fps, tuple(joints), curves)
    subject = Subject(sketch.name, skeleton, markers)
    return solve_take(take, subject, database, settings, lambda fraction, text: None).motion


def inverse_kinematics(sketch: Sketch, skeleton: Skeleton) -> Motion:
    """Return the motion of a usual rig on the curves: two-bone limbs, a spline spine.

    Hips and chest turn about the vertical as the feet and the hands lie to each other, the spine between them evenly;
    limbs without a control hang.
    """
    curves = {control.joint: control.curve(sketch.frames) for control in sketch.controls}
    chest = _yaws([curves["lhand"] - curves["rhand"]])
    pairs = [curves[f"l{end}"] - curves[f"r{end}"] for end in ("foot", "hand") if f"l{end}" in curves]
    hips = _yaws(pairs)
    twist = np.clip((chest - hips + np.pi) % (2.0 * np.pi) - np.pi, -_MOST_TWIST_RAD, _MOST_TWIST_RAD)
    rotations = np.repeat(_bent(skeleton)[None], len(hips), axis=0)
    rotations[:, 0] = rot.from_rotation_vector(hips[:, None] * _UP)
    for name in _SPINE:
        rotations[:, skeleton.index(name)] = rot.from_rotation_vector(twist[:, None] / len(_SPINE) * _UP)
    for frame in range(len(rotations)):
        goals = {joint: points[frame] for joint, points in curves.items() if joint != "root"}
        _reach(skeleton, rotations[frame], curves["root"][frame], goals)
    return Motion(sketch.name, sketch.fps, skeleton, rotations, curves["root"])


def _bent(skeleton: Skeleton) -> Array:
    """Return rotations (J, 4) of a standing body, limbs a little bent as a rig's."""
    rotations = standing(skeleton)
    _, world = forward_kinematics(skeleton, rotations, np.zeros(3))
    for name, axis in (("tibia", _KNEE), ("radius", _ELBOW)):
        for joint in (skeleton.index(side + name) for side in "lr"):
            local = rot.rotate(rot.conjugate(world[joint]), axis)
            rotations[joint] = rot.multiply(rotations[joint], rot.from_rotation_vector(_BENT_RAD * local))
    return rotations


def _yaws(pairs: list[Array]) -> Array:
    """Return yaws (F,) of a body with its left along the sum of vectors."""
    planar = sum(pair[:, [0, 2]] / np.linalg.norm(pair[:, [0, 2]], axis=1, keepdims=True) for pair in pairs)
    return np.asarray(np.unwrap(np.arctan2(-planar[:, 1], planar[:, 0])))


def _reach(skeleton: Skeleton, rotations: Array, root_m: Array, goals: dict[str, Array]) -> None:
    """Turn the limbs of one frame's rotations (J, 4) so that they end at goals."""
    for joint, goal in goals.items():
        side, is_leg = joint[0], joint[1:] == "foot"
        upper, lower = (
            skeleton.index(side + name) for name in (("femur", "tibia") if is_leg else ("humerus", "radius"))
        )
        end = skeleton.index(joint)
        positions, world = forward_kinematics(skeleton, rotations, root_m)
        hinge = rot.rotate(rotations[0], _KNEE if is_leg else _ELBOW)
        first, second = reach_with_two_bones(
            (positions[upper], positions[lower], positions[end]),
            (world[upper], world[lower]),
            goal - positions[upper],
            hinge,
            _STRAIGHTEST,
        )
        rotations[upper] = rot.multiply(rot.conjugate(world[skeleton.parents[upper]]), first)
        rotations[lower] = rot.multiply(rot.conjugate(first), second)
        if is_leg:
            rotations[end] = rot.multiply(rot.conjugate(second), world[end])
