"""Latency by stages: how the notes of several processes come together."""

import json
from pathlib import Path

import numpy as np
import pytest
from bench.latency import STAGES, WHOLE, figures, stage_times


def test_notes_of_all_processes_are_put_together_by_the_time_of_the_images(tmp_path: Path) -> None:
    warm, overtaken, shown = 1.0, 30.0, 31.0
    ends = {stage: 0.001 * (i + 1) for i, stage in enumerate(STAGES)}
    rows = [[stamp, stage, stamp + end] for stamp in (warm, shown) for stage, end in ends.items()]
    rows += [[overtaken, stage, overtaken + end] for stage, end in list(ends.items())[:-1]]
    (tmp_path / "1.json").write_text(json.dumps(rows[::2]))
    (tmp_path / "2.json").write_text(json.dumps(rows[1::2]))
    np.testing.assert_allclose(stage_times(tmp_path), [[0.001] * len(STAGES)], atol=1e-9)


def test_figures_are_medians_and_the_worst_of_a_hundred_in_milliseconds() -> None:
    times_s = np.full((1000, len(STAGES)), 0.002)
    times_s[::50, 1] = 0.010
    found = figures(times_s)
    assert found[STAGES[0]] == pytest.approx((2.0, 2.0))
    assert found[STAGES[1]] == pytest.approx((2.0, 10.0))
    assert found[WHOLE] == pytest.approx((2.0 * len(STAGES), 2.0 * len(STAGES) + 8.0))
