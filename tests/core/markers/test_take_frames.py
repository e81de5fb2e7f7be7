from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.errors import TakeError
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.marker_take import MarkerTake, SingleViews
from perfanim.core.markers.take_frames import take_frames
from perfanim.core.simulate.studio.studio_rig import default_rig

SET = load_marker_set("locomotion")


def shuffled_take(extra=("SPARE",), lacking=()):
    """The set's markers in another order, with another marker among them."""
    names = [*reversed(SET.names), *extra]
    names = [name for name in names if name not in lacking]
    positions = np.random.default_rng(0).normal(size=(6, len(names), 3))
    positions[2, 0] = np.nan
    positions[3] = np.nan
    return MarkerTake("t", 30.0, names, positions, np.array([4, 5, 6, 9, 10, 11]))


def test_frames_have_the_sets_labels():
    take = shuffled_take()
    frames = list(take_frames(take, SET))
    assert [frame.number for frame in frames] == [4, 5, 6, 9, 10, 11]
    np.testing.assert_allclose([frame.time_s for frame in frames], take.frame_numbers / 30.0)
    for row, frame in zip(take.positions_m, frames, strict=True):
        for label, point in zip(frame.labels, frame.points_m, strict=True):
            np.testing.assert_array_equal(point, row[take.names.index(SET.names[label])])
    assert [len(frame.points_m) for frame in frames] == [8, 8, 7, 0, 8, 8]
    assert SET.names.index(take.names[0]) not in frames[2].labels
    assert np.all(np.linalg.eigvalsh(frames[0].covariances_m2) > 0.0)


def test_missing_markers_are_hidden():
    frames = list(take_frames(shuffled_take(lacking=("LHAN", "RWAI")), SET))
    assert sorted(frames[0].labels) == [i for i, name in enumerate(SET.names) if name not in ("LHAN", "RWAI")]


def test_rays_have_the_sets_labels():
    take = shuffled_take()
    cameras = np.where(take.visible, -1, 1)
    points = np.where((cameras >= 0)[..., None], np.arange(2.0 * cameras.size).reshape(*cameras.shape, 2), np.nan)
    frames = list(take_frames(replace(take, single=SingleViews(default_rig(), cameras, points)), SET))
    assert [len(frame.single_cameras) for frame in frames] == [0, 0, 1, 8, 0, 0]  # the spare marker is no ray
    for row, frame in zip(points, frames, strict=True):
        for label, point in zip(frame.single_labels, frame.single_points, strict=True):
            np.testing.assert_array_equal(point, row[take.names.index(SET.names[label])])


def test_too_few_torso_markers_are_refused():
    with pytest.raises(TakeError, match=r"t: has fewer than three of the torso markers LSHO, .*its markers are RFOO"):
        next(take_frames(shuffled_take(lacking=("LSHO", "RSHO")), SET))
