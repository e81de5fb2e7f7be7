"""Recorded takes, where labels that are found late hold from the moment of doubt on."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.pose_notes import NoteKind
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.session.multi_target_session import MultiTargetSession
from perfanim.core.session.session import Session
from perfanim.core.session.solve_take import solve_frames

NOISE_M = 0.002
TOLERANCE_M = 5.0 * np.sqrt(3.0) * NOISE_M
CUT, HIDDEN, LAST = 12, 9, 45


@pytest.fixture(scope="module")
def rows(true_markers):
    """Markers (F, M, 3) of somebody who walks, is hidden, and goes on elsewhere and turned by a quarter."""
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    rows = true_markers[:LAST].copy()
    rows[CUT : CUT + HIDDEN] = np.nan
    rows[CUT + HIDDEN :] = rows[CUT + HIDDEN :] @ turn + np.array([0.4, 0.0, 0.3])
    return rows


@pytest.fixture(scope="module")
def frames(rows):
    """Frames of these rows: points with noise, in another order each time, without labels."""
    generator = np.random.default_rng(5)
    result = []
    for number, row in enumerate(rows):
        points = row[np.isfinite(row[:, 0])]
        points = generator.permutation(points + generator.normal(scale=NOISE_M, size=points.shape))
        covariances = np.broadcast_to(NOISE_M**2 * np.eye(3), (len(points), 3, 3))
        result.append(MarkerFrame(number, number / 30.0, points, covariances))
    return result


@pytest.fixture(scope="module")
def session(subject, database):
    return MultiTargetSession([Session(subject, database)])


def solve(frames, session, causal):
    session.reset()
    return solve_frames(frames, session, "solving", lambda fraction, text: None, causal)


@pytest.fixture(scope="module")
def live(frames, session):
    return solve(frames, session, causal=True)


@pytest.fixture(scope="module")
def recorded(frames, session):
    return solve(frames, session, causal=False)


def right_labels(solved, rows):
    """(F, M) whether each marker of the first performer is where it is, or hidden."""
    observed = np.array([pose.observed_m for pose in solved.poses_of()])
    return np.where(np.isnan(rows), np.isnan(observed), np.abs(observed - rows) < TOLERANCE_M).all(axis=2)


def test_labels_also_hold_before_they_were_found(frames, rows, live, recorded):
    late = ~right_labels(live, rows).all(axis=1)
    assert late[CUT + HIDDEN]  # live, nobody knows yet
    assert not late[:CUT].any()
    assert right_labels(recorded, rows).all()
    assert recorded.relabelled[late].all()
    assert not live.relabelled.any()
    assert not recorded.relabelled[CUT + HIDDEN + 15 :].any()
    told = [any(note.kind is NoteKind.LABELLED_LATER for note in pose.notes) for pose in recorded.poses_of()]
    np.testing.assert_array_equal(told, recorded.relabelled)
    fit = np.array([pose.marker_rms_m for pose in recorded.poses_of()])[CUT + HIDDEN :]
    assert fit.max() < 0.03
    times = [pose.time_s for pose in recorded.poses]
    assert times == [frame.time_s for frame in frames]


def test_frames_before_the_wrong_labels_stay_live(live, recorded):
    for pose, other in list(zip(live.poses, recorded.poses, strict=True))[: CUT - 1]:
        np.testing.assert_array_equal(pose.performers[0].rotations, other.performers[0].rotations)


def test_causal_poses_are_those_of_a_live_session(frames, subject, database, live):
    alone = Session(subject, database)
    for frame, pose in zip(frames, live.poses, strict=True):
        np.testing.assert_array_equal(alone.step(frame).rotations, pose.performers[0].rotations)


def test_relabelling_leaves_out_impossible_frames(frames, rows, session):
    """A time that goes back and a point at infinity neither stop nor harm the frames around them."""
    bad = list(frames)
    bad[CUT + HIDDEN] = replace(frames[CUT + HIDDEN], time_s=np.nan)
    far = np.append(frames[CUT + HIDDEN + 1].points_m, [[np.inf, 0.0, 1e30]], axis=0)
    covariances = np.broadcast_to(NOISE_M**2 * np.eye(3), (len(far), 3, 3))
    bad[CUT + HIDDEN + 1] = MarkerFrame(CUT + HIDDEN + 1, frames[CUT + HIDDEN + 1].time_s, far, covariances)
    solved = solve(bad, session, causal=False)
    assert np.delete(right_labels(solved, rows), CUT + HIDDEN, axis=0).all()
    assert any("left out" in note.text for note in solved.poses[CUT + HIDDEN + 1].notes)
