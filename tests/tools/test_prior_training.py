"""Windows that the prior is trained on; the training itself needs JAX (`tests/prior`)."""

import numpy as np
import pytest
from perfanim.core.body.standard_skeleton import JOINT_NAMES
from perfanim.core.database.build import BuildSettings, build_database
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
