"""Takes solved and saved as scripts do it."""

from dataclasses import replace

import numpy as np
import perfanim
import pytest
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.labelling.up_axis import TURNS
from perfanim.core.markers.prop import Prop
from perfanim.core.session.capture_setup import CaptureSetup
from perfanim.core.session.solved_take import SolvedTake
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings

QUICK = perfanim.SolveRequest("nearest", causal=True)


@pytest.fixture(scope="module")
def take(truth, subject):
    return simulate_markers(truth, subject, noise_mm=1.0, seed=2)[0]


@pytest.fixture(scope="module")
def solved(take, subject, database):
    return perfanim.solve(take, subject, database, QUICK)


@pytest.mark.long
def test_a_performer_whom_nobody_measured_is_fitted(take, truth, database_file):
    lying = replace(take, positions_m=take.positions_m @ TURNS["z"])  # as most systems write them
    solved = perfanim.solve(lying, database=database_file)
    assert solved.verdict.is_good and solved.report["residual_mm"] < 10.0
    assert perfanim.evaluate(solved.motion, truth)["mpjpe_absolute_mm"] < 60.0
    with pytest.raises(perfanim.PerfanimError, match="tall"):
        perfanim.solve(replace(take, positions_m=1e-3 * take.positions_m), database=database_file)


def test_an_upright_take_keeps_its_axes(take, subject, database_file, truth):
    solved = perfanim.solve(replace(take, positions_m=take.positions_m @ TURNS["z"]), subject, database_file, QUICK)
    assert perfanim.evaluate(solved.motion, truth)["mpjpe_absolute_mm"] < 60.0
    upright = replace(take, positions_m=take.positions_m @ TURNS["z"], is_upright=True)
    lies = perfanim.solve(upright, subject, database_file, QUICK)
    assert np.ptp(lies.motion.root_positions_m[:, 1]) == pytest.approx(np.ptp(truth.root_positions_m[:, 2]), abs=0.05)


def test_a_marker_take_is_solved_with_the_starter_database(take, subject, solved, database_file, monkeypatch):
    monkeypatch.setattr("perfanim.core.api.solving.starter_database", lambda progress: database_file)
    again = perfanim.solve(take, subject, request=QUICK)
    np.testing.assert_array_equal(again.motion.rotations, solved.motion.rotations)


def test_database_is_opened_by_its_file(take, solved, subject, database_file):
    again = perfanim.solve(take, subject, database_file, QUICK)
    np.testing.assert_array_equal(again.motion.rotations, solved.motion.rotations)


def test_saved_take_is_solved_again_without_more_to_name(solved, tmp_path):
    solved.save(tmp_path / "walk.perftake")
    again = perfanim.solve(perfanim.load_recording(tmp_path / "walk.perftake"), request=QUICK)
    assert again.report["warnings"] == [] and again.report["method"] == "nearest"
    np.testing.assert_allclose(again.motion.rotations, solved.motion.rotations, atol=0.05)
    again.save(tmp_path / "again.perftake")
    assert read_take_file(tmp_path / "again.perftake").notes.name == f"{solved.motion.name} (nearest)"
    with pytest.raises(perfanim.PerfanimError, match=r"walk\.perftake: is an input and would be overwritten"):
        again.save(tmp_path / "walk.perftake")


def test_motion_is_saved_in_each_format(solved, tmp_path):
    for name in ("walk.bvh", "walk.angles.csv", "walk.vrma"):
        solved.save(tmp_path / name)
        assert (tmp_path / name).is_file()
    solved.save(tmp_path / "slow.bvh", rate_hz=10.0)
    assert perfanim.load_motion(tmp_path / "slow.bvh").fps == pytest.approx(10.0)
    with pytest.raises(perfanim.PerfanimError, match="does not have the extension of a motion file"):
        solved.save(tmp_path / "walk.txt")


def test_smoothing_and_held_feet_change_the_motion(take, solved, subject, database):
    calm = perfanim.solve(take, subject, database, perfanim.SolveRequest("nearest", causal=True, smooth_hz=3.0))
    held = perfanim.solve(take, subject, database, perfanim.SolveRequest("nearest", causal=True, feet="always"))
    jitter = [np.abs(np.diff(each.motion.root_positions_m, n=3, axis=0)).mean() for each in (calm, solved)]
    assert jitter[0] < 0.5 * jitter[1]
    assert not np.array_equal(held.motion.rotations, solved.motion.rotations)


def test_markers_that_are_not_used_measure_the_error(take, subject, database):
    used = [marker.name for marker in subject.marker_set.markers if marker.torso or marker.name == "LFOO"]
    few = perfanim.solve(take, subject, database, perfanim.SolveRequest("nearest", causal=True, markers=tuple(used)))
    assert few.report["used"] == used
    assert 1.0 < few.report["left_out_rms_mm"] < 300.0
    whole = perfanim.SolveRequest("nearest", causal=True, marker_count=len(subject.marker_set))
    assert np.isnan(perfanim.solve(take, subject, database, whole).report["left_out_rms_mm"])


def test_each_performer_and_prop_has_a_file_of_its_own(solved, subject, database):
    prop = Prop("the sword", ("a", "b", "c"), np.diag([0.2, 0.5, 0.9]), 0.0)
    twins = CaptureSetup(None, (subject, subject, subject), (prop,), database, SolveSettings())
    three = SolvedTake(solved.poses, solved.motions * 3, solved.seconds, solved.relabelled, setup=twins)
    assert [path.name for path in three.motion_paths("a/fight.bvh")] == [
        "fight.bvh", f"fight.{subject.name}-2.bvh", f"fight.{subject.name}-3.bvh"
    ]  # fmt: skip
    assert three.motion_paths("fight.angles.csv")[1].name == f"fight.{subject.name}-2.angles.csv"


def test_poses_without_their_markers_make_no_recorded_take(solved, tmp_path):
    bare = SolvedTake(solved.poses, solved.motions, solved.seconds, solved.relabelled)
    with pytest.raises(perfanim.PerfanimError, match="the markers of these poses are unknown"):
        bare.save(tmp_path / "walk.perftake")


@pytest.mark.parametrize("causal", [False, True])
def test_exchanged_labels_are_put_back_and_told_unless_trusted(take, subject, database, causal):
    positions = take.positions_m.copy()
    feet = [take.names.index(name) for name in ("LFOO", "RFOO")]
    positions[15:27, feet] = positions[15:27, feet[::-1]]
    faulty = replace(take, positions_m=positions)
    untouched, corrected, trusted = (
        perfanim.solve(each, subject, database, perfanim.SolveRequest("nearest", causal, trust_labels=trust))
        for each, trust in ((take, False), (faulty, False), (faulty, True))
    )
    np.testing.assert_array_equal(corrected.motion.rotations, untouched.motion.rotations)
    told = corrected.verdict_facts()["doubtful"]
    assert any("LFOO and RFOO" in each["reason"] and (each["first"], each["last"]) == (15, 26) for each in told)
    assert corrected.verdict.text == untouched.verdict.text
    assert any("LFOO and RFOO had each other's labels" in text for text in corrected.report["warnings"])
    assert untouched.corrected == trusted.corrected == ()
    assert not np.allclose(trusted.motion.rotations, untouched.motion.rotations)
