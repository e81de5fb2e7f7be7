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


def test_markers_are_followed(tmp_path):
    frames, truth = frames_of(walk(90, 30.0), 30.0)
    tracking = track_markers(frames, "walk", 30.0)
    assert tracking.take.positions_m.shape == (90, 10, 3)
    assert tracking.take.visible.all()
    assert right_share(tracking, truth) == 1.0
    assert tracking.take.names[0] == "M01"
    heights = np.median(tracking.take.positions_m[..., 1], axis=0)
    assert np.all(np.diff(heights) <= 0.01)  # numbered from the highest down


def test_lost_markers_get_their_own_label_back():
    rng = np.random.default_rng(5)
    hidden = np.zeros((150, 10), dtype=bool)
    for _ in range(25):
        start, marker = rng.integers(10, 130), rng.integers(0, 10)
        hidden[start : start + rng.integers(3, 15), marker] = True
    frames, truth = frames_of(walk(150, 30.0), 30.0, hidden)
    tracking = track_markers(frames, "walk", 30.0)
    assert right_share(tracking, truth) >= 0.995
    assert tracking.take.visible.sum() >= 0.97 * (~hidden).sum()


def test_false_points_of_single_frames_are_dropped():
    frames, truth = frames_of(walk(90, 30.0), 30.0, ghosts=3)
    tracking = track_markers(frames, "walk", 30.0)
    assert len(tracking.take.names) == 10
    assert right_share(tracking, truth) >= 0.995
    assert tracking.dropped_tracklets > 100


@pytest.mark.parametrize(("fps", "speed"), [(5.0, 1.0), (1.0, 0.25)])
def test_slow_cameras_are_followed_by_the_body_as_a_whole(fps, speed):
    frames, truth = frames_of(walk(20, fps, speed), fps)
    assert right_share(track_markers(frames, "walk", fps), truth) == 1.0


def test_depth_that_jumps_with_the_cameras_clocks_exchanges_nothing():
    points = walk(120, 30.0)
    points[..., 2] += np.random.default_rng(2).normal(0, 0.07, (120, 1))
    frames, truth = frames_of(points, 30.0)
    assert right_share(track_markers(frames, "walk", 30.0), truth) == 1.0


def test_nothing_to_track_is_told():
    empty = [MarkerFrame(f, f / 30.0) for f in range(10)]
    with pytest.raises(TakeError, match="hardly any markers"):
        track_markers(empty, "empty", 30.0)
    frames, _ = frames_of(walk(20, 30.0), 30.0)
    with pytest.raises(TakeError, match="at most 10 of 12"):
        track_markers(frames, "walk", 30.0, count=12)
