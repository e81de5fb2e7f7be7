"""A whole marker take solved to a motion."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .database.store import Database
from .marker_set import Subject
from .marker_take import MarkerTake
from .motion import Motion
from .pose_frame import PoseFrame
from .session import Session
from .solver.settings import SolveSettings
from .sources.take import take_frames

_REPORT_EVERY = 30  # frames between two signs of progress


@dataclass(frozen=True)
class SolvedTake:
    """A take's poses.

    Args:
        poses: one a frame.
        motion: the same as a motion.
        seconds: (F,) time that each frame took.
    """

    poses: tuple[PoseFrame, ...]
    motion: Motion
    seconds: NDArray[np.float64]

    def summary(self) -> dict[str, float | int]:
        """Return the figures of the `solve` command."""
        rms = np.array([pose.marker_rms_m for pose in self.poses])
        return {
            "frames": len(self.poses),
            "marker_rms_mm": 1e3 * float(np.sqrt(np.nanmean(rms**2))) if np.isfinite(rms).any() else float("nan"),
            "ms_per_frame_median": 1e3 * float(np.median(self.seconds)),
            "ms_per_frame_p99": 1e3 * float(np.percentile(self.seconds, 99)),
            "confidence": float(np.mean([pose.confidence for pose in self.poses])),
        }


def solve_take(
    take: MarkerTake,
    subject: Subject,
    database: Database,
    settings: SolveSettings,
    progress: Callable[[float, str], None],
) -> SolvedTake:
    """Solve every frame of a labelled take in order, with what single cameras show where the take has it."""
    frames = take_frames(take, subject.marker_set)
    session = Session(subject, database, take.single.rig if take.single is not None else None, settings)
    poses, seconds = [], []
    for i, frame in enumerate(frames):
        if i % _REPORT_EVERY == 0:
            progress(i / take.frames, f"solving {take.name}")
        start = time.perf_counter()
        poses.append(session.step(frame))
        seconds.append(time.perf_counter() - start)
    return SolvedTake(tuple(poses), motion_of(poses, subject, take.name, take.fps), np.array(seconds))


def motion_of(poses: list[PoseFrame], subject: Subject, name: str, fps: float) -> Motion:
    """Return pose frames of steady rate as a motion of the subject's skeleton."""
    return Motion(
        name,
        fps,
        subject.skeleton,
        np.array([pose.rotations for pose in poses]),
        np.array([pose.root_position_m for pose in poses]),
    )
