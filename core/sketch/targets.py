"""Targets of a body's joints in every frame: keys met, standing feet held.

A joint's target is where the database's motion has it, plus a displacement. At a key the displacement leads to the
key; while a foot stands it keeps the toes where they are; between these it runs smoothly. Before its first key a
control keeps that key's displacement, after its last key the last one's, but loosely: others' keys bind there.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt, gaussian_filter1d

from ..body.skeleton import Skeleton
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray, Mask, runs
from ..geometry.rigid_transform import kabsch
from .curves import curve_positions
from .motion_library import TOES, standing_toes_m
from .reach import Reach
from .sketch import Control, Sketch

_ANKLES = ("lfoot", "rfoot")
_KEY_SIGMA_M, _SWING_SIGMA_M, _STAND_SIGMA_M = 0.001, 0.03, 0.004
_LOOSENED_S = 0.3  # in which a control becomes loose before its first key and after its last
_STANDS = 0.5  # share of the windows that show it
# distances of the controls from the database's motion at which a body begins to be turned to them, and is fully
_TURNED_M = 0.25, 0.5
_LIMBS_M = 0.15  # way to targets that limbs go without the body
_STAYED_M, _STAYED_M_S = 0.04, 0.1  # a foot stands between two keys that are no further apart, at no higher speed
_STEP_M, _STEP_M_S = 0.05, 1.0  # it takes a step between keys further apart, of this mean speed
_SHORTEST_CONTACT_S = 0.1
_CLEAR_M, _LIFTED_S = 0.025, 0.1  # a stepping foot is so far above the floor, so long after it has left it
_FLOOR_M = 0.12  # a foot that stands higher, or lower, stands on something else
_ROLL_S = 0.13  # in which a foot turns onto the place where it stands


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
    # without a key of its own a foot goes with the hips
    carried = points[:, 0] - base_m[:, 0] if "root" in controls else np.zeros((len(frames), 3))
    for side, pair in enumerate(zip(_ANKLES, TOES, strict=True)):
        columns = [joints.index(name) for name in pair]
        toes_m = base_m[:, columns[1]]
        leader = next((name for name in pair if name in controls), None)
        wanted, keyed, keys_m = carried, np.zeros(0, dtype=np.int64), np.zeros((0, 3))
        if leader:
            wanted = points[:, joints.index(leader)] - base_m[:, joints.index(leader)]
            keys, keys_m = controls[leader].distinct_keys()
            keyed = (keys - frames[0]).astype(np.int64)
        if hold_feet:
            stances = stances_of(standing[:, side] > _STANDS, toes_m + wanted, keyed, keys_m, sketch.fps)
            floor_m = None if leader else standing_toes_m(skeleton)
            wanted, stands, anchors_m = held_foot(toes_m, wanted, stances, keyed, floor_m)
            wanted = lifted_foot(toes_m, wanted, anchors_m, keyed, sketch.fps)
            sigmas[stands] = np.where(np.isin(np.arange(len(joints)), columns), _STAND_SIGMA_M, sigmas[stands])
        for column, name in zip(columns, pair, strict=True):
            if name == leader:
                sigmas[:, column] = np.minimum(sigmas[:, column], _control_sigmas(controls[name], frames, sketch.fps))
            if name == leader or name not in controls:
                points[:, column] = base_m[:, column] + wanted
        if hold_feet and leader != pair[1] and pair[1] not in controls:
            ankle_m, toes_m = points[:, columns[0]], points[:, columns[1]]
            points[:, columns[1]] = _rolled(ankle_m, toes_m, anchors_m, max(1, round(_ROLL_S * sketch.fps)))
    return Targets(joints, reach.limited(points), sigmas)


def lifted_foot(toes_m: Array, displacement_m: Array, anchors_m: Array, keyed: IntArray, fps: float) -> Array:
    """Return displacements (F, 3) that lift a foot over the floor while it steps.

    Arguments as of `held_foot`; the floor lies at the places where the foot stands before and after.
    """
    fixed = np.isfinite(anchors_m[:, 0])
    if not fixed.any():
        return displacement_m
    wanted = toes_m + displacement_m
    ground_m = np.interp(np.arange(len(wanted)), np.flatnonzero(fixed), anchors_m[fixed, 1])
    speeds = np.linalg.norm(np.gradient(wanted[:, [0, 2]], axis=0), axis=1) * fps
    fixed[keyed] = True
    near = np.minimum(distance_transform_edt(~fixed) / (_LIFTED_S * fps), 1.0)
    ease = near**2 * (3.0 - 2.0 * near) * np.minimum(speeds / _STEP_M_S, 1.0)
    lift = ease * np.maximum(ground_m + _CLEAR_M - wanted[:, 1], 0.0)
    result = displacement_m.copy()
    result[:, 1] += np.where(fixed, 0.0, gaussian_filter1d(lift, _LIFTED_S * fps / 3.0))
    return result


def _rolled(ankle_m: Array, toes_m: Array, anchors_m: Array, ease: int) -> Array:
    """Return toes (F, 3) that stay at anchors while the ankle moves above them.

    Args:
        anchors_m: (F, 3), NaN where the foot does not stand.
        ease: frames before and after a stance in which the change comes and goes, at least 1.
    """
    length_m = np.linalg.norm(toes_m - ankle_m, axis=1, keepdims=True)
    way = anchors_m - ankle_m
    stands = np.isfinite(anchors_m[:, 0])
    change = ankle_m + length_m * way / np.linalg.norm(way, axis=1, keepdims=True) - toes_m
    near = binary_dilation(stands, iterations=ease)
    known = np.flatnonzero(stands | ~near)
    change[~stands] = 0.0
    at = np.arange(len(toes_m))
    return toes_m + np.column_stack([np.interp(at, known, axis[known]) for axis in change.T])


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
    at = (keyed - frames[0]).astype(np.int64)
    bent = base_m + curve_positions(keyed, positions_m - base_m[at], frames)
    between = (frames >= keyed[0]) & (frames <= keyed[-1])
    return np.where(between[:, None], bent + follow**2 * (control.curve(frames) - bent), bent)


def _control_sigmas(control: Control, frames: Array, fps: float) -> Array:
    """Return standard deviations (F,) of a control: loose before and after its keys."""
    away_s = np.maximum(np.maximum(control.frames[0] - frames, frames - control.frames[-1]), 0.0) / fps
    loose = np.clip(away_s / _LOOSENED_S, 0.0, 1.0)
    return np.asarray(_KEY_SIGMA_M * (_SWING_SIGMA_M / _KEY_SIGMA_M) ** loose)


def stances_of(standing: Mask, toes_m: Array, keyed: IntArray, ankles_m: Array, fps: float) -> list[tuple[int, int]]:
    """Return [first, stop) of each time that a foot stands in one place.

    The database's motion shows when it stands, and so do keys without a way between them. Keys with one show a step.

    Args:
        standing: (F,) by the database's motion.
        toes_m: (F, 3) wanted without contacts.
        keyed: (K,) frames in which the foot has a key, ascending.
        ankles_m: (K, 3) positions of these keys.
    """
    stands = standing.copy()
    ways_m = np.linalg.norm(np.diff(ankles_m, axis=0), axis=1)
    for first, last, way_m in zip(keyed[:-1], keyed[1:], ways_m, strict=True):
        if way_m < min(_STAYED_M, _STAYED_M_S * (last - first) / fps):
            stands[first : last + 1] = True
        elif stands[first : last + 1].all() and way_m > _STEP_M:
            count = int(np.clip(way_m / _STEP_M_S * fps, 2.0, max(2, last - first - 2)))
            speeds = np.linalg.norm(np.diff(toes_m[first : last + 1], axis=0), axis=1)
            moving = np.convolve(speeds, np.ones(min(count, len(speeds))), mode="valid")
            begin = int(first + np.clip(np.argmax(moving), 1, max(1, last - first - count)))
            stands[begin : begin + count] = False
    shortest = round(_SHORTEST_CONTACT_S * fps)
    return [(first, stop) for first, stop in runs(stands) if stop - first >= shortest]


def held_foot(
    toes_m: Array, displacement_m: Array, stances: list[tuple[int, int]], keyed: IntArray, floor_m: float | None
) -> tuple[Array, Mask, Array]:
    """Return displacements that hold a foot while it stands, and its stances.

    They are (F, 3), (F,) and (F, 3), the places of the toes, NaN where the foot does not stand.

    Args:
        toes_m: (F, 3) where the database's motion has the toes.
        displacement_m: (F, 3) wanted without contacts.
        stances: [first, stop) of each.
        keyed: (K,) frames in which the foot has a key, which binds.
        floor_m: height of standing toes on the floor, for those near it; None to leave them.
    """
    frames = np.arange(len(toes_m), dtype=np.float64)
    known, values = np.zeros(len(toes_m), dtype=np.bool_), displacement_m.copy()
    known[keyed] = True
    stands = np.zeros(len(toes_m), dtype=np.bool_)
    wanted, places = toes_m + displacement_m, np.full_like(toes_m, np.nan)
    for first, stop in stances:
        inside = np.arange(first, stop)
        own = keyed[(keyed >= first) & (keyed < stop)]
        if len(own):
            anchors = np.column_stack([np.interp(inside, own, wanted[own, axis]) for axis in range(3)])
        else:
            anchors = np.repeat(wanted[inside].mean(axis=0)[None], len(inside), axis=0)
            if floor_m is not None and abs(anchors[0, 1] - floor_m) < _FLOOR_M:
                anchors[:, 1] = floor_m
        values[inside], known[inside], stands[inside] = anchors - toes_m[inside], True, True
        places[inside] = anchors.mean(axis=0)
    if not known.any():
        return displacement_m, stands, places
    # what contacts add to the wanted displacement fades between them
    added = curve_positions(frames[known], (values - displacement_m)[known], frames)
    return displacement_m + added, stands, places
