"""Marker takes simulated from motion."""

import numpy as np

from ..body.motion import Motion
from ..body.skeleton import marker_positions
from ..errors import SettingsError
from ..geometry.arrays import Mask
from ..markers.marker_set import MarkerSet
from ..markers.marker_take import MarkerTake
from ..markers.subject import Subject


def simulate_markers(
    motion: Motion, markers: MarkerSet | Subject, noise_mm: float = 0.0, dropout: float = 0.0, seed: int = 0
) -> tuple[MarkerTake, Motion]:
    """Return a take of a motion's true markers with added noise and gaps, and that motion.

    Args:
        motion: Motion of a skeleton with the joints that carry the markers.
        markers: Marker set with offsets, or a subject, whose own bone lengths are not used.
        noise_mm: Standard deviation of Gaussian noise on each coordinate.
        dropout: Share of missing marker positions, in gaps of 0.15 s on average.

    Raises:
        SettingsError: Noise or dropout is out of range.
        MarkerSetError: The set has no offsets.
        SkeletonError: The motion lacks a joint that carries a marker.
    """
    if not (np.isfinite(noise_mm) and noise_mm >= 0.0):
        raise SettingsError(f"marker noise of {noise_mm} mm is out of range", advice="give 0 or more")
    if not 0.0 <= dropout < 1.0:
        raise SettingsError(f"dropout of {dropout} is out of range", advice="give at least 0 and less than 1")
    chosen = markers.marker_set if isinstance(markers, Subject) else markers
    generator = np.random.default_rng(seed)
    positions = marker_positions(
        motion.skeleton, chosen.joint_indices(motion.skeleton), chosen.offsets_m, motion.rotations,
        motion.root_positions_m,
    )  # fmt: skip
    positions = positions + generator.normal(0.0, 1e-3 * noise_mm, positions.shape)
    missing = _gaps(generator, motion.frames, len(chosen), dropout, motion.fps)
    positions[missing] = np.nan
    return MarkerTake(motion.name, motion.fps, chosen.names, positions), motion


def _gaps(generator: np.random.Generator, frames: int, markers: int, dropout: float, fps: float) -> Mask:
    """Return a mask (F, M) of missing markers from a two-state Markov chain; the missing share is `dropout`."""
    come_back = 1.0 / max(0.15 * fps, 1.0)
    get_lost = min(come_back * dropout / (1.0 - dropout), 1.0)
    missing = np.zeros((frames, markers), dtype=bool)
    state = generator.random(markers) < dropout
    for frame, draw in enumerate(generator.random((frames, markers))):
        missing[frame] = state
        state = np.where(state, draw >= come_back, draw < get_lost)
    return missing
