"""A camera that gives nothing for a while: the pose goes on with the other, says so, and is right again after."""

from dataclasses import replace

import numpy as np
from perfanim.core.body.pose_notes import source_notes
from perfanim.core.session.session import Session

LOST = range(12, 20)
NOTE = "the left camera froze"


def test_pose_continues_with_the_remaining_camera(subject, database, stage_rig, record, true_markers):
    session = Session(subject, database, stage_rig)
    hidden = tuple((marker, 0) for marker in range(true_markers.shape[1]))
    errors_m, notes = [], []
    for number, markers in enumerate(true_markers[:32]):
        frame = record(markers, number, cameras=True, hidden=hidden if number in LOST else ())
        pose = session.step(replace(frame, notes=(NOTE,)) if number in LOST else frame)
        errors_m.append(float(np.linalg.norm(pose.markers_m - markers, axis=1).mean()))
        notes.append(source_notes([NOTE])[0] in pose.notes)
        if number in LOST:
            assert np.all(pose.single_cameras == 1)
    assert notes == [number in LOST for number in range(32)]
    # depth along the rays is the database's guess; nothing is further off than half a step
    assert max(errors_m[number] for number in LOST) < 0.3
    # a marker is known again within three frames
    assert max(errors_m[LOST.stop + 3 :]) < 2.0 * max(errors_m[5 : LOST.start])
