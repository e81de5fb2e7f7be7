"""Ghost of the last take: its skeletons, drawn in time while the next take is acted."""

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np

from ...core.body.scene_pose import ScenePose
from ...core.body.skeleton import Skeleton, forward_kinematics
from ...core.geometry.arrays import Array, FloatArray


@dataclass(frozen=True)
class Ghost:
    """Skeletons of a take in the capture space.

    Args:
        times_s: Time (F,) of each pose since the first.
        bodies: Skeleton and joint positions (F, J, 3) of each performer.
    """

    times_s: Array
    bodies: tuple[tuple[Skeleton, FloatArray], ...]

    @classmethod
    def of(cls, skeletons: Sequence[Skeleton], poses: Sequence[ScenePose]) -> "Ghost":
        """Return the ghost of a take's poses, at least one."""
        times_s = np.array([pose.time_s for pose in poses]) - poses[0].time_s
        bodies = []
        for index, skeleton in enumerate(skeletons):
            own = [pose.performers[index] for pose in poses]
            joints_m = [forward_kinematics(skeleton, each.rotations, each.root_position_m)[0] for each in own]
            bodies.append((skeleton, np.array(joints_m, dtype=np.float32)))
        return cls(times_s, tuple(bodies))

    def at(self, elapsed_s: float) -> list[tuple[Skeleton, FloatArray]]:
        """Return each skeleton with its joints (J, 3) at a time of the take; none after its end."""
        if elapsed_s > self.times_s[-1]:
            return []
        frame = int(np.searchsorted(self.times_s, elapsed_s))
        return [(skeleton, joints_m[frame]) for skeleton, joints_m in self.bodies]


_last: list[Ghost] = []  # at most one


def last() -> Ghost | None:
    """Return the ghost of the last take recorded in this file, or None."""
    return _last[0] if _last else None


def remember(taken: Ghost) -> None:
    """Keep the ghost of the last take until another file is loaded."""
    _last[:] = [taken]


@bpy.app.handlers.persistent
def _forget(*_: object) -> None:
    _last.clear()


def register() -> None:
    """Forget the ghost when another file is loaded."""
    bpy.app.handlers.load_post.append(_forget)


def unregister() -> None:
    """Forget the ghost, and remove the handler."""
    _forget()
    bpy.app.handlers.load_post.remove(_forget)
