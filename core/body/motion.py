"""Full-body motion: joint rotations and root positions at a steady rate."""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import FormatError
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray
from .skeleton import Skeleton

LEAST_FPS, MOST_FPS = 1.0, 2000.0  # lowest and highest frame rate of motion and markers in files
_FARTHEST_M = 1e4  # largest coordinate of the root
_LEAST_SQUARE, _MOST_SQUARE = 0.998, 1.002  # limits of the squared length of a unit quaternion after rounding in a file


@dataclass(frozen=True)
class Motion:
    """Poses of one skeleton.

    Args:
        fps: Frames per second, 1 to 2,000.
        rotations: Parent-from-joint quaternions (F, J, 4) relative to rest; the root's is world-from-root.
        root_positions_m: World positions (F, 3) of the root, metres, up to ten kilometres from the origin.
        notes: Messages from the reader.

    Raises:
        FormatError: An array has a wrong shape, a number is out of range or not finite, or a rotation is not a unit
            quaternion.
    """

    name: str
    fps: float
    skeleton: Skeleton
    rotations: Array
    root_positions_m: Array
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotations", np.asarray(self.rotations, dtype=np.float64))
        object.__setattr__(self, "root_positions_m", np.asarray(self.root_positions_m, dtype=np.float64))
        frames = len(self.rotations)
        shapes = (self.rotations.shape, self.root_positions_m.shape)
        if frames == 0 or shapes != ((frames, len(self.skeleton), 4), (frames, 3)):
            raise FormatError(
                f"a motion of {len(self.skeleton)} joints cannot have arrays of shapes {shapes}",
                where=self.name,
                advice="give at least one frame, with a rotation for each joint and a root position",
            )
        if not LEAST_FPS <= self.fps <= MOST_FPS:
            raise FormatError(
                f"frame rate {self.fps:g} is not {LEAST_FPS:g} to {MOST_FPS:g} Hz",
                where=self.name,
                advice="correct the frame rate",
            )
        squares = np.einsum("fji,fji->fj", self.rotations, self.rotations)
        if not (squares.min() > _LEAST_SQUARE and squares.max() < _MOST_SQUARE):  # false for NaN, too
            raise FormatError(
                "a joint's rotation is not a unit quaternion", where=self.name, advice="normalise the rotations"
            )
        if not max(self.root_positions_m.max(), -self.root_positions_m.min()) < _FARTHEST_M:
            raise FormatError(
                f"the root is more than {_FARTHEST_M:g} m from the origin",
                where=self.name,
                advice="check the unit of length",
            )

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.rotations)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last frame, seconds."""
        return (self.frames - 1) / self.fps


def sliced(motion: Motion, start: int, stop: int) -> Motion:
    """Return frames from `start` up to but not including `stop`."""
    if (start, stop) == (0, motion.frames):
        return motion
    return replace(motion, rotations=motion.rotations[start:stop], root_positions_m=motion.root_positions_m[start:stop])


def every_nth(motion: Motion, step: int) -> Motion:
    """Return the first frame and every `step`-th after it, at the frame rate divided by `step`."""
    rotations, root_positions_m = motion.rotations[::step], motion.root_positions_m[::step]
    return replace(motion, fps=motion.fps / step, rotations=rotations, root_positions_m=root_positions_m)


def resampled(motion: Motion, fps: float) -> Motion:
    """Return the motion at another rate, interpolated between frames."""
    if motion.fps == fps or motion.frames == 1:
        return replace(motion, fps=fps)
    count = int(np.floor(motion.duration_s * fps + 1e-6)) + 1
    at = np.minimum(np.arange(count) * (motion.fps / fps), motion.frames - 1)
    before = np.minimum(at.astype(np.int64), motion.frames - 2)
    fraction = at - before
    positions = motion.root_positions_m
    return replace(
        motion,
        fps=fps,
        rotations=_between_frames(motion.rotations, before, fraction),
        root_positions_m=positions[before] + fraction[:, None] * (positions[before + 1] - positions[before]),
    )


def with_lead_in(motion: Motion, frames: int) -> Motion:
    """Return the motion preceded by some frames that hold its first pose."""
    shown = np.concatenate((np.zeros(frames, dtype=np.int64), np.arange(motion.frames)))
    return replace(motion, rotations=motion.rotations[shown], root_positions_m=motion.root_positions_m[shown])


def _between_frames(rotations: Array, before: IntArray, fraction: Array) -> Array:
    # at a simple ratio of rates, many frames coincide with recorded ones, which are copied
    nearest = np.round(fraction)
    result = rotations[before + nearest.astype(np.int64)]
    apart = np.flatnonzero(fraction != nearest)
    if len(apart):
        start = before[apart]
        result[apart] = rot.slerp(rotations[start], rotations[start + 1], fraction[apart, None])
    return result


def eased_between(start: tuple[Array, Array], end: tuple[Array, Array], frames: int) -> tuple[Array, Array]:
    """Return rotations and root positions of a smooth transition between two poses.

    Args:
        start, end: Rotations (J, 4) and root position (3,), neither of which is part of the result.
        frames: Number of frames from start to end.
    """
    f = np.arange(1, frames) / frames
    ease = (f * f * (3.0 - 2.0 * f))[:, None]
    return rot.slerp(start[0], end[0], ease), start[1] + ease * (end[1] - start[1])
