"""Motion between the keys, drawn from the chosen windows of the database.

Each window's motion is corrected by its neighbours: a ridge regression over windows near it gives the change of poses
with the controls' places. Windows are then blended where stretches meet.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array
from .motion_library import BODY, MotionLibrary
from .retrieval import CONTEXT_S, Looks, Stretch, Windows, shown_at

_CLOSEST = 32  # windows of the regression
_SIGMA_M = 0.05  # distance at a control that counts as one
_FARTHEST = 4.0  # such distances, to which it is trusted
_FRAMES = 5  # of a window at which bodies are compared


@dataclass(frozen=True)
class BaseMotion:
    """Motion drawn from the database.

    Args:
        poses: (F, 28, 3); root_rotations: (F, 4); root_positions_m: (F, 3).
        standing: (F, 2) share with which left and right toes stand.
        drawn_from: names of the clips, in order of time.
    """

    poses: Array
    root_rotations: Array
    root_positions_m: Array
    standing: Array
    drawn_from: tuple[str, ...]

    def turned(self, rotation: Array) -> "BaseMotion":
        """Return the motion turned in the world by a quaternion (4,)."""
        turns, places = rot.multiply(rotation, self.root_rotations), rot.rotate(rotation, self.root_positions_m)
        return replace(self, root_rotations=turns, root_positions_m=places)


def window_motion(library: MotionLibrary, windows: Windows, index: int, times_s: Array) -> BaseMotion:
    """Return the motion of a placed window at times (T,) since its stretch's first."""
    frames = windows.starts[index] + times_s * windows.rates[index] * library.fps
    poses, turns, places = library.poses_at(frames)
    yaw = float(np.angle(windows.turns[index]))
    planar = windows.turns[index] * (places[:, 2] + 1j * places[:, 0]) + windows.shifts[index]
    placed = np.column_stack((planar.imag, places[:, 1], planar.real))
    turned = rot.multiply(rot.from_rotation_vector(np.array([0.0, yaw, 0.0])), turns)
    nearest = np.round(frames).astype(np.int64)
    return BaseMotion(
        poses, turned, placed, library.contacts[nearest].astype(np.float64), (library.clip_of(frames[0]).name,)
    )


def blended(
    library: MotionLibrary, looks: Looks, picks: Sequence[tuple[Stretch, Windows, int]], times_s: Array
) -> BaseMotion:
    """Return the motion of all stretches at times (F,), blended where they meet.

    Args:
        picks: stretches in order, each with its windows and the chosen one.
    """
    count = len(times_s)
    poses = np.zeros((count, *library.database.poses.shape[1:]))
    turns, places, standing, total = (np.zeros((count, size)) for size in (4, 3, 2, 1))
    for stretch, windows, index in picks:
        inside = np.flatnonzero((times_s >= stretch.before_s - 1e-9) & (times_s <= stretch.after_s + 1e-9))
        part = corrected(library, looks, stretch, windows, index, times_s[inside])
        weights = _weights(stretch, times_s[inside], float(times_s[-1]))[:, None]
        # of the two quaternions of a rotation the one near those before
        same = np.where(np.sum(part.root_rotations * turns[inside], axis=1, keepdims=True) < 0.0, -1.0, 1.0)
        poses[inside] += weights[:, :, None] * part.poses
        turns[inside] += weights * same * part.root_rotations
        places[inside] += weights * part.root_positions_m
        standing[inside] += weights * part.standing
        total[inside] += weights
    names = dict.fromkeys(library.clip_of(windows.starts[index]).name for _, windows, index in picks)
    return BaseMotion(poses / total[:, :, None], rot.normalize(turns), places / total, standing / total, tuple(names))


def _weights(stretch: Stretch, times_s: Array, end_s: float) -> Array:
    """Return the weights (T,) of a window: falling beyond its joins, never quite zero."""
    left = np.ones(len(times_s)) if stretch.first_s <= 1e-9 else (times_s - stretch.before_s) / (2.0 * CONTEXT_S)
    right = np.ones(len(times_s)) if stretch.last_s >= end_s - 1e-9 else (stretch.after_s - times_s) / (2.0 * CONTEXT_S)
    f = np.clip(np.minimum(left, right), 0.0, 1.0)
    return np.asarray(f * f * (3.0 - 2.0 * f) + 1e-6)


def corrected(
    library: MotionLibrary, looks: Looks, stretch: Stretch, windows: Windows, index: int, times_s: Array
) -> BaseMotion:
    """Return the motion of a window as its neighbours would meet the controls."""
    relative_s = times_s - stretch.first_s
    own = window_motion(library, windows, index, relative_s)
    near = looks.between(stretch.before_s, stretch.after_s)
    if len(windows.starts) < 8 or not len(near.times_s):
        return own
    moments = np.repeat(np.linspace(relative_s[0], relative_s[-1], _FRAMES), len(BODY))
    bodies = shown_at(library, windows, moments, np.tile([library.columns[name] for name in BODY], _FRAMES))
    away = np.mean((bodies - bodies[index]) ** 2, axis=1) * 3.0
    picked = np.argsort(away + windows.costs, kind="stable")[:_CLOSEST]
    distances = (away + windows.costs)[picked]
    weights = np.exp(-0.5 * distances / (np.median(distances) + 1e-9))
    weights /= weights.sum()
    parts = [window_motion(library, windows, int(at), relative_s) for at in picked]
    shown = shown_at(library, windows.picked(picked), near.times_s - stretch.first_s, near.columns)
    goals = np.concatenate((near.planar.real, near.planar.imag, near.heights_m))
    sizes = np.sqrt(np.tile(near.weights, 3)) / _SIGMA_M
    # outputs relative to the window's own
    turns = np.array(
        [rot.to_rotation_vector(rot.multiply(rot.conjugate(own.root_rotations), p.root_rotations)) for p in parts]
    )
    outputs = np.concatenate(
        (
            np.array([p.poses - own.poses for p in parts]).reshape(len(parts), -1),
            turns.reshape(len(parts), -1),
            np.array([p.root_positions_m - own.root_positions_m for p in parts]).reshape(len(parts), -1),
        ),
        axis=1,
    )
    change = _ridge(shown * sizes, outputs, weights, goals * sizes)
    count = len(times_s)
    pose, turn, place = np.split(change, [own.poses.size, own.poses.size + 3 * count])
    return BaseMotion(
        own.poses + pose.reshape(own.poses.shape),
        rot.multiply(own.root_rotations, rot.from_rotation_vector(turn.reshape(count, 3))),
        own.root_positions_m + place.reshape(count, 3),
        own.standing,
        own.drawn_from,
    )


def _ridge(inputs: Array, outputs: Array, weights: Array, goal: Array) -> Array:
    """Return the outputs expected at a goal, by weighted ridge regression."""
    middle, mean = weights @ inputs, weights @ outputs
    roots = np.sqrt(weights)[:, None]
    x, y = roots * (inputs - middle), roots * (outputs - mean)
    gram = x @ x.T + np.eye(len(x))
    away = np.clip(goal - middle, -_FARTHEST, _FARTHEST)
    return np.asarray(mean + (x @ away) @ np.linalg.solve(gram, y))
