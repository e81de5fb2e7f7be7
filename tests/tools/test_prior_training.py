"""Windows that the prior is trained on; the training itself needs JAX (`tests/prior`)."""

import numpy as np
import pytest
from perfanim.core.body.standard_skeleton import JOINT_NAMES
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.database.store import open_database
from perfanim.core.system.assets import MOTION
from prior_training.motion import read_recordings
from prior_training.performers import FEW, MANY, PerformerMaker
from prior_training.windows import LAGS_S, WINDOWS, WindowMaker


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    path = tmp_path_factory.mktemp("prior") / "embedded.pfdb"
    build_database([MOTION], path, BuildSettings(fps=60.0, workers=1))
    return read_recordings([open_database(path)], {"motion"})


@pytest.fixture(scope="module")
def windows(recordings):
    return WindowMaker(recordings, PerformerMaker(recordings.skeletons))


def test_only_chosen_subjects_are_read(recordings):
    assert recordings.subjects == ("motion",)
    assert len(recordings.world) == len(recordings.poses) == recordings.stops.max()
    matrices = recordings.world[:: len(recordings.world) // 20]
    np.testing.assert_allclose(
        matrices @ np.swapaxes(matrices, -1, -2), np.broadcast_to(np.eye(3), matrices.shape), atol=1e-5
    )


def test_windows_have_sound_numbers(windows):
    batch = windows.draw(np.random.default_rng(0), 16)
    places = batch.joints.shape[1]
    assert places in (FEW, MANY)
    assert batch.features.shape == (16, WINDOWS, places, 9 + 3 * (len(LAGS_S) - 1) + len(LAGS_S))
    assert batch.seen.shape == (16, WINDOWS, places)
    assert batch.targets.shape == (16, WINDOWS, 6 + 3 * (len(JOINT_NAMES) - 1))
    for numbers in (batch.features[batch.seen], batch.targets, batch.bones):
        assert np.isfinite(numbers).all()
    assert 0.3 < batch.seen.mean() <= 1.0
    assert np.abs(batch.targets[..., 3:6]).max() < 2.0  # the root is near its markers, metres


def test_a_seed_gives_the_same_windows_and_another_does_not(windows):
    first, again, other = (windows.draw(np.random.default_rng(seed), 8) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.targets, again.targets)
    np.testing.assert_array_equal(first.features, again.features)
    assert first.targets.shape != other.targets.shape or not np.allclose(first.targets, other.targets)


def test_markers_of_one_camera_are_off_along_its_rays(windows):
    """Those that it sees alone now are moved; then the earlier ones are not known, or off by much the same."""
    points = np.random.default_rng(5).normal(size=(300, WINDOWS, len(LAGS_S), FEW, 3)).astype(np.float32)
    points[:, :, 0, 3] = np.nan
    moved, single = windows._by_one_camera(np.random.default_rng(6), points)
    assert not single[:, :, 3].any()
    assert 0.05 < single.mean() < 0.3
    off = moved - points
    earlier, now = off[:, :, 1:], off[:, :, 0]
    np.testing.assert_array_equal(np.nan_to_num(now[~single]), 0.0)
    assert np.isfinite(now[single]).all() and 0.002 < np.linalg.norm(now[single], axis=-1).mean() < 0.2
    for group in np.flatnonzero(single.any(axis=(1, 2))):
        for window in range(WINDOWS):
            of_window = now[group, window][single[group, window]]
            assert np.linalg.matrix_rank(of_window, tol=1e-4) <= 1  # all along one ray
    alone = np.flatnonzero(single.sum(axis=(1, 2)) == WINDOWS * (FEW - 1))
    others = np.setdiff1d(np.arange(len(points)), alone)
    assert len(alone) and np.isfinite(np.delete(earlier[alone], 3, axis=3)).all()
    hidden = np.isnan(earlier[others][..., 0])
    assert hidden.any() and not (hidden & ~single[others][:, :, None]).any()
    np.testing.assert_array_equal(np.nan_to_num(earlier[others]), 0.0)
