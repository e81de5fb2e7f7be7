"""A capture with one camera through the real workers."""

import time
from pathlib import Path

import numpy as np
from motion_synthesis import performance
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.geometry.rig_file import rig_tables
from perfanim.core.markers.subject import subject_tables
from perfanim.core.simulate.studio.simulated_source import open_simulated
from perfanim.core.worker.client import WorkerClient
from perfanim.core.worker.protocol import MessageKind

PATIENCE_S = 120.0
FPS = 30
LOOKED_AT_S = 4.0  # T pose, arms down, a second of walking


def test_one_camera_starts_in_the_t_pose_and_follows(tmp_path: Path) -> None:
    performer = {"kind": "simulated", "behaviour": "walking", "seconds": 2.0, "marker_set": "one-camera", "fps": FPS}
    source = open_simulated(performer)
    write_bvh(
        performance([("walking", 4.0)], seed=5), tmp_path / "walk.bvh"
    )  # begins in a T pose, as the performer does
    build_database([str(tmp_path / "walk.bvh")], tmp_path / "walk.pfdb", BuildSettings(fps=60.0))
    request = {
        "job": "capture",
        "cameras": {
            "source": {**performer, "cameras": 1},
            "rig": rig_tables(CameraRig(source.rig.cameras[:1])),
            "threshold": None,
        },
        "performers": [subject_tables(source.subject)],
        "database": str(tmp_path / "walk.pfdb"),
    }
    client, poses = WorkerClient(request), []
    limit = time.monotonic() + PATIENCE_S
    try:
        while len(poses) < LOOKED_AT_S * FPS:
            messages = client.poll()
            assert not [message.payload for message in messages if message.kind is MessageKind.ERROR]
            poses += [message.pose().pose for message in messages if message.kind is MessageKind.POSE]
            client.acknowledge(len(poses))
            client.wait(0.05)
            assert time.monotonic() < limit
    finally:
        client.close()
    true_m = source.motion.root_positions_m[[pose.number for pose in poses]]
    away_m = np.linalg.norm([pose.performers[0].root_position_m for pose in poses] - true_m, axis=1)
    assert away_m.max() < 0.1
