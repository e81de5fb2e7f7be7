"""Markers that one camera loses are followed in the other one's image, and not taken for one another."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.geometry.camera import Camera, CameraRig
from perfanim.core.labelling.single_camera_trajectories import single_views
from perfanim.core.labelling.trajectory_linking import Tracking
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.simulate.studio.rig import default_rig

FPS = 60.0
FRAMES = 120
PIXEL_SIGMA = 0.1


@pytest.fixture(scope="module")
def rig() -> CameraRig:
    return default_rig()


def paths() -> np.ndarray:
    """(F, 4, 3): a body that sways, and a hand that swings past it at up to 3 m/s."""
    time_s = np.arange(FRAMES) / FPS
    body = np.array([[-0.2, 1.4, 0.0], [0.2, 1.4, 0.0], [0.0, 1.0, 0.1]])
    sway = 0.1 * np.sin(2 * np.pi * 0.5 * time_s)[:, None, None] * np.array([1.0, 0.0, 0.5])
    swing = 2 * np.pi * 1.0 * time_s
    hand = np.stack((0.5 + 0.1 * np.cos(swing), 1.2 + 0.4 * np.sin(swing), 0.4 + 0.2 * np.cos(swing)), axis=1)
    return np.concatenate((body + sway, hand[:, None]), axis=1)


def tracked(
    rig: CameraRig, points: np.ndarray, hidden: np.ndarray, ghosts: int = 0
) -> tuple[Tracking, list[MarkerFrame]]:
    """Frames whose blobs are those that `hidden` (F, M, C) leaves, tracked without a fault."""
    rng = np.random.default_rng(0)
    frames, labels = [], []
    for f, row in enumerate(points):
        blobs, owner = [], []
        for c, camera in enumerate(rig.cameras):
            shown = np.flatnonzero(~hidden[f, :, c])
            order = rng.permutation(np.concatenate((shown, np.full(ghosts, -1))))
            false = rng.uniform((0.0, 0.0), camera.image_size, (len(order), 2))
            pixels = np.where((order < 0)[:, None], false, camera.project(row[order]))
            pixels = pixels + rng.normal(0.0, PIXEL_SIGMA, pixels.shape)
            blobs.append(np.pad(pixels, ((0, 0), (0, 3))).astype(np.float32))
            owner.append(order)
        located = np.flatnonzero(~hidden[f].any(axis=1))
        place = np.array([[int(np.flatnonzero(order == m)[0]) for order in owner] for m in located]).reshape(-1, 2)
        covariance = np.tile(1e-6 * np.eye(3), (len(located), 1, 1))
        frames.append(MarkerFrame(f, f / FPS, row[located], covariance, blobs=tuple(blobs), point_blobs=place))
        labels.append(located)
    positions = np.where(hidden.any(axis=2)[..., None], np.nan, points)
    take = MarkerTake("t", FPS, ("A", "B", "C", "HAND"), positions)
    return Tracking(take, tuple(labels), 0), frames


def distance_m(camera: Camera, point: np.ndarray, seen: np.ndarray) -> float:
    """How far a world point passes a ray, at its depth."""
    x, y, z = camera.to_camera(point)
    return float(np.hypot(x / z - seen[0], y / z - seen[1]) * z)


@pytest.mark.parametrize("ghosts", [0, 2])
def test_a_marker_that_one_camera_loses_is_followed_in_the_other(rig: CameraRig, ghosts: int) -> None:
    points = paths()
    hidden = np.zeros((FRAMES, 4, 2), dtype=bool)
    hidden[30:90, 3, 0] = True  # the hand, for a second of its swing
    hidden[50:60, 1, 1] = True
    tracking, frames = tracked(rig, points, hidden, ghosts)
    single = single_views(tracking, frames, rig)
    expected = np.where(hidden[..., 0], 1, np.where(hidden[..., 1], 0, -1))
    found = single.cameras >= 0
    assert np.all(expected[found] == single.cameras[found])
    # a false blob that lies nearer to where the marker should be than its own takes its place for a frame
    assert found.sum() >= (0.9 if ghosts else 1.0) * (expected >= 0).sum()
    for f, marker in np.argwhere(found):
        camera = rig.cameras[single.cameras[f, marker]]
        # five standard deviations of the blob; a frame of the hand's movement is ten times as far
        limit = 5.0 * PIXEL_SIGMA / camera.focal_px * camera.to_camera(points[f, marker])[2]
        assert distance_m(camera, points[f, marker], single.points[f, marker]) < (0.03 if ghosts else limit)


def test_what_no_camera_shows_stays_hidden(rig: CameraRig) -> None:
    hidden = np.zeros((FRAMES, 4, 2), dtype=bool)
    hidden[30:60, 3] = True
    tracking, frames = tracked(rig, paths(), hidden)
    single = single_views(tracking, frames, rig)
    assert np.all(single.cameras == -1)
    assert np.all(np.isnan(single.points))
    assert replace(tracking.take, single=single).single is single
