from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.errors import TakeError
from perfanim.core.labelling.trajectory_linking import track_markers
from perfanim.core.markers.marker_frame import MarkerFrame

BODY = np.array(
    [[0.0, 1.2, 0.1], [0.0, 1.0, 0.12], [-0.12, 0.9, 0.12], [0.12, 0.88, 0.12],
     [-0.3, 0.8, 0.0], [0.31, 0.82, 0.0], [-0.13, 0.45, 0.08], [0.12, 0.47, 0.08],
     [-0.14, 0.1, 0.1], [0.13, 0.12, 0.1]]
)  # fmt: skip
DEPTH_SIGMA = 0.01


def walk(frames: int, fps: float, speed: float = 1.2) -> np.ndarray:
    """(F, M, 3) markers of a body that walks towards the cameras; hands and feet swing."""
    time_s = np.arange(frames) / fps
    swing = 0.3 * np.sin(2 * np.pi * 0.9 * time_s)[:, None]
    points = np.tile(BODY, (frames, 1, 1))
    points[:, [4, 9], 2] += swing
    points[:, [5, 8], 2] -= swing
    points[:, [6], 2] -= 0.5 * swing
    points[:, [7], 2] += 0.5 * swing
    points[:, :, 2] += (-5.0 + speed * time_s)[:, None]
    return points


def frames_of(points: np.ndarray, fps: float, hidden: np.ndarray | None = None, ghosts: int = 0, seed: int = 0):
    """Unlabelled frames with noise, in random order; `hidden` (F, M) are left out, ghosts appear for a frame each."""
    rng = np.random.default_rng(seed)
    covariance = np.diag([0.002, 0.002, DEPTH_SIGMA]) ** 2
    result, truth = [], []
    for f, row in enumerate(points):
        shown = np.flatnonzero(~hidden[f]) if hidden is not None else np.arange(len(row))
        order = rng.permutation(np.concatenate((shown, np.full(ghosts, -1))))
        noise = rng.normal(0, 1, (len(order), 3)) @ np.sqrt(covariance)
        false = rng.uniform([-0.8, 0.0, row[:, 2].mean() - 0.3], [0.8, 1.6, row[:, 2].mean() + 0.3], (len(order), 3))
        places = np.where((order < 0)[:, None], false, row[order]) + noise
        result.append(MarkerFrame(f, f / fps, places, np.tile(covariance, (len(order), 1, 1))))
        truth.append(order)
    return result, truth


def right_share(tracking, truth: list[np.ndarray]) -> float:
    """Share of labelled points whose label is that of their marker, after the best renaming."""
    votes = np.zeros((len(BODY), len(BODY)))
    for labels, order in zip(tracking.labels, truth, strict=True):
        known = (labels >= 0) & (order >= 0)
        np.add.at(votes, (order[known], labels[known]), 1)
    false = sum(int(np.sum((labels >= 0) & (order < 0))) for labels, order in zip(tracking.labels, truth, strict=True))
    return votes.max(axis=1).sum() / (votes.sum() + false)


def test_markers_are_linked(tmp_path):
    frames, truth = frames_of(walk(90, 30.0), 30.0)
    tracking = track_markers(frames, "walk", 30.0)
    assert tracking.take.positions_m.shape == (90, 10, 3)
    assert tracking.take.visible.all()
    assert right_share(tracking, truth) == 1.0
    assert tracking.take.names[0] == "M01"
    heights = np.median(tracking.take.positions_m[..., 1], axis=0)
    assert np.all(np.diff(heights) <= 0.01)  # numbered from the highest down


def test_returning_markers_get_their_own_labels():
    rng = np.random.default_rng(5)
    hidden = np.zeros((150, 10), dtype=bool)
    for _ in range(25):
        start, marker = rng.integers(10, 130), rng.integers(0, 10)
        hidden[start : start + rng.integers(3, 15), marker] = True
    frames, truth = frames_of(walk(150, 30.0), 30.0, hidden)
    tracking = track_markers(frames, "walk", 30.0)
    assert right_share(tracking, truth) >= 0.995
    assert tracking.take.visible.sum() >= 0.97 * (~hidden).sum()


def test_ghosts_of_single_frames_are_dropped():
    frames, truth = frames_of(walk(90, 30.0), 30.0, ghosts=3)
    tracking = track_markers(frames, "walk", 30.0)
    assert len(tracking.take.names) == 10
    assert right_share(tracking, truth) >= 0.995
    assert tracking.dropped_tracklets > 100


@pytest.mark.parametrize(("fps", "speed"), [(5.0, 1.0), (1.0, 0.25)])
def test_slow_cameras_are_linked_by_the_common_shift(fps, speed):
    frames, truth = frames_of(walk(20, fps, speed), fps)
    assert right_share(track_markers(frames, "walk", fps), truth) == 1.0


def test_common_shift_may_exceed_marker_distances():
    """Half a metre from frame to frame: nearly every marker comes near to where another was, and limbs swing."""
    points = walk(12, 2.0, 0.0)
    points[..., 0] += 0.5 * np.arange(12)[:, None] - 3.0
    frames, truth = frames_of(points, 2.0)
    assert right_share(track_markers(frames, "walk", 2.0), truth) >= 0.95


def test_ghost_does_not_replace_a_returning_marker():
    """It is seen for nine frames, the last four of them beside the marker, which stays for longer."""
    marker = walk(100, 30.0, speed=0.0)
    points = np.concatenate((marker, marker[:, 9:] + [0.12, 0.0, 0.0]), axis=1)
    hidden = np.zeros((100, 11), dtype=bool)
    hidden[30:55, 9] = True
    hidden[:50, 10] = hidden[59:, 10] = True
    frames, truth = frames_of(points, 30.0, hidden)
    tracking = track_markers(frames, "walk", 30.0)
    assert tracking.dropped_tracklets == 1
    for f in (*range(30), *range(59, 100)):
        assert np.all(tracking.labels[f] >= 0)
    for labels, order in zip(tracking.labels, truth, strict=True):
        assert np.all(labels[order == 9] >= 0)
        assert np.all(labels[order == 10] < 0)


def test_depth_jumps_do_not_exchange_markers():
    points = walk(120, 30.0)
    points[..., 2] += np.random.default_rng(2).normal(0, 0.07, (120, 1))
    frames, truth = frames_of(points, 30.0)
    assert right_share(track_markers(frames, "walk", 30.0), truth) == 1.0


def test_frames_without_markers_are_refused():
    empty = [MarkerFrame(f, f / 30.0) for f in range(10)]
    with pytest.raises(TakeError, match="almost no markers"):
        track_markers(empty, "empty", 30.0)
    with pytest.raises(TakeError, match="almost no markers"):
        track_markers([], "none", 30.0)
    with pytest.raises(TakeError, match="no frame shows more than 0 of 12"):
        track_markers([], "none", 30.0, count=12)
    frames, _ = frames_of(walk(20, 30.0), 30.0)
    with pytest.raises(TakeError, match="no frame shows more than 10 of 12"):
        track_markers(frames, "walk", 30.0, count=12)


def test_take_holds_points_numbers_and_times():
    frames, _ = frames_of(walk(40, 30.0), 30.0, ghosts=2)
    frames = [replace(frame, number=2 * f + 7, time_s=frame.time_s + 3.0) for f, frame in enumerate(frames)]
    tracking = track_markers(frames, "walk", 30.0)
    take = tracking.take
    assert (take.name, take.fps, take.names) == ("walk", 30.0, tuple(f"M{i:02d}" for i in range(1, 11)))
    np.testing.assert_array_equal(take.frame_numbers, 2 * np.arange(40) + 7)
    np.testing.assert_allclose(take.times_s, np.arange(40) / 30.0 + 3.0)
    for frame, labels, row in zip(frames, tracking.labels, take.positions_m, strict=True):
        expected = np.full((10, 3), np.nan)
        expected[labels[labels >= 0]] = frame.points_m[labels >= 0]
        np.testing.assert_array_equal(row, expected)
        assert len(labels) == 12


@pytest.mark.parametrize(("share", "worn"), [(0.35, 10), (0.15, 8)])
def test_marker_count_is_that_of_a_quarter_of_the_frames(share, worn):
    hidden = np.zeros((100, 10), dtype=bool)
    hidden[int(100 * share) :, [0, 9]] = True
    frames, truth = frames_of(walk(100, 30.0, speed=0.3), 30.0, hidden)
    tracking = track_markers(frames, "walk", 30.0)
    assert len(tracking.take.names) == worn
    assert tracking.dropped_tracklets == 10 - worn
    assert right_share(tracking, truth) == 1.0


@pytest.mark.parametrize(("shown", "found"), [(32, True), (20, False)])
def test_rare_markers_are_refused(shown, found):
    frames, _ = frames_of(walk(100, 30.0)[:, :5], 30.0)
    frames = [frame if f < shown else MarkerFrame(f, f / 30.0) for f, frame in enumerate(frames)]
    if found:
        assert track_markers(frames, "short", 30.0).take.visible.sum() == 5 * shown
    else:
        with pytest.raises(TakeError, match="almost no markers"):
            track_markers(frames, "short", 30.0)


def test_lasting_ghost_is_not_a_hidden_marker():
    points = np.concatenate((walk(100, 30.0, speed=0.0), np.tile([0.7, 0.4, -4.9], (100, 1, 1))), axis=1)
    hidden = np.zeros((100, 11), dtype=bool)
    hidden[30:70, 9] = True
    hidden[:35, 10] = hidden[65:, 10] = True
    frames, truth = frames_of(points, 30.0, hidden)
    tracking = track_markers(frames, "walk", 30.0)
    assert tracking.dropped_tracklets == 1
    for labels, order in zip(tracking.labels, truth, strict=True):
        assert np.all(labels[order == 10] == -1)
        assert np.all(labels[order < 10] >= 0)
    assert tracking.take.visible.sum() == 10 * 100 - 40


def test_moved_limbs_are_identified_by_rigid_distances():
    """Both hands come back with the arms crossed: each lies where the other was, but at its own forearm."""
    time_s = np.arange(140)[:, None] / 30.0
    torso = np.array([[-0.15, 1.4, 0.0], [0.15, 1.4, 0.0], [-0.12, 1.0, 0.0], [0.12, 1.0, 0.0], [0.0, 1.6, 0.0]])
    crossed = np.clip((time_s - 2.2) / 1.0, 0.0, 1.0)
    arms = []
    for side, phase in ((-1.0, 0.0), (1.0, 2.0)):
        swing = np.concatenate([np.sin(rate * time_s + phase) for rate in (3.0, 4.1, 2.3)], axis=1)
        home = np.array([0.4 * side, 1.1, 0.1 + 0.1 * side])
        forearm = home + 0.12 * swing * (1.0 - crossed) - crossed * np.array([0.8 * side, 0.0, 0.0])
        arms += [forearm, forearm + np.array([0.0, -0.22, 0.0])]
    points = np.concatenate((np.tile(torso, (140, 1, 1)), np.stack(arms, axis=1)), axis=1) - [0.0, 0.0, 4.0]
    hidden = np.zeros((140, 9), dtype=bool)
    hidden[60:105, [6, 8]] = True
    frames, truth = frames_of(points, 30.0, hidden)
    tracking = track_markers(frames, "arms", 30.0)
    assert tracking.dropped_tracklets == 0
    assert right_share(tracking, truth) == 1.0


def test_common_shift_is_limited_by_walking_speed():
    """At five frames per second: three metres aside are a cut, or another person."""
    points = walk(20, 5.0, 0.0)
    points[12:, :, 0] += 3.0
    frames, _ = frames_of(points, 5.0)
    tracking = track_markers(frames, "cut", 5.0)
    assert tracking.dropped_tracklets == 10
    assert tracking.take.visible.sum() == 10 * 12


def test_standing_body_has_no_common_shift():
    """All markers but three are hidden for a frame: the others' places must not pull the body aside."""
    points = walk(12, 5.0, 0.0)
    hidden = np.zeros((12, 10), dtype=bool)
    hidden[6, 3:] = True
    frames, truth = frames_of(points, 5.0, hidden)
    tracking = track_markers(frames, "stand", 5.0)
    assert right_share(tracking, truth) == 1.0
    assert tracking.take.visible.sum() == 12 * 10 - 7
