"""What is left of a marker frame without some of its blobs or points."""

import numpy as np
from perfanim.core.markers.marker_frame_subset import without_blobs, without_points


def test_removed_blobs_take_their_points_and_rays(record, true_markers, stage_rig):
    points = true_markers[0]
    frame = record(points, 3, cameras=True, hidden=((5, 0), (2, 1)))
    whole = without_blobs(frame, [np.empty(0, dtype=np.int64)] * 2)
    assert whole is frame
    left_of = [int(blob) for blob in frame.point_blobs[[0, 3], 0]]
    ray = int(np.flatnonzero(frame.single_cameras == 1)[0])
    rest = without_blobs(frame, [np.array(left_of), frame.single_blobs[[ray]]])
    kept = [row for row in range(len(frame.points_m)) if row not in (0, 3)]
    np.testing.assert_array_equal(rest.points_m, frame.points_m[kept])
    np.testing.assert_array_equal(rest.single_points, np.delete(frame.single_points, ray, axis=0))
    assert [len(blobs) for blobs in rest.blobs] == [len(frame.blobs[0]) - 2, len(frame.blobs[1]) - 1]
    for camera in range(2):  # every point and ray still has its own blob
        before = frame.blobs[camera][frame.point_blobs[kept, camera]]
        np.testing.assert_array_equal(rest.blobs[camera][rest.point_blobs[:, camera]], before)
    for camera, blob, point in zip(rest.single_cameras, rest.single_blobs, rest.single_points, strict=True):
        view = stage_rig.cameras[camera]
        np.testing.assert_allclose(view.undistort(rest.blobs[camera][blob, :2]), point, atol=1e-6)


def test_points_without_images_are_removed(record, true_markers):
    frame = record(true_markers[0], 3, labels=np.arange(8))
    rest = without_points(frame, np.arange(8) % 2 == 0)
    np.testing.assert_array_equal(rest.points_m, frame.points_m[1::2])
    np.testing.assert_array_equal(rest.labels, [1, 3, 5, 7])
