"""Keypoints as networks find them: near the joints, with errors that persist for several frames."""

from dataclasses import dataclass, replace

import numpy as np

from ..body.motion import Motion
from ..geometry.arrays import Array
from ..markers.marker_set import MarkerSet
from ..markers.marker_take import MarkerTake
from .simulated_markers import simulate_markers


@dataclass(frozen=True)
class KeypointErrors:
    """Errors of keypoints; standard deviations are per coordinate."""

    # smallest and largest constant offset of a keypoint, which differs from person to person
    own_m: tuple[float, float] = (0.01, 0.03)
    slow_m: float = 0.025  # standard deviation of the slow errors
    slow_s: tuple[float, float] = (0.2, 0.5)  # smallest and largest time constant of the slow errors
    fast_m: float = 0.006  # standard deviation of the noise that is independent in every frame


USUAL = KeypointErrors()


def simulate_keypoints(
    motion: Motion, keypoints: MarkerSet, seed: int = 0, errors: KeypointErrors = USUAL
) -> MarkerTake:
    """Return the keypoints of a motion, with the constant offsets of a random person and with random errors.

    Args:
        keypoints: Set of keypoints with the offsets of an average person.
        seed: Seed of the offsets and errors.
    """
    random = np.random.default_rng(seed)
    count = len(keypoints)
    own = own_offsets(count, random, errors)
    take, _ = simulate_markers(motion, keypoints.with_offsets(keypoints.offsets_m + own))
    positions_m = take.positions_m + keypoint_errors(motion.frames, count, motion.fps, random, errors)
    return replace(take, positions_m=positions_m)


def own_offsets(count: int, random: np.random.Generator, errors: KeypointErrors = USUAL) -> Array:
    """Return the constant offsets (count, 3) of a random person's keypoints."""
    own = random.normal(size=(count, 3))
    return np.asarray(own * random.uniform(*errors.own_m, (count, 1)) / np.linalg.norm(own, axis=1, keepdims=True))


def keypoint_errors(
    frames: int, count: int, fps: float, random: np.random.Generator, errors: KeypointErrors = USUAL
) -> Array:
    """Return the random errors (frames, count, 3) of keypoints: slow ones, and those of each frame."""
    # the slow errors are Ornstein-Uhlenbeck processes
    keep = np.exp(-1.0 / (fps * random.uniform(*errors.slow_s, (count, 1))))
    slow = random.normal(size=(frames, count, 3))
    for frame in range(1, frames):
        slow[frame] = keep * slow[frame - 1] + np.sqrt(1.0 - keep**2) * slow[frame]
    fast = random.normal(0.0, errors.fast_m, slow.shape)
    return np.asarray(errors.slow_m * slow + fast)
