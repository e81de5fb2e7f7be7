"""What the accuracy bench measures with: ratios, intervals, confidence, feet, both ways."""

from dataclasses import replace

import numpy as np
import pytest
from bench.scenarios import LIVE, OFFLINE
from bench.solving import Expected, confidence_ratio, coverage, expected_of, feet_errors, solve_both_ways, true_subject
from bench.tables import UNITS, geometric_mean, paired_ratios
from perfanim.core.body.body_parts import PARTS
from perfanim.core.body.motion import sliced
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.progress import no_progress


def row(take, method, value):
    return {"condition": "c", "take": take, "method": method} | dict.fromkeys(UNITS, value)


def test_ratios_are_of_pairs_with_an_interval_and_the_takes_that_are_worse():
    rows = [row("a", "ours", 1.0), row("a", "theirs", 2.0), row("b", "ours", 3.0), row("b", "theirs", 2.0)]
    rows.append(row("c", "ours", 9.0))  # nothing to compare it with
    (found,) = paired_ratios(rows, "ours", "theirs", ("c", "d"))
    assert found["takes"] == 2
    assert found["deg_per_joint"] == pytest.approx(np.sqrt(0.5 * 1.5), abs=1e-3)
    assert (found["deg_per_joint_low"], found["mpjpe_mm_high"]) == (0.5, 1.5)
    assert (found["worst"], found["over"]) == (1.5, ["b 1.50"])
    assert geometric_mean([1.0, 4.0, float("nan")]) == pytest.approx(2.0)


def test_intervals_hold_by_part_and_joint():
    parts, joints = np.full((2, len(PARTS)), np.nan), np.array([[0.5, 5.0], [0.5, 1.0]])
    parts[:, :2] = [[1.0, 3.0], [2.0, np.nan]]
    case = Expected(np.ones(2), np.ones((2, 2)), parts, joints)
    found = coverage([case], ("hip", "knee"))
    assert (found["frames"], found["parts"], found["joints"]) == (2, 0.6667, 0.75)
    assert found["by_joint"] == {"hip": 1.0, "knee": 0.5}
    assert (found["by_part"]["torso"], found["by_part"]["head"]) == (1.0, 0.0)


def test_confidence_is_compared_by_its_lowest_and_highest_tenth():
    error = np.arange(20.0, 0.0, -1.0)[:, None]
    case = Expected(np.linspace(0.0, 1.0, 20), error, np.empty((20, 0)), np.empty((20, 0)))
    assert confidence_ratio([case]) == {"lowest_tenth_deg": 19.5, "highest_tenth_deg": 1.5, "ratio": 13.0}


def test_toes_below_the_true_ones_are_told(embedded_motion):
    truth = sliced(embedded_motion["walking-02-energetic"], 0, 90)
    same = feet_errors(truth, truth)
    assert same["toes_below_mm"] < 10.0
    assert same["skate_beyond_cm_s"] < 0.5  # held feet skate less
    lower = replace(truth, root_positions_m=truth.root_positions_m - np.array([0.0, 0.1, 0.0]))
    assert feet_errors(lower, truth)["toes_below_mm"] == pytest.approx(100.0, abs=10.0)


@pytest.mark.long
def test_both_ways_in_one_go_are_as_each_alone(embedded_motion, database):
    truth = sliced(embedded_motion["walking-02-energetic"], 0, 40)
    subject = true_subject(truth)
    take, _ = simulate_markers(truth, subject, 3.0, 0.1)
    ways = solve_both_ways(take, subject, database, SolveSettings())
    for way, causal in ((LIVE, True), (OFFLINE, False)):
        alone = solve_take(take, subject, database, SolveSettings(), no_progress, causal=causal).motion
        np.testing.assert_allclose(ways[way].motion.rotations, alone.rotations, atol=1e-12)
        expected = expected_of(ways[way].poses, truth)
        assert expected.parts.shape == (40, 10)
        assert np.isfinite(expected.joints[2:]).all()
