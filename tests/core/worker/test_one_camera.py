"""A capture with one camera through the real workers."""

from pathlib import Path

import numpy as np
from jobs_played import played
from motion_synthesis import performance
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.geometry.rig_file import rig_tables
from perfanim.core.markers.subject import subject_tables
from perfanim.core.simulate.studio.simulated_source import open_simulated
from perfanim.core.worker.protocol import Message, MessageKind

FPS = 30
LOOKED_AT_S = 4.0  # T pose, arms down, a second of walking


def test_one_camera_starts_in_the_t_pose_and_follows(tmp_path: Path) -> None:
    performer = {"kind": "simulated", "behaviour": "walking", "seconds": 2.0, "marker_set": "one-camera", "fps": FPS}
    source = open_simulated(performer)
    # begins in a T pose, as the performer does
    write_bvh(performance([("walking", 4.0)], seed=5), tmp_path / "walk.bvh")
    build_database([str(tmp_path / "walk.bvh")], tmp_path / "walk.pfdb", BuildSettings(fps=60.0))
    rig = rig_tables(CameraRig(source.rig.cameras[:1]))
    request = {
        "job": "capture",
        "cameras": {"source": {**performer, "cameras": 1}, "rig": rig, "threshold": None},
        "performers": [subject_tables(source.subject)],
        "database": str(tmp_path / "walk.pfdb"),
    }
    poses = []

    def has_enough(message: Message) -> bool:
        poses.extend([message.pose().pose] if message.kind is MessageKind.POSE else [])
        return len(poses) >= LOOKED_AT_S * FPS

    assert not [message.payload for message in played(request, has_enough) if message.kind is MessageKind.ERROR]
    true_m = source.motion.root_positions_m[[pose.number for pose in poses]]
    away_m = np.linalg.norm([pose.performers[0].root_position_m for pose in poses] - true_m, axis=1)
    assert away_m.max() < 0.1
