"""Targets of a body's joints in every frame: keys met, standing feet held.

A joint's target is where the database's motion has it, plus a displacement. At a key the displacement leads to the
key; while a foot stands it keeps the toes where they are; between these it runs smoothly. Before its first key a
control keeps that key's displacement, after its last key the last one's, but loosely: others' keys bind there.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ..body.skeleton import Skeleton
from ..geometry import rotations as rot
from ..geometry.arrays import Array
from ..geometry.rigid_transform import kabsch
from .key_curves import curve_positions
from .motion_library import TOES, standing_toes_m
from .reach import Reach
from .sketch_file import Control, Sketch
from .stances import Foot, held_foot

_ANKLES = ("lfoot", "rfoot")
_KEY_SIGMA_M, _SWING_SIGMA_M = 0.001, 0.03
_STAND_SIGMAS_M = 0.004, 0.002  # of ankle and toes of a standing foot between its keys
_STEP_SIGMA_M = 0.006  # of a stepping foot between its keys
_GRIP_S = 0.03  # standard deviation of the time in which a foot's hold comes and goes: at once, it shakes the body
_STEADIED_S = 0.02  # standard deviation of the time over which examples are asked whether a foot stands
_LOOSENED_S = 0.3  # in which a control becomes loose before its first key and after its last
# distances of the controls from the database's motion at which a body begins to be turned to them, and is fully
_TURNED_M = 0.25, 0.5
_LIMBS_M = 0.15  # way to targets that limbs go without the body
_BENT_M = 0.15  # distance of a key from the database's motion, from which it says little of the way between keys
_LOWEST_HIPS_M = 0.2  # of a body that crouches; lower ones stand on something lower


@dataclass(frozen=True)
class Targets:
    """Targets of joints.

    Args:
        joints: names (M).
        points_m: (F, M, 3).
        sigmas_m: (F, M) standard deviations.
    """

    joints: tuple[str, ...]
    points_m: Array
    sigmas_m: Array


def target_joints(sketch: Sketch) -> tuple[str, ...]:
    """Return the joints with targets: controls, those that bind most first, and feet."""
    keyed = {control.joint for control in sketch.controls}
    first = sorted(keyed, key=lambda name: (name != "root", name not in _ANKLES, name))
    return (*first, *(name for name in (*_ANKLES, *TOES) if name not in keyed))


def targets_of(
    sketch: Sketch, skeleton: Skeleton, base_m: Array, standing: Array, follow: float, hold_feet: bool
) -> Targets:
    """Return the targets of every frame, within each other's reach.

    Args:
        base_m: (F, M, 3) where the database's motion has the `target_joints`.
        standing: (F, 2) share with which left and right toes stand there.
    """
    frames, joints = sketch.frames, target_joints(sketch)
    controls = {control.joint: control for control in sketch.controls}
    points, sigmas = base_m.copy(), np.full(base_m.shape[:2], _SWING_SIGMA_M)
    for column, name in enumerate(joints[: len(controls)]):
        points[:, column] = _control_targets(controls[name], frames, base_m[:, column], follow)
        sigmas[:, column] = _control_sigmas(controls[name], frames, sketch.fps)
    reach, keyed_in = Reach(skeleton, joints), np.zeros((len(frames), len(controls)), dtype=np.bool_)
    for column, name in enumerate(joints[: len(controls)]):
        keyed_in[(controls[name].frames - frames[0]).astype(np.int64), column] = True
    points[:, : len(controls)] = reach.yielding(points[:, : len(controls)], keyed_in)
    # without a key of its own a foot goes with the hips, but stays on the floor where they sink to a crouch
    carried = points[:, 0] - base_m[:, 0] if "root" in controls else np.zeros((len(frames), 3))
    on_floor = "root" in controls and bool(points[:, 0, 1].min() > _LOWEST_HIPS_M)
    standing = gaussian_filter1d(standing, _STEADIED_S * sketch.fps, axis=0, mode="nearest")
    for side, pair in enumerate(zip(_ANKLES, TOES, strict=True)):
        columns = [joints.index(name) for name in pair]
        leader = next((name for name in pair if name in controls), None)
        wanted, keyed = carried, np.zeros(0, dtype=np.int64)
        if on_floor:
            sinks_m = np.minimum(standing_toes_m(skeleton) - base_m[:, columns[1], 1], 0.0)
            wanted = np.column_stack((carried[:, 0], np.maximum(carried[:, 1], sinks_m), carried[:, 2]))
        if leader:
            wanted = points[:, joints.index(leader)] - base_m[:, joints.index(leader)]
            keyed = np.flatnonzero(keyed_in[:, joints.index(leader)])
        led = [column for column, name in zip(columns, pair, strict=True) if name == leader or name not in controls]
        foot = Foot(base_m[:, columns[0]], base_m[:, columns[1]], wanted, keyed, leader == pair[1])
        if not hold_feet:
            points[:, led] = base_m[:, led] + wanted[:, None]
            continue
        held = held_foot(foot, standing[:, side], None if leader else standing_toes_m(skeleton), sketch.fps)
        for column, target, sigma_m in zip(columns, (held.ankle_m, held.toes_m), _STAND_SIGMAS_M, strict=True):
            if column in led:
                points[:, column] = target
                own = np.where(held.stands, sigma_m, np.maximum(sigmas[:, column], _STEP_SIGMA_M))
                bound = keyed if joints[column] == leader else keyed[:0]
                own[bound] = _KEY_SIGMA_M
                own = np.exp(gaussian_filter1d(np.log(own), _GRIP_S * sketch.fps, mode="nearest"))
                own[bound] = _KEY_SIGMA_M
                sigmas[:, column] = own
    return Targets(joints, reach.limited(points), sigmas)


def carried_root(
    targets: Targets, controls: int, base_m: Array, rotations: Array, root_m: Array
) -> tuple[Array, Array]:
    """Return the root of the database's motion, carried along to far targets.

    Args:
        controls: how many of the targets are keyed.
        base_m: (F, M, 3) where that motion has the joints.
        rotations, root_m: (F, 4) and (F, 3) of the root.
    """
    places = root_m.copy()
    if targets.joints[0] == "root":
        places += targets.points_m[:, 0] - base_m[:, 0]
    else:
        ways = np.mean(targets.points_m[:, :controls] - base_m[:, :controls], axis=1)
        places += ways * np.maximum(0.0, 1.0 - _LIMBS_M / np.maximum(np.linalg.norm(ways, axis=1), 1e-9))[:, None]
    if controls < 3:
        return rotations, places
    turned = rotations.copy()
    away = targets.points_m[:, :controls] - base_m[:, :controls] - (places - root_m)[:, None]
    share = np.interp(np.sqrt(np.mean(np.sum(away**2, axis=2), axis=1)), _TURNED_M, (0.0, 1.0))
    for frame in np.flatnonzero(share > 0.0).tolist():
        matrix, _ = kabsch(base_m[frame, :controls], targets.points_m[frame, :controls])
        turn = share[frame] * rot.to_rotation_vector(rot.from_matrix(matrix))
        turned[frame] = rot.multiply(rot.from_rotation_vector(turn), rotations[frame])
    return turned, places


def _control_targets(control: Control, frames: Array, base_m: Array, follow: float) -> Array:
    """Return targets (F, 3) of a control.

    Args:
        frames: (F,) of the sketch.
        base_m: (F, 3) where the database's motion has the joint.
        follow: 0 keeps the database's motion between keys, 1 follows the curve; its square is the curve's share.
    """
    keyed, positions_m = control.distinct_keys()
    binds = np.array([1.0, 0.0 if control.height_is_free else 1.0, 1.0])
    away_m = binds * (positions_m - base_m[(keyed - frames[0]).astype(np.int64)])
    bent = base_m + curve_positions(keyed, away_m, frames)
    # motion that is far from the keys does not say how to go from one to the next: it may stand up between two crouches
    kept = np.interp(frames, keyed, 1.0 / (1.0 + (np.sum(away_m**2, axis=1) / _BENT_M**2) ** 2))[:, None]
    between = (frames >= keyed[0]) & (frames <= keyed[-1])
    share = 1.0 - (1.0 - follow**2) * kept
    return np.where(between[:, None], bent + share * binds * (control.curve(frames) - bent), bent)


def _control_sigmas(control: Control, frames: Array, fps: float) -> Array:
    """Return standard deviations (F,) of a control: loose before and after its keys."""
    away_s = np.maximum(np.maximum(control.frames[0] - frames, frames - control.frames[-1]), 0.0) / fps
    loose = np.clip(away_s / _LOOSENED_S, 0.0, 1.0)
    return np.asarray(_KEY_SIGMA_M * (_SWING_SIGMA_M / _KEY_SIGMA_M) ** loose)
