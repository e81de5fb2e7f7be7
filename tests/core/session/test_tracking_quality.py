"""What the agreement of a pose counts: markers seen, by two cameras or one."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from perfanim.core.session.tracking_quality import assess_fit
from perfanim.core.solver.observation import Observation


@pytest.mark.parametrize(("cameras", "share"), [([-1, -1], 0.5), ([-1, 0], 0.625), ([1, 0], 0.75)])
def test_a_marker_of_one_camera_counts_half(cameras, share):
    points_m = np.random.default_rng(3).normal(size=(4, 3))
    solution = SimpleNamespace(markers_m=points_m, nearest_m=0.0)
    seen = points_m.copy()
    seen[2:] = np.nan
    observation = replace(Observation.of_points(seen), cameras=np.array([-1, -1, *cameras]))
    assert assess_fit(observation, solution).agreement == pytest.approx(share)
