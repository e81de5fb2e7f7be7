"""Two steps of the prior's training, in an environment with JAX: `make extras-test`."""

import numpy as np
import pytest
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.database.store import open_database
from perfanim.core.system.assets import MOTION
from prior_training.motion import read_recordings
from prior_training.network import OUTPUTS, first_parameters, residuals, scaling_of, train
from prior_training.performers import PerformerMaker
from prior_training.windows import WindowMaker


@pytest.fixture(scope="module")
def windows(tmp_path_factory):
    path = tmp_path_factory.mktemp("prior") / "embedded.pfdb"
    build_database([MOTION], path, BuildSettings(fps=60.0, workers=1))
    recordings = read_recordings([open_database(path)], {"motion"})
    return WindowMaker(recordings, PerformerMaker(recordings.skeletons))


def trained(windows, seed: int, steps: int):
    """Return weights and scaling, as the tool makes them."""
    generator = np.random.default_rng(seed)
    scaling = scaling_of(windows, generator)
    return train(windows, scaling, first_parameters(generator), generator, steps, lambda text: None), scaling


def test_a_seed_gives_the_same_weights_and_another_does_not(windows):
    (first, _), (again, _), (other, _) = (trained(windows, seed, 2) for seed in (3, 3, 4))
    for name, weights in first.items():
        assert np.isfinite(weights).all()
        np.testing.assert_allclose(weights, again[name], atol=1e-6)
    assert any(np.abs(weights - other[name]).max() > 1e-3 for name, weights in first.items())


def test_steps_lower_the_errors(windows):
    errors = []
    for steps in (1, 120):
        weights, scaling = trained(windows, 3, steps)
        off, sigmas = residuals(weights, windows, scaling, np.random.default_rng(9), 2)
        assert off.shape == sigmas.shape == (off.shape[0], OUTPUTS)
        errors.append(np.mean((off / scaling.outputs[1]) ** 2))
    assert errors[1] < errors[0]  # hardly: weights are averaged over hundreds of steps
