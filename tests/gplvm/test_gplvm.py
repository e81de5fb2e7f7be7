"""The GPLVM of Figure 5. It needs GPy, so an environment of its own: `make extras-test`."""

import numpy as np
from bench.figure5 import gplvm, linear


def test_a_curve_is_held_in_one_dimension():
    """A bent line, which a linear model of one dimension cannot hold."""
    t = np.linspace(-1.0, 1.0, 60)
    poses = np.stack((t, t**2, np.sin(2.0 * t)), axis=1)
    left_out = np.arange(60) % 5 == 2

    def error(model) -> float:
        found = model(poses[~left_out], poses[left_out], (1,))[0]
        return float(np.sqrt(np.mean((found - poses[left_out]) ** 2)))

    assert error(gplvm) < 0.1 * error(linear)
