"""Marker frames and poses of a take, made up."""

import numpy as np
from perfanim.core.body.scene_pose import PerformerPose, ScenePose
from perfanim.core.formats.take_file.pose_codec import TimedPose, pack_solved
from perfanim.core.formats.take_file.take_reader import TakeFile
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_frame_codec import pack_stamped

MARKERS = 9


def frame_record(number: int) -> bytes:
    """A marker frame with points, rays and blobs that were moved in one camera."""
    rng = np.random.default_rng(number)
    left, right = (rng.normal(size=(MARKERS, 5)).astype(np.float32) for _ in range(2))
    frame = MarkerFrame(
        number,
        number / 60,
        rng.normal(size=(3, 3)),
        rng.normal(size=(3, 3, 3)),
        blobs=(left, right),
        detected=(left, right + np.float32(0.5)),
        point_blobs=rng.integers(0, MARKERS, (3, 2)),
        single_cameras=np.array([1]),
        single_blobs=np.array([4]),
        single_points=rng.normal(size=(1, 2)),
        camera_times_s=np.array([number / 60, np.nan]),
        notes=("left camera frozen",) if number % 5 == 0 else (),
    )
    return pack_stamped(1000.0 + number / 60, frame)


def pose_record(number: int) -> bytes:
    """A solved pose."""
    rng = np.random.default_rng(number + 1)
    rotations = rng.normal(size=(29, 4))
    pose = PerformerPose(
        number,
        number / 60,
        rotations / np.linalg.norm(rotations, axis=1, keepdims=True),
        rng.normal(size=3),
        0.5,
        rng.normal(size=(MARKERS, 3)),
        np.vstack((rng.normal(size=(MARKERS - 1, 3)), np.full((1, 3), np.nan))),
        np.arange(MARKERS) % 3 - 1,
        0.004,
    )
    return pack_solved(TimedPose(ScenePose((pose,)), 1000.0 + number / 60, 0.002, 0))


def frames_of(take: TakeFile) -> list[bytes]:
    """Marker frames of a take, packed as they came."""
    return [pack_stamped(stamp_s, frame) for stamp_s, frame in take.stamped_frames]


def poses_of(take: TakeFile) -> list[bytes]:
    """Poses of a take, packed as they came."""
    return [pack_solved(solved) for solved in take.poses]
