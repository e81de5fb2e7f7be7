"""A whole marker take solved to a motion."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..body.motion import Motion
from ..body.scene_pose import PerformerPose
from ..database.store import Database
from ..errors import TakeError
from ..formats.take_file.reading import TakeFile
from ..geometry import rotations as rot
from ..geometry.camera import CameraRig
from ..markers.frame_rate import frame_rate
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_take import MarkerTake
from ..markers.prop import Prop
from ..markers.subject import Subject
from ..markers.take_frames import take_frames
from ..solver.settings import SolveSettings
from .multi_target_session import Stepper, followed
from .session import Session

SessionMaker = Callable[[Subject, Database, CameraRig | None, SolveSettings], Session]

_REPORT_EVERY = 30  # frames between two signs of progress


@dataclass(frozen=True)
class SolvedTake:
    """A take's poses.

    Args:
        poses: one a frame.
        motion: the same as a motion.
        seconds: (F,) time that each frame took.
        others: motions of the further performers, in their order.
    """

    poses: tuple[PerformerPose, ...]
    motion: Motion
    seconds: NDArray[np.float64]
    others: tuple[Motion, ...] = ()

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
    sessions: SessionMaker = Session,
) -> SolvedTake:
    """Solve every frame of a labelled take in order, with what single cameras show where the take has it.

    `sessions` gives a session that has seen nothing yet (see `solver_store`).
    """
    session = sessions(subject, database, take.single.rig if take.single is not None else None, settings)
    frames = list(take_frames(take, subject.marker_set))
    poses, seconds = _solved(frames, session, f"solving {take.name}", progress)
    return SolvedTake(tuple(poses), motion_of(poses, subject, take.name, take.fps), seconds)


def solve_recorded(
    take: TakeFile,
    frames: Sequence[MarkerFrame],
    rig: CameraRig | None,
    subject: Subject,
    database: Database,
    settings: SolveSettings,
    progress: Callable[[float, str], None],
    sessions: SessionMaker = Session,
    props: Sequence[Prop] = (),
    performers: Sequence[Subject] = (),
) -> SolvedTake:
    """Solve a recorded take as it was solved live; the motion is the recorded part, without a countdown.

    Args:
        take: what was recorded.
        frames: its marker frames, or others made of its 2D detections.
        rig: the cameras that see them, None for imported markers without any.
        sessions: as of `solve_take`.
        props, performers: that are followed as well.

    Raises:
        TakeError: there are not two frames.
    """
    others = [Session(other, database, rig, settings) for other in performers]
    session = followed([sessions(subject, database, rig, settings), *others], props)
    name = take.notes.name
    poses, seconds = _solved(frames, session, f"solving {name}", progress)
    recorded = [pose for pose in poses if take.is_recorded(pose.number)]
    motions = [
        resample_uniform(own, worn, name, str(take.path))
        for own, worn in zip(by_performer(recorded), (subject, *performers), strict=True)
    ]
    return SolvedTake(tuple(poses), motions[0], seconds, tuple(motions[1:]))


def by_performer(poses: Sequence[PerformerPose]) -> list[list[PerformerPose]]:
    """Return the poses of the first performer, of the second, and so on."""
    others = [list(row) for row in zip(*(pose.others for pose in poses), strict=True)]
    return [list(poses), *others]


def _solved(
    frames: Sequence[MarkerFrame], session: Stepper, activity: str, progress: Callable[[float, str], None]
) -> tuple[list[PerformerPose], NDArray[np.float64]]:
    """Return the poses of frames in order, and the time (F,) that each took."""
    poses, seconds = [], []
    for i, frame in enumerate(frames):
        if i % _REPORT_EVERY == 0:
            progress(i / len(frames), activity)
        start = time.perf_counter()
        poses.append(session.step(frame))
        seconds.append(time.perf_counter() - start)
    return poses, np.array(seconds)


def resample_uniform(poses: Sequence[PerformerPose], subject: Subject, name: str, where: str) -> Motion:
    """Return recorded poses as a motion: one frame a number, those that were lost on the way between their neighbours.

    Raises:
        TakeError: there are not two poses, or their numbers do not ascend.
    """
    numbers = np.array([pose.number for pose in poses])
    if len(numbers) < 2 or np.any(np.diff(numbers) < 1):
        raise TakeError(f"has {len(numbers)} poses that make no motion", where=where, advice="record a longer take")
    fps = frame_rate(np.array([pose.time_s for pose in poses]), numbers)
    motion = motion_of(poses, subject, name, fps)
    wanted = np.arange(numbers[0], numbers[-1] + 1)
    if len(wanted) == len(numbers):
        return motion
    after = np.maximum(np.searchsorted(numbers, wanted), 1)
    before = after - 1
    share = ((wanted - numbers[before]) / (numbers[after] - numbers[before]))[:, None]
    rotations, positions = motion.rotations, motion.root_positions_m
    return replace(
        motion,
        rotations=rot.slerp(
            rotations[before], rotations[after], np.broadcast_to(share, (len(wanted), len(rotations[0])))
        ),
        root_positions_m=positions[before] + share * (positions[after] - positions[before]),
    )


def motion_of(poses: Sequence[PerformerPose], subject: Subject, name: str, fps: float) -> Motion:
    """Return pose frames of steady rate as a motion of the subject's skeleton."""
    return Motion(
        name,
        fps,
        subject.skeleton,
        np.array([pose.rotations for pose in poses]),
        np.array([pose.root_position_m for pose in poses]),
    )
