"""Takes solved by both bodies in turn: the same poses."""

import numpy as np
from perfanim.core.kernel.library import use_kernel
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.session.session import Session

# Single precision may rank two examples of nearly the same distance differently; they have hardly any weight.
APART_M = 1e-5


def test_frames_without_labels_by_both_in_turn(subject, database, true_markers):
    sessions = [Session(subject, database), Session(subject, database)]
    try:
        for number, points_m in enumerate(true_markers):
            frame = MarkerFrame(number, number / 30.0, points_m[::-1], np.tile(1e-6 * np.eye(3), (len(points_m), 1, 1)))
            poses = []
            for is_used, session in zip((False, True), sessions, strict=True):
                assert use_kernel(is_used) == is_used
                poses.append(session.step(frame))
            np.testing.assert_allclose(poses[1].markers_m, poses[0].markers_m, atol=APART_M)
    finally:
        use_kernel(True)
    assert all(session.is_tracking for session in sessions)
