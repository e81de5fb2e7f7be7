"""The product's own set-up as others recorded it: two webcams, a performer in the dark with reflecting markers."""

from itertools import islice

import numpy as np
import pytest
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.labelling.trajectory_linking import track_markers
from perfanim.core.labelling.trajectory_naming import match_trajectories, name_trajectories
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.vision.calibration.board_points import load_board_points
from perfanim.core.vision.calibration.calibrate import calibrate_from_points
from perfanim.core.vision.pipeline import MarkerPipeline
from perfanim.core.vision.sources.image_file_source import ImageFileSource
from perfanim.core.vision.tracked_take import labelled_rms_px


@pytest.fixture(scope="module")
def folder(shared_dir):
    return shared_dir / "two-webcams"


@pytest.fixture(scope="module")
def calibration(folder):
    return calibrate_from_points(*load_board_points(folder / "stereo_calibration.json"))


def tracked(folder, calibration, sequence: int, fps: float, first: int | None = None):
    source = ImageFileSource([folder / f"sequence{sequence}" / f"*_{side}.jpg" for side in (1, 2)], fps)
    pipeline = MarkerPipeline(calibration.rig)
    pipeline.learn_from_take(source.samples(31))
    frames = [pipeline.process(images) for images in islice(source, first)]
    return frames, track_markers(frames, source.name, source.fps)


@pytest.fixture(scope="module", params=[200, pytest.param(444, marks=pytest.mark.long)])
def walk(request, folder, calibration):
    """Frames and tracking of sequence 4, its first seconds or the whole."""
    return tracked(folder, calibration, 4, 30.0, request.param)


def test_calibration_from_board_points_is_the_published_one(calibration):
    assert len(calibration.used) == 32
    assert calibration.stereo_rms_px <= 0.30
    assert calibration.baseline_m == pytest.approx(0.3657, abs=0.0005)
    left = calibration.rig.cameras[0].matrix
    np.testing.assert_allclose(
        [left[0, 0], left[1, 1], left[0, 1], left[0, 2], left[1, 2]], [795.67, 796.95, 1.50, 292.80, 216.03], atol=0.5
    )


def test_all_markers_are_tracked_throughout(walk, calibration):
    frames, tracking = walk
    assert len(frames) in (200, 444)
    assert tracking.take.positions_m.shape == (len(frames), 12, 3)
    # of all frames, not only of those in which the detection itself finds twelve in both images
    assert tracking.take.visible.all(axis=1).mean() >= 0.95
    assert labelled_rms_px(calibration.rig, frames, tracking.labels) <= 0.6


def test_no_label_is_exchanged(walk, calibration, folder):
    frames, tracking = walk
    truth = read_take(folder / "sequence4_published.trc").positions_m
    own = tracking.take.positions_m[: len(truth)]
    columns = match_trajectories(own, truth[: len(own)] * [1.0, -1.0, -1.0])[1]
    # the published points leave the lens distortion out: in the left image they are where the matrix alone puts them
    matrix = calibration.rig.cameras[0].matrix
    pixels = truth[:, columns] @ matrix.T
    pixels = pixels[..., :2] / pixels[..., 2:]
    for frame, labels, published in zip(frames, tracking.labels, pixels, strict=False):
        known = labels >= 0
        seen = frame.blobs[0][frame.point_blobs[known, 0], :2]
        distance = np.linalg.norm(seen[:, None] - published[None], axis=2)
        np.testing.assert_array_equal(distance.argmin(axis=1), labels[known], err_msg=f"frame {frame.number}")


def test_points_equal_the_published_ones_without_distortion(walk, calibration, folder):
    from dataclasses import replace

    from perfanim.core.geometry.triangulation import triangulate

    frames, tracking = walk
    plain = [replace(camera, distortion=np.zeros(5)) for camera in calibration.rig.cameras]
    truth = read_take(folder / "sequence4_published.trc").positions_m * [1.0, -1.0, -1.0]
    distances = []
    own = tracking.take.positions_m[: len(truth)]
    columns = match_trajectories(own, truth[: len(own)])[1]
    for frame, labels, published in zip(frames, tracking.labels, truth, strict=False):
        known = labels >= 0
        pixels = [frame.blobs[i][frame.point_blobs[known, i], :2].astype(np.float64) for i in range(2)]
        observed = np.stack([camera.undistort(p) for camera, p in zip(plain, pixels, strict=True)], axis=1)
        points = triangulate(plain, observed, np.ones((len(observed), 2)), 0.5)[0]
        # labels number the markers from the highest down, as the take's columns do
        distances.append(np.linalg.norm(points - published[columns[labels[known]]], axis=1))
    assert np.median(np.concatenate(distances)) <= 0.010


def test_the_marker_set_names_the_markers_as_published(walk, folder):
    take = name_trajectories(walk[1].take, load_marker_set("two-webcams"))
    truth = read_take(folder / "sequence4_published.trc")
    own = take.positions_m[: truth.frames]
    rows, columns = match_trajectories(own, truth.positions_m[: len(own)] * [1.0, -1.0, -1.0])
    assert [(take.names[r], truth.names[c]) for r, c in zip(rows, columns, strict=True)] == [
        (name, name) for name in take.names
    ]


@pytest.mark.parametrize(("sequence", "fps", "markers"), [(1, 1.0, 14), (2, 10.0, 14), (3, 5.0, 11)])
def test_the_other_sequences_keep_their_markers_and_nothing_else(folder, calibration, sequence, fps, markers):
    frames, tracking = tracked(folder, calibration, sequence, fps)
    assert len(tracking.take.names) == markers
    assert tracking.take.visible.mean() > 0.98
    assert labelled_rms_px(calibration.rig, frames, tracking.labels) < 0.6
    # a false point in one place for more than three frames would have been taken for a marker or counted here
    unlabelled = [int((labels < 0).sum()) for labels in tracking.labels]
    assert sum(unlabelled) <= 3 * max(tracking.dropped_tracklets, 1)
