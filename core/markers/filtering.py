"""Low-pass filters for recorded markers and solved motion."""

from dataclasses import replace
from functools import partial

import numpy as np

from ..body.clock import Clock
from ..body.motion import Motion
from ..body.skeleton import forward_kinematics
from ..errors import SettingsError
from ..geometry import rotations as rot
from ..geometry.arrays import Array, runs
from .marker_set import MarkerSet
from .marker_take import MarkerTake
from .steady_take import take_clock

_ORDER = 2  # run forwards and backwards: fourth order without lag, as is usual for gait (Winter 2009, section 3.4)
_BLOCK = 64  # frames filtered at once
_PAD = 3 * (_ORDER + 1)  # frames of odd padding, as in SciPy's filtfilt


def smooth_take(take: MarkerTake, cutoff_hz: float) -> MarkerTake:
    """Low-pass filter a take's trajectories without lag; gaps are kept.

    Every unbroken stretch of a trajectory is filtered separately; stretches too short for the filter are unchanged.

    Args:
        take: Take; its frames may be uneven in time.
        cutoff_hz: Frequency at which half the power remains; 6 Hz or more preserve the shape of walking.

    Raises:
        SettingsError: The frequency is not between 0 and half the frame rate.
    """
    clock = take_clock(take)
    weights = _low_pass(cutoff_hz, clock.fps, take.name)
    positions = take.positions_m.copy()
    for marker, visible in enumerate(take.visible.T):
        for start, stop in runs(visible):
            stretch = positions[start:stop, marker]
            positions[start:stop, marker] = clock.part(start, stop).filtered(stretch, partial(_filter, weights))
    return replace(take, positions_m=positions)


def smooth_motion(motion: Motion, cutoff_hz: float) -> Motion:
    """Return the motion with joint rotations and root path low-pass filtered without lag.

    Without markers, joints follow the database's examples, which change from frame to frame, so they jitter. Cut-off
    and errors are those of `smooth_take`.
    """
    weights = _low_pass(cutoff_hz, motion.fps, motion.name)
    rotations = _filter_rotations(weights, motion.rotations)
    return replace(motion, rotations=rotations, root_positions_m=_filter(weights, motion.root_positions_m))


def smooth_poses(clock: Clock, rotations: Array, root_positions_m: Array, cutoff_hz: float) -> tuple[Array, Array]:
    """Return poses (F, J, 4) and (F, 3), low-pass filtered by their times; cut-off and errors as in `smooth_take`."""
    weights = _low_pass(cutoff_hz, clock.fps, "")
    turns = clock.filtered(rotations, partial(_filter_rotations, weights), is_rotation=True)
    return turns, clock.filtered(root_positions_m, partial(_filter, weights))


def smooth_on_body(take: MarkerTake, marker_set: MarkerSet, motion: Motion, cutoff_hz: float) -> MarkerTake:
    """Reduce the noise of a set's markers by means of the solved body.

    The pose is less noisy than single markers, because all markers and the database determine it together. A marker's
    position in the frame of its joint is filtered with a much lower cut-off than motion needs; its trajectory, as the
    joint then carries it, is filtered as in `smooth_take`.

    Args:
        take: Take with the set's marker names; other markers are unchanged.
        motion: Motion solved from the take, in its world, with the same frames.
        cutoff_hz: Cut-off for the trajectory; that for the position on the body is a fifth of this. Errors are those of
            `smooth_take`.
    """
    joints, turns = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    worn = [marker for marker in marker_set.markers if marker.name in take.names]
    columns = [take.names.index(marker.name) for marker in worn]
    carriers = [motion.skeleton.index(marker.joint) for marker in worn]
    joints, turns = joints[:, carriers], turns[:, carriers]
    names = tuple(marker.name for marker in worn)
    places = rot.rotate(rot.conjugate(turns), take.positions_m[:, columns] - joints)
    still = smooth_take(replace(take, names=names, positions_m=places, single=None), 0.2 * cutoff_hz)
    carried = replace(still, positions_m=joints + rot.rotate(turns, still.positions_m))
    positions = take.positions_m.copy()
    positions[:, columns] = smooth_take(carried, cutoff_hz).positions_m
    return replace(take, positions_m=positions)


def _low_pass(cutoff_hz: float, fps: float, name: str) -> Array | None:
    """Return the weights (2, 3) of a Butterworth filter's inputs and outputs, newest first; None if none is needed."""
    if not 0.0 < cutoff_hz < 0.5 * fps:
        raise SettingsError(
            f"a cut-off frequency of {cutoff_hz:g} Hz for smoothing is out of range",
            where=name,
            advice=f"give a frequency above 0 and below half the frame rate, {0.5 * fps:.3g} Hz",
        )
    # two passes narrow the band, so each pass gets a higher cut-off to compensate
    single_pass = cutoff_hz / (np.sqrt(2.0) - 1.0) ** (0.5 / _ORDER)
    if single_pass >= 0.5 * fps:
        return None
    # by the bilinear transform (Oppenheim and Schafer 2009, section 7.2.2)
    slope = np.tan(np.pi * single_pass / fps)
    square, damping = slope * slope, np.sqrt(2.0) * slope
    inputs = [square, 2.0 * square, square]
    outputs = [square + damping + 1.0, 2.0 * (square - 1.0), square - damping + 1.0]
    return np.array([inputs, outputs]) / outputs[0]


def _filter(weights: Array | None, path: Array) -> Array:
    """Filter rows (F, ...) forwards and backwards; if there are too few, return them unchanged."""
    if weights is None or len(path) <= _PAD:
        return path
    rows = path.reshape(len(path), -1)
    before, after = 2.0 * rows[0] - rows[_PAD:0:-1], 2.0 * rows[-1] - rows[-2 : -_PAD - 2 : -1]
    extended = np.concatenate((before, rows, after))
    for _ in range(2):
        extended = _pass(weights, extended)[::-1]
    return extended[_PAD:-_PAD].reshape(path.shape)


def _filter_rotations(weights: Array | None, rotations: Array) -> Array:
    return rot.normalize(_filter(weights, rot.continuous(rotations)))


def _pass(weights: Array, rows: Array) -> Array:
    """Filter rows (F, N) forwards, starting from the steady state for the first row."""
    inputs, outputs = weights
    rise = rows - rows[0]
    driven = inputs[0] * rise
    driven[1:] += inputs[1] * rise[:-1]
    driven[2:] += inputs[2] * rise[:-2]
    # in blocks: a product with a matrix does at once what is defined row by row
    response = np.linalg.inv(sum(weight * np.eye(_BLOCK, k=-lag) for lag, weight in enumerate(outputs)))
    for start in range(0, len(rows), _BLOCK):
        block = driven[start : start + _BLOCK]
        for lag in range(1, _ORDER + 1) if start else ():
            block[:lag] -= outputs[lag] * driven[start - lag : start][: len(block)]
        block[:] = response[: len(block), : len(block)] @ block
    return np.asarray(driven + rows[0])
