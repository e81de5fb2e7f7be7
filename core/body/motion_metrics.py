"""Errors of a motion relative to the ground truth: angles, positions, jitter, foot skate."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import FormatError
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray
from .body_parts import PARTS
from .clock import CLOCK
from .joint_angle_frames import with_angle_frames
from .motion import Motion, resampled, sliced
from .skeleton import Skeleton, forward_kinematics, joint_angles
from .standard_skeleton import JOINT_NAMES
from .window_filters import smallest

_FOOT_JOINTS = ("ltoes", "rtoes")
_MAIN_JOINTS = {
    joint for part, joints in PARTS.items() if part.split()[-1] in ("torso", "arm", "leg") for joint in joints
}


@dataclass(frozen=True)
class ContactSettings:
    """Limits within which toes are planted on the floor."""

    speed_m_s: float = 0.15  # largest speed, well above measurement noise
    height_m: float = 0.05  # largest height above the toes' lowest position within a second


CONTACT = ContactSettings()


@dataclass(frozen=True)
class _Pair:
    """The frames of both motions that are compared, with their joints in the same order, root first."""

    motion: Motion
    truth: Motion
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Errors:
    """Errors in every frame: of joints (F, J), including the root, and of joint angles (F, A)."""

    rotation_deg: Array
    angle_deg: Array
    angle_joints: IntArray
    position_mm: Array
    absolute_mm: Array
    direction_deg: Array
    own_direction_deg: Array
    twist_deg: Array


def evaluate(motion: Motion, truth: Motion, skeleton: Skeleton | None = None) -> dict[str, Any]:
    """Compare a motion with its truth, frame by frame from the start of both.

    The truth is resampled to the motion's rate. Only the frames and joints (by name) that both have are compared.

    Args:
        skeleton: Skeleton with the frames and axes of the joint angles; by default those of the truth or, if it has
            none, of the CMU database.

    Returns:
        Measures by name.

        - deg_per_joint: mean angle between the local rotations over all frames and joints except the root, degrees.
        - deg_per_angle: mean absolute difference of the joint angles, wrapped, degrees; each rotation has two triples
          of angles, the nearer of which is compared.
        - mpjpe_mm: mean joint distance with the roots aligned; mpjpe_absolute_mm: without aligning them.
        - bone_direction_deg: mean angle between the bones' directions in the world; bone_direction_in_root_deg: the
          same in the root's frame; main_bone_direction_deg: for torso, arms and legs only (NaN if the motions have
          none of them).
        - twist_deg: mean error of the local rotation about the bone.
        - root_position_mm, root_rotation_deg: mean errors of the root.
        - jitter_ratio: mean third difference of the joint positions relative to the truth's (NaN if the truth does not
          move).
        - foot_skate_cm_s: mean horizontal speed of the toes in frames in which the true toes are planted (NaN if they
          never are); foot_skate_truth_cm_s: the truth's own.
        - frames, fps, joints, per_joint, worst_frames, notes.

    Raises:
        FormatError: The motions have fewer than two joints in common.
    """
    pair = _aligned(motion, truth)
    angle_skeleton = _angle_skeleton(skeleton or pair.truth.skeleton, pair.truth.skeleton)
    estimated = forward_kinematics(pair.motion.skeleton, pair.motion.rotations, pair.motion.root_positions_m)
    true = forward_kinematics(pair.truth.skeleton, pair.truth.rotations, pair.truth.root_positions_m)
    errors = _errors(pair, angle_skeleton, estimated, true)
    skate, true_skate = _foot_skate(pair.truth, estimated[0], true[0])
    main = [joint for joint, name in enumerate(pair.truth.skeleton.names) if name in _MAIN_JOINTS]
    return {
        "deg_per_joint": float(np.mean(errors.rotation_deg[:, 1:])),
        "deg_per_angle": float(np.mean(errors.angle_deg)),
        "mpjpe_mm": float(np.mean(errors.position_mm[:, 1:])),
        "mpjpe_absolute_mm": float(np.mean(errors.absolute_mm)),
        "bone_direction_deg": float(np.mean(errors.direction_deg[:, 1:])),
        "bone_direction_in_root_deg": float(np.mean(errors.own_direction_deg[:, 1:])),
        "main_bone_direction_deg": float(np.mean(errors.direction_deg[:, main])) if main else float("nan"),
        "twist_deg": float(np.mean(errors.twist_deg[:, 1:])),
        "root_position_mm": float(np.mean(errors.absolute_mm[:, 0])),
        "root_rotation_deg": float(np.mean(errors.rotation_deg[:, 0])),
        "jitter_ratio": _jitter_ratio(estimated[0], true[0]),
        "foot_skate_cm_s": skate,
        "foot_skate_truth_cm_s": true_skate,
        "frames": pair.motion.frames,
        "fps": pair.motion.fps,
        "joints": len(pair.motion.skeleton),
        "per_joint": _per_joint(pair.motion.skeleton.names, errors),
        "worst_frames": _worst_frames(errors),
        "notes": list(pair.notes),
    }


def _aligned(motion: Motion, truth: Motion) -> _Pair:
    notes = []
    if abs(motion.fps - truth.fps) * motion.duration_s > CLOCK.same:
        notes.append(f"truth resampled from {truth.fps:g} to {motion.fps:g} frames per second")
        truth = resampled(truth, motion.fps)
    frames = min(motion.frames, truth.frames)
    if motion.frames != truth.frames:
        lasts = f"motion has {motion.frames} frames ({motion.duration_s:.2f} s), truth {truth.frames}"
        notes.append(f"{lasts} ({truth.duration_s:.2f} s); the first {frames} are compared")
    shared = [name for name in truth.skeleton.names if name in motion.skeleton.names]
    if len(shared) < 2 or shared[0] != truth.skeleton.names[0] or shared[0] != motion.skeleton.names[0]:
        raise FormatError(
            "the motion and the truth share fewer than two joints",
            where=f"{motion.name}, {truth.name}",
            advice="compare motions with the same joint names",
        )
    if len(shared) < max(len(motion.skeleton), len(truth.skeleton)):
        notes.append(f"only the {len(shared)} joints that both have are compared")
    return _Pair(
        _with_joints(sliced(motion, 0, frames), shared), _with_joints(sliced(truth, 0, frames), shared), tuple(notes)
    )


def _with_joints(motion: Motion, names: list[str]) -> Motion:
    """Return the motion with only these joints; the others are held at rest."""
    old = motion.skeleton
    if list(old.names) == names:
        return motion
    kept = [old.index(name) for name in names]
    world = forward_kinematics(old, motion.rotations, motion.root_positions_m)[1]
    parents, offsets = [-1], [np.zeros(3)]
    for joint in kept[1:]:
        above, offset = int(old.parents[joint]), old.offsets_m[joint]
        while above not in kept:
            offset, above = offset + old.offsets_m[above], int(old.parents[above])
        parents.append(kept.index(above))
        offsets.append(offset)
    skeleton = Skeleton(
        tuple(names), np.array(parents), np.array(offsets), old.tips_m[kept],
        old.angle_axes[kept], tuple(old.angle_orders[joint] for joint in kept),
    )  # fmt: skip
    local = world[:, kept].copy()
    local[:, 1:] = rot.multiply(rot.conjugate(world[:, kept][:, parents[1:]]), local[:, 1:])
    return Motion(motion.name, motion.fps, skeleton, local, motion.root_positions_m)


def _angle_skeleton(chosen: Skeleton, compared: Skeleton) -> Skeleton:
    """Return the skeleton `compared` with the angle frames of the chosen skeleton."""
    without_own = np.allclose(chosen.angle_axes[:, 0], 1.0)  # all frames are the identity
    if without_own and set(chosen.names) <= set(JOINT_NAMES):
        chosen = with_angle_frames(chosen)
    missing = [name for name in compared.names if name not in chosen.names]
    if missing:
        raise FormatError(
            "lacks " + ", ".join(missing[:5]),
            where="skeleton that defines the joint angles",
            advice="choose one with all compared joints",
        )
    order = [chosen.index(name) for name in compared.names]
    orders = tuple(chosen.angle_orders[joint] for joint in order)
    return replace(compared, angle_axes=chosen.angle_axes[order], angle_orders=orders)


def _errors(pair: _Pair, angles: Skeleton, estimated: tuple[Array, Array], true: tuple[Array, Array]) -> _Errors:
    difference = 1000.0 * (estimated[0] - true[0])
    angle_deg, angle_joints = angle_errors_deg(angles, pair.motion.rotations, pair.truth.rotations)
    mine, theirs = _bone_directions(pair.motion.skeleton), _bone_directions(pair.truth.skeleton)
    local_error = rot.multiply(rot.conjugate(pair.truth.rotations), pair.motion.rotations)
    mine_world, theirs_world = rot.rotate(estimated[1], mine), rot.rotate(true[1], theirs)
    mine_own, theirs_own = (
        rot.rotate(rot.conjugate(world[:, :1]), bones)
        for world, bones in ((estimated[1], mine_world), (true[1], theirs_world))
    )
    along = np.sum(local_error[..., 1:] * theirs, axis=-1)
    return _Errors(
        rotation_deg=np.degrees(rot.angle_between(pair.motion.rotations, pair.truth.rotations)),
        angle_deg=angle_deg,
        angle_joints=angle_joints,
        position_mm=np.linalg.norm(difference - difference[:, :1], axis=-1),
        absolute_mm=np.linalg.norm(difference, axis=-1),
        direction_deg=_angles_between(mine_world, theirs_world),
        own_direction_deg=_angles_between(mine_own, theirs_own),
        twist_deg=np.degrees(2.0 * np.abs(np.arctan2(along, np.abs(local_error[..., 0])))),
    )


def _bone_directions(skeleton: Skeleton) -> Array:
    """Return unit rest directions (J, 3) of the bones; up where a bone has no length."""
    length = np.linalg.norm(skeleton.tips_m, axis=-1, keepdims=True)
    return np.where(length > 1e-6, skeleton.tips_m / np.maximum(length, 1e-6), np.array([0.0, 1.0, 0.0]))


def _angles_between(a: Array, b: Array) -> Array:
    return np.degrees(2.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1)))


def angle_errors_deg(skeleton: Skeleton, mine: Array, theirs: Array) -> tuple[Array, IntArray]:
    """Return the differences (F, A) of joint angles in degrees, without the root's, and the joint (A,) of each angle.

    Args:
        skeleton: Skeleton with the axes of the joint angles.
        mine, theirs: Local rotations (F, J, 4); each rotation has two triples of angles, the nearer of which is
            compared.

    Raises:
        FormatError: No joint has an angle.
    """
    columns, joints = [], []
    pairs = zip(joint_angles(skeleton, mine), joint_angles(skeleton, theirs), strict=True)
    for joint, (a, b) in enumerate(pairs):
        if joint == 0 or a.shape[-1] == 0:
            continue
        difference = np.abs(_wrapped(a - b))
        if a.shape[-1] == 3:
            # (first, middle, last) and (first + pi, pi - middle, last + pi) are one rotation
            other = np.stack((a[..., 0] + np.pi, np.pi - a[..., 1], a[..., 2] + np.pi), axis=-1)
            other = np.abs(_wrapped(other - b))
            nearer = np.sum(other, axis=-1, keepdims=True) < np.sum(difference, axis=-1, keepdims=True)
            difference = np.where(nearer, other, difference)
        columns.append(difference)
        joints += [joint] * a.shape[-1]
    if not columns:
        raise FormatError(
            "no joint but the root has degrees of freedom, so there are no angles to compare",
            where="skeleton that defines the joint angles",
            advice="choose a skeleton whose joints have angles",
        )
    return np.degrees(np.concatenate(columns, axis=-1)), np.array(joints)


def _wrapped(angles: Array) -> Array:
    return (angles + np.pi) % (2.0 * np.pi) - np.pi


def _jitter_ratio(estimated: Array, true: Array) -> float:
    if len(true) < 4:
        return float("nan")
    mine, theirs = (float(np.mean(np.linalg.norm(np.diff(p, 3, axis=0), axis=-1))) for p in (estimated, true))
    return mine / theirs if theirs > 1e-9 else float("nan")


def _foot_skate(truth: Motion, estimated: Array, true: Array) -> tuple[float, float]:
    """Return the mean toe speeds, cm/s, estimated and true, in the frames in which the true toes are planted."""
    feet = [truth.skeleton.names.index(name) for name in _FOOT_JOINTS if name in truth.skeleton.names]
    if not feet or len(true) < 2:
        return float("nan"), float("nan")
    velocity = np.diff(true[:, feet], axis=0) * truth.fps
    height = 0.5 * (true[1:, feet, 1] + true[:-1, feet, 1])
    lowest = smallest(height, round(truth.fps))
    low = height < lowest + CONTACT.height_m
    contact = low & (np.linalg.norm(velocity, axis=-1) < CONTACT.speed_m_s)
    if not np.any(contact):
        return float("nan"), float("nan")
    mine = np.diff(estimated[:, feet], axis=0) * truth.fps
    speeds = (np.linalg.norm(v[..., [0, 2]], axis=-1)[contact] for v in (mine, velocity))
    skate, true_skate = (100.0 * float(np.mean(speed)) for speed in speeds)
    return skate, true_skate


def _per_joint(names: tuple[str, ...], errors: _Errors) -> dict[str, dict[str, float]]:
    table = {}
    for joint, name in enumerate(names):
        angles = errors.angle_deg[:, errors.angle_joints == joint]
        table[name] = {
            "deg": float(np.mean(errors.rotation_deg[:, joint])),
            "deg_per_angle": float(np.mean(angles)) if angles.size else float("nan"),
            "position_mm": float(np.mean(errors.position_mm[:, joint])),
            "bone_direction_deg": float(np.mean(errors.direction_deg[:, joint])),
            "twist_deg": float(np.mean(errors.twist_deg[:, joint])),
        }
    return table


def _worst_frames(errors: _Errors) -> list[dict[str, float]]:
    of_frame = np.mean(errors.rotation_deg[:, 1:], axis=1)
    worst = np.argsort(-of_frame)[:5]
    return [
        {
            "frame": int(frame),
            "deg_per_joint": float(of_frame[frame]),
            "mpjpe_mm": float(np.mean(errors.position_mm[frame, 1:])),
        }
        for frame in worst
    ]
