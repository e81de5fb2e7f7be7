"""Targets for a body's joints in every frame: they meet the keys and keep planted feet in place.

A joint's target is its position in the database's motion plus a displacement. At a key the displacement leads to the
key; while a foot is planted it keeps the toes in place; in between it changes smoothly. Before its first key and after
its last one a control keeps that key's displacement, but loosely, because keys of other controls are binding there.
"""

from dataclasses import dataclass

import numpy as np

from ..body.calibration_poses import standing as standing_pose
from ..body.skeleton import Skeleton, forward_kinematics
from ..body.window_filters import gaussian
from ..geometry import rotations as rot
from ..geometry.arrays import Array
from ..geometry.rigid_transform import kabsch
from .key_interpolation import curve_positions
from .motion_library import TOES, standing_toes_m
from .reach import Reach
from .sketch_file import Control, Sketch
from .stances import Foot, held_foot

_ANKLES = ("lfoot", "rfoot")


@dataclass(frozen=True)
class TargetSettings:
    """Settings of the targets; sigmas are standard deviations."""

    key_sigma_m: float = 0.001
    free_sigma_m: float = 0.03  # joint that neither a key nor a contact holds
    standing_sigmas_m: tuple[float, float] = (0.004, 0.002)  # ankle and toes of a planted foot between its keys
    stepping_sigma_m: float = 0.006  # stepping foot between its keys
    grip_s: float = 0.03  # sigma for smoothing the targets' standard deviations: a sudden contact would shake the body
    steadied_s: float = 0.02  # sigma for smoothing the fraction of examples in which a foot is planted
    loosened_s: float = 0.3  # time in which a control becomes loose before its first key and after its last
    # distances of the controls from the database's motion at which the root starts to turn, and at which it turns fully
    turned_m: tuple[float, float] = (0.25, 0.5)
    limbs_m: float = 0.15  # distance to the targets that the limbs cover; the root covers the rest
    bent_m: float = 0.15  # distance of a key from the database's motion that halves the motion's effect around the key
    level_m: tuple[float, float] = (0.03, 0.1)  # height of a foot's keys below and above a standing foot on the floor
    lowest_hips_m: float = 0.2  # height of the hips in a deep crouch; below it, feet without keys follow the hips


SETTINGS = TargetSettings()


@dataclass(frozen=True)
class Targets:
    """Targets of joints.

    Args:
        joints: Names (M).
        points_m: Positions (F, M, 3).
        sigmas_m: Standard deviations (F, M).
    """

    joints: tuple[str, ...]
    points_m: Array
    sigmas_m: Array


def target_joints(sketch: Sketch) -> tuple[str, ...]:
    """Return the joints with targets: first the controls, the most binding first, then the feet."""
    keyed = {control.joint for control in sketch.controls}
    first = sorted(keyed, key=lambda name: (name != "root", name not in _ANKLES, name))
    return (*first, *(name for name in (*_ANKLES, *TOES) if name not in keyed))


def targets_of(
    sketch: Sketch, skeleton: Skeleton, base_m: Array, standing: Array, follow: float, hold_feet: bool
) -> Targets:
    """Return the targets of every frame, within each other's reach.

    Args:
        base_m: Positions (F, M, 3) of the `target_joints` in the database's motion.
        standing: Fractions (F, 2) of the examples in which the left and the right toes are planted.
    """
    frames, joints = sketch.frames, target_joints(sketch)
    controls = {control.joint: control for control in sketch.controls}
    points, sigmas = base_m.copy(), np.full(base_m.shape[:2], SETTINGS.free_sigma_m)
    keyed_in = np.zeros((len(frames), len(controls)), dtype=np.bool_)
    for column, name in enumerate(joints[: len(controls)]):
        points[:, column] = _control_targets(controls[name], frames, base_m[:, column], follow)
        sigmas[:, column] = _control_sigmas(controls[name], frames, sketch.fps)
        keyed_in[(controls[name].frames - frames[0]).astype(np.int64), column] = True
    reach = Reach(skeleton, joints)
    points[:, : len(controls)] = reach.yielding(points[:, : len(controls)], keyed_in)
    # a foot without keys follows the hips, but stays on the floor when they sink to a crouch
    carried = points[:, 0] - base_m[:, 0] if "root" in controls else np.zeros((len(frames), 3))
    on_floor = "root" in controls and bool(points[:, 0, 1].min() > SETTINGS.lowest_hips_m)
    standing = gaussian(standing, SETTINGS.steadied_s * sketch.fps)
    for side, pair in enumerate(zip(_ANKLES, TOES, strict=True)):
        columns = [joints.index(name) for name in pair]
        leader = next((name for name in pair if name in controls), None)
        floor_m, keyed, wanted = standing_toes_m(skeleton), np.zeros(0, dtype=np.int64), carried
        if leader:
            column = joints.index(leader)
            wanted, keyed = points[:, column] - base_m[:, column], np.flatnonzero(keyed_in[:, column])
        elif on_floor:
            sinks_m = np.minimum(floor_m - base_m[:, columns[1], 1], 0.0)
            wanted = np.column_stack((carried[:, 0], np.maximum(carried[:, 1], sinks_m), carried[:, 2]))
        led = [column for column, name in zip(columns, pair, strict=True) if name == leader or name not in controls]
        if not hold_feet:
            points[:, led] = base_m[:, led] + wanted[:, None]
            continue
        foot = Foot(base_m[:, columns[0]], base_m[:, columns[1]], wanted, keyed, leader == pair[1])
        on_level = leader is None or _on_floor(controls[leader], skeleton)
        held = held_foot(foot, standing[:, side], floor_m if on_level else None, sketch.fps)
        for column, target, sigma_m in zip(
            columns, (held.ankle_m, held.toes_m), SETTINGS.standing_sigmas_m, strict=True
        ):
            if column in led:
                points[:, column] = target
                own = np.where(held.stands, sigma_m, np.maximum(sigmas[:, column], SETTINGS.stepping_sigma_m))
                bound = keyed if joints[column] == leader else keyed[:0]
                own[bound] = SETTINGS.key_sigma_m
                own = np.exp(gaussian(np.log(own), SETTINGS.grip_s * sketch.fps))
                own[bound] = SETTINGS.key_sigma_m
                sigmas[:, column] = own
    return Targets(joints, reach.limited(points), sigmas)


def is_level(sketch: Sketch, skeleton: Skeleton) -> bool:
    """Return whether the body is on its feet on the floor, as far as the keys tell."""
    feet = [control for control in sketch.controls if control.joint in (*_ANKLES, *TOES)]
    hips = [control for control in sketch.controls if control.joint == "root"]
    upright = all(control.positions_m[:, 1].min() > SETTINGS.lowest_hips_m for control in hips)
    return upright and all(_on_floor(control, skeleton, np.inf) for control in feet) and bool(feet or hips)


def _on_floor(control: Control, skeleton: Skeleton, most_m: float = SETTINGS.level_m[1]) -> bool:
    """Return whether all keys of a foot are as high above the floor as that of a standing body, or up to `most_m` more.

    Lower keys show that the floor is elsewhere.
    """
    upright_m = forward_kinematics(skeleton, standing_pose(skeleton), np.zeros(3))[0][:, 1]
    toes = skeleton.index(control.joint[0] + "toes")
    foot_m = standing_toes_m(skeleton) + upright_m[skeleton.index(control.joint)] - upright_m[toes]
    heights_m = control.positions_m[:, 1] - foot_m
    return bool(heights_m.min() > -SETTINGS.level_m[0] and heights_m.max() < most_m)


def carried_root(
    targets: Targets, controls: int, base_m: Array, rotations: Array, root_m: Array
) -> tuple[Array, Array]:
    """Return root rotations (F, 4) and positions (F, 3) of the database's motion, moved towards distant targets.

    Args:
        controls: Number of targets that are controls; they come first.
        base_m: Positions (F, M, 3) of the joints in the database's motion.
        rotations: Root rotations (F, 4) of that motion.
        root_m: Root positions (F, 3) of that motion.
    """
    places, ways = root_m.copy(), targets.points_m[:, :controls] - base_m[:, :controls]
    if targets.joints[0] == "root":
        places += ways[:, 0]
    else:
        mean = np.mean(ways, axis=1)
        lengths = np.maximum(np.linalg.norm(mean, axis=1), 1e-9)
        places += mean * np.maximum(0.0, 1.0 - SETTINGS.limbs_m / lengths)[:, None]
    if controls < 3:
        return rotations, places
    turned = rotations.copy()
    away = ways - (places - root_m)[:, None]
    share = np.interp(np.sqrt(np.mean(np.sum(away**2, axis=2), axis=1)), SETTINGS.turned_m, (0.0, 1.0))
    for frame in np.flatnonzero(share > 0.0).tolist():
        matrix, _ = kabsch(base_m[frame, :controls], targets.points_m[frame, :controls])
        turn = share[frame] * rot.to_rotation_vector(rot.from_matrix(matrix))
        turned[frame] = rot.multiply(rot.from_rotation_vector(turn), rotations[frame])
    return turned, places


def _control_targets(control: Control, frames: Array, base_m: Array, follow: float) -> Array:
    """Return targets (F, 3) for a control in the frames (F,) of the sketch.

    Args:
        base_m: Positions (F, 3) of the joint in the database's motion.
        follow: 0 keeps the database's motion between keys, 1 follows the curve; its square is the curve's weight.
    """
    keyed, positions_m = control.distinct_keys()
    binds = np.array([1.0, 0.0 if control.height_is_free else 1.0, 1.0])
    away_m = binds * (positions_m - base_m[(keyed - frames[0]).astype(np.int64)])
    bent = base_m + curve_positions(keyed, away_m, frames)
    # motion far from the keys is no guide to the path between them: it may stand up between two crouches
    kept = np.interp(frames, keyed, 1.0 / (1.0 + (np.sum(away_m**2, axis=1) / SETTINGS.bent_m**2) ** 2))[:, None]
    between = (frames >= keyed[0]) & (frames <= keyed[-1])
    share = 1.0 - (1.0 - follow**2) * kept
    return np.where(between[:, None], bent + share * binds * (control.curve(frames) - bent), bent)


def _control_sigmas(control: Control, frames: Array, fps: float) -> Array:
    """Return standard deviations (F,) of a control: loose before and after its keys."""
    away_s = np.maximum(np.maximum(control.frames[0] - frames, frames - control.frames[-1]), 0.0) / fps
    loose = np.clip(away_s / SETTINGS.loosened_s, 0.0, 1.0)
    return np.asarray(SETTINGS.key_sigma_m * (SETTINGS.free_sigma_m / SETTINGS.key_sigma_m) ** loose)
