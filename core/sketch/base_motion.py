"""Motion between the keys, composed of the chosen windows of the database.

Each window's motion is corrected by a ridge regression over similar windows, which relates changes of the poses to the
controls' positions. All windows together decide when a keyed foot is planted, weighted by how near the window's foot is
to the keys, because a single window often steps at another time. Windows are then blended where stretches meet.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array
from .motion_library import BODY, MotionLibrary
from .retrieval import SETTINGS as RETRIEVAL
from .retrieval import Samples, Stretch, Windows, shown_at


@dataclass(frozen=True)
class BaseMotionSettings:
    """Settings of the regression, and of the weights with which windows decide when a foot is planted."""

    closest: int = 32  # number of windows in the regression
    sigma_m: float = 0.05  # standard deviation of a control's position
    farthest: float = 4.0  # largest distance for which the regression is trusted, in standard deviations
    frames: int = 5  # number of frames of a window at which bodies are compared
    foot_sigma_m: float = 0.06  # standard deviation of a foot's position at its keys
    root_weight: float = 0.6  # weight of the root relative to the foot itself
    other_foot_weight: float = 0.4  # weight of the other foot relative to the foot itself
    height_scale: float = 3.0  # factor of height errors, because heights show more reliably whether a foot is planted


SETTINGS = BaseMotionSettings()


@dataclass(frozen=True)
class BaseMotion:
    """Motion composed from the database.

    Args:
        poses: Rotation vectors (F, 28, 3).
        root_rotations: Quaternions (F, 4).
        root_positions_m: Positions (F, 3).
        standing: Fractions (F, 2) of the examples in which the left and the right toes are planted.
        drawn_from: Names of the clips used, in order of time.
    """

    poses: Array
    root_rotations: Array
    root_positions_m: Array
    standing: Array
    drawn_from: tuple[str, ...]

    def turned(self, rotation: Array) -> "BaseMotion":
        """Return the motion turned about the world's origin by a quaternion (4,)."""
        turns, places = rot.multiply(rotation, self.root_rotations), rot.rotate(rotation, self.root_positions_m)
        return replace(self, root_rotations=turns, root_positions_m=places)


def window_motions(library: MotionLibrary, windows: Windows, times_s: Array) -> tuple[Array, Array, Array]:
    """Return poses (K, T, 28, 3), root rotations (K, T, 4) and root positions (K, T, 3) of placed windows.

    Args:
        times_s: Times (T,) since the start of the stretch.
    """
    frames = _frames_of(library, windows, times_s)
    poses, turns, places = (part.reshape(*frames.shape, *part.shape[1:]) for part in library.poses_at(frames.ravel()))
    yaws = np.zeros((*windows.turns.shape, 1, 3))
    yaws[:, 0, 1] = np.angle(windows.turns)
    planar = windows.turns[:, None] * (places[..., 2] + 1j * places[..., 0]) + windows.shifts[:, None]
    placed = np.stack((planar.imag, places[..., 1], planar.real), axis=-1)
    return poses, rot.multiply(rot.from_rotation_vector(yaws), turns), placed


def _frames_of(library: MotionLibrary, windows: Windows, times_s: Array) -> Array:
    """Return the fractional database frames (K, T) of the windows at times (T,)."""
    return np.asarray(windows.starts[:, None] + times_s * windows.rates[:, None] * library.fps)


def blended(parts: Sequence[tuple[Stretch, BaseMotion]], times_s: Array) -> BaseMotion:
    """Return the motion of all stretches at times (F,), blended where they meet.

    Args:
        parts: Stretches in order, each with its motion at the times that it covers.
    """
    count = len(times_s)
    poses = np.zeros((count, *parts[0][1].poses.shape[1:]))
    turns, places, standing, total = (np.zeros((count, size)) for size in (4, 3, 2, 1))
    for stretch, part in parts:
        inside = np.flatnonzero(stretch.shows(times_s))
        weights = _weights(stretch, times_s[inside], float(times_s[-1]))[:, None]
        # q and -q are the same rotation: add the one nearer to the sum so far
        same = np.where(np.sum(part.root_rotations * turns[inside], axis=1, keepdims=True) < 0.0, -1.0, 1.0)
        poses[inside] += weights[:, :, None] * part.poses
        turns[inside] += weights * same * part.root_rotations
        places[inside] += weights * part.root_positions_m
        standing[inside] += weights * part.standing
        total[inside] += weights
    names = dict.fromkeys(name for _, part in parts for name in part.drawn_from)
    return BaseMotion(poses / total[:, :, None], rot.normalize(turns), places / total, standing / total, tuple(names))


def _weights(stretch: Stretch, times_s: Array, end_s: float) -> Array:
    """Return the weights (T,) of a window, which fade out around its joins, but not to zero."""
    f, fade_s = np.ones(len(times_s)), 2.0 * RETRIEVAL.context_s
    if stretch.first_s > 1e-9:
        f = np.minimum(f, (times_s - stretch.before_s) / fade_s)
    if stretch.last_s < end_s - 1e-9:
        f = np.minimum(f, (stretch.after_s - times_s) / fade_s)
    f = np.maximum(f, 0.0)
    return np.asarray(f * f * (3.0 - 2.0 * f) + 1e-6)


def corrected(
    library: MotionLibrary, near: Samples, stretch: Stretch, windows: Windows, index: int, times_s: Array
) -> BaseMotion:
    """Return the motion of a window, changed by regression over similar windows so that it meets the controls.

    Args:
        near: Samples within the stretch and its context.
        times_s: Times (T,) that the stretch covers.
    """
    relative_s = times_s - stretch.first_s
    own = windows.picked(np.array([index]))
    poses, turns, places = (part[0] for part in window_motions(library, own, relative_s))
    shown = np.round(_frames_of(library, own, relative_s)[0]).astype(np.int64)
    standing, names = library.contacts[shown].astype(np.float64), (library.clip_of(own.starts[0]).name,)
    frames = np.round(_frames_of(library, windows, relative_s)).astype(np.int64)
    for foot in range(2):
        weights = _foot_weights(library, near, stretch, windows, foot)
        if weights is not None:
            standing[:, foot] = weights @ library.still_toes[frames, foot]
    if len(windows.starts) < 8 or not len(near.times_s):
        return BaseMotion(poses, turns, places, standing, names)
    moments = np.repeat(np.linspace(relative_s[0], relative_s[-1], SETTINGS.frames), len(BODY))
    bodies = shown_at(library, windows, moments, np.tile([library.columns[name] for name in BODY], SETTINGS.frames))
    away = np.mean((bodies - bodies[index]) ** 2, axis=1) * 3.0
    picked = np.argsort(away + windows.costs, kind="stable")[: SETTINGS.closest]
    distances = (away + windows.costs)[picked]
    weights = np.exp(-0.5 * distances / (np.median(distances) + 1e-9))
    weights /= weights.sum()
    closest = windows.picked(picked)
    others = window_motions(library, closest, relative_s)
    # targets of the regression: motions of the similar windows relative to this window's
    changes = (
        others[0] - poses,
        rot.to_rotation_vector(rot.multiply(rot.conjugate(turns), others[1])),
        others[2] - places,
    )
    outputs = np.concatenate([change.reshape(len(picked), -1) for change in changes], axis=1)
    places_m = shown_at(library, closest, near.times_s - stretch.first_s, near.columns)
    goals = np.concatenate((near.planar.real, near.planar.imag, near.heights_m))
    sizes = np.sqrt(np.tile(near.weights, 3)) / SETTINGS.sigma_m
    change = _ridge(places_m * sizes, outputs, weights, goals * sizes)
    pose, turn, place = np.split(change, np.cumsum([poses.size, 3 * len(times_s)]))
    return BaseMotion(
        poses + pose.reshape(poses.shape),
        rot.multiply(turns, rot.from_rotation_vector(turn.reshape(-1, 3))),
        places + place.reshape(places.shape),
        standing,
        names,
    )


def _foot_weights(library: MotionLibrary, near: Samples, stretch: Stretch, windows: Windows, foot: int) -> Array | None:
    """Return the weights (K,) of windows for a foot (0 left, 1 right), or None if the foot has no keys."""
    own, other = ([library.columns[side + name] for name in ("foot", "toes")] for side in ("lr"[foot], "rl"[foot]))
    importance = np.zeros(len(library.joints))
    importance[own], importance[other] = 1.0, SETTINGS.other_foot_weight
    importance[library.columns["root"]] = SETTINGS.root_weight
    used = (near.weights == 1.0) & (importance[near.columns] > 0.0)
    if not np.isin(near.columns[used], own).any():
        return None
    weights = importance[near.columns[used]]
    weights /= weights.sum()
    shown = shown_at(library, windows, near.times_s[used] - stretch.first_s, near.columns[used])
    across, along, heights_m = np.split(shown, 3, axis=1)
    # each window is turned and moved again, to where the foot fits best
    points, goals = across + 1j * along, near.planar[used]
    points, goals = points - (points @ weights)[:, None], goals - weights @ goals
    off_m2 = (
        np.abs(points) ** 2 @ weights + weights @ np.abs(goals) ** 2 - 2.0 * np.abs((points.conj() * goals) @ weights)
    )
    off_m2 += SETTINGS.height_scale**2 * (heights_m - near.heights_m[used]) ** 2 @ weights
    shares = np.exp(-0.5 * (off_m2 - off_m2.min()) / SETTINGS.foot_sigma_m**2)
    return np.asarray(shares / shares.sum())


def _ridge(inputs: Array, outputs: Array, weights: Array, goal: Array) -> Array:
    """Return outputs at a goal by weighted ridge regression, clipped to the range of the examples."""
    middle, mean = weights @ inputs, weights @ outputs
    roots = np.sqrt(weights)[:, None]
    x, y = roots * (inputs - middle), roots * (outputs - mean)
    gram = x @ x.T + np.eye(len(x))
    away = np.clip(goal - middle, -SETTINGS.farthest, SETTINGS.farthest)
    expected = mean + (x @ away) @ np.linalg.solve(gram, y)
    return np.asarray(np.clip(expected, outputs.min(axis=0), outputs.max(axis=0)))
