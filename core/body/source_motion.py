"""Motion as stored in a file, with any joint names and any rest pose."""

from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import FormatError, counted
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray, Mask
from .motion import Motion
from .skeleton import joint_leaps, joint_levels


@dataclass(frozen=True)
class SourceMotion:
    """Hierarchy of joints and its motion, metres, y up, with the zero pose in world axes.

    Args:
        names: Joint names (J) as in the file, parents before children.
        parents: Parent indices (J,), -1 for the root.
        offsets_m: Joint origin (J, 3) relative to its parent's in the zero pose.
        tips_m: End of the bone (J, 3) relative to the joint's origin; zero if the file does not say.
        rotations: Parent-from-joint quaternions (F, J, 4); NaN where the file has no number.
        translations_m: Joint index -> positions (F, 3) relative to the parent, for the root and for each joint whose
            position channels move it; other joints stay at their offset.
        euler_orders: Axes of the rotation channels (J) in the file's order, e.g. "ZXY"; "" for a joint without any.
        angle_jumps: Frames (F,) where a rotation channel differs by more than 150 degrees from the previous frame, even
            if the rotation itself does not; by default none.
        notes: Irregularities that the reader tolerated.
    """

    name: str
    where: str
    fps: float
    names: tuple[str, ...]
    parents: IntArray
    offsets_m: Array
    tips_m: Array
    rotations: Array
    translations_m: dict[int, Array]
    euler_orders: tuple[str, ...]
    metres_per_unit: float
    angle_jumps: Mask = field(default_factory=lambda: np.empty(0, dtype=np.bool_))
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        count, frames = len(self.names), len(self.rotations)
        shapes = (self.parents.shape, self.offsets_m.shape, self.tips_m.shape, self.rotations.shape)
        if shapes != ((count,), (count, 3), (count, 3), (frames, count, 4)) or len(self.euler_orders) != count:
            raise FormatError(
                f"arrays and Euler orders do not match {counted(count, 'joint')} (shapes {shapes})",
                where=self.where,
                advice="give one row and one order per joint",
            )
        if len(self.angle_jumps) == 0:
            object.__setattr__(self, "angle_jumps", np.zeros(frames, dtype=np.bool_))
        if frames == 0 or not self.fps > 0.0:
            raise FormatError(
                f"has {counted(frames, 'frame')} at {self.fps:g} Hz, but needs at least one, at a positive rate",
                where=self.where,
                advice="export it again with animation",
            )

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.rotations)

    @property
    def finite_frames(self) -> Mask:
        """Mask (F,) of frames in which no number is missing."""
        finite = np.all(np.isfinite(self.rotations), axis=(1, 2))
        for path in self.translations_m.values():
            finite &= np.all(np.isfinite(path), axis=1)
        return finite


def source_kinematics(source: SourceMotion) -> tuple[Array, Array]:
    """Return positions (F, J, 3) and orientations (F, J, 4) of a file's joints."""
    local = np.tile(source.offsets_m, (source.frames, 1, 1))
    for joint, path in source.translations_m.items():
        local[:, joint] = path
    positions, world = np.empty_like(local), np.empty_like(source.rotations)
    for level in joint_levels(tuple(source.parents.tolist())):
        above = source.parents[level]
        if above[0] < 0:
            positions[:, level], world[:, level] = local[:, level], source.rotations[:, level]
            continue
        turn = world[:, above]
        positions[:, level] = positions[:, above] + rot.rotate(turn, local[:, level])
        world[:, level] = rot.multiply(turn, source.rotations[:, level])
    return positions, world


def source_positions(source: SourceMotion) -> Array:
    """Return positions (F, J, 3) of a file's joints.

    For few frames this is faster than `source_kinematics`.
    """
    frames = np.zeros((*source.rotations.shape[:2], 4, 4))
    frames[..., :3, :3] = rot.to_matrix(source.rotations)
    frames[..., :3, 3] = source.offsets_m
    frames[..., 3, 3] = 1.0
    for joint, path in source.translations_m.items():
        frames[:, joint, :3, 3] = path
    for joints, ancestors in joint_leaps(tuple(source.parents.tolist())):
        frames[:, joints] = frames.take(ancestors, axis=1) @ frames[:, joints]
    return frames[..., :3, 3]


def frame_range(source: SourceMotion, start: int, stop: int) -> SourceMotion:
    """Return frames from `start` up to but not including `stop`."""
    return replace(
        source,
        rotations=source.rotations[start:stop],
        translations_m={joint: path[start:stop] for joint, path in source.translations_m.items()},
        angle_jumps=source.angle_jumps[start:stop],
    )


def every_frame(source: SourceMotion, step: int) -> SourceMotion:
    """Return every `step`-th frame."""
    return replace(
        source,
        rotations=source.rotations[::step],
        translations_m={joint: path[::step] for joint, path in source.translations_m.items()},
        angle_jumps=source.angle_jumps[::step],
    )


def source_of_motion(motion: Motion, where: str) -> SourceMotion:
    """Return a motion on any skeleton as a source motion, for mapping to another skeleton."""
    return SourceMotion(
        name=motion.name,
        where=where,
        fps=motion.fps,
        names=motion.skeleton.names,
        parents=motion.skeleton.parents,
        offsets_m=motion.skeleton.offsets_m,
        tips_m=motion.skeleton.tips_m,
        rotations=motion.rotations,
        translations_m={0: motion.root_positions_m},
        euler_orders=motion.skeleton.angle_orders,
        metres_per_unit=1.0,
    )
