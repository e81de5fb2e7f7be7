"""Which limbs a suit's markers determine, and what is said about those that none determines."""

from dataclasses import replace

import numpy as np
import perfanim
import pytest
from perfanim.core.body.body_parts import PARTS
from perfanim.core.body.motion import sliced
from perfanim.core.body.scene_pose import DOUBTFUL
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.session.limb_coverage import doubted, near_limbs, open_limbs
from perfanim.core.session.solve_take import solve_take
from perfanim.core.session.verdict import ReasonKind
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.marker_selection import worn_in
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.progress import no_progress

QUICK = perfanim.SolveRequest("nearest", causal=True)
SUIT = load_marker_set("plug-in-gait")
ARM = ("LUPA", "LELB", "LFRM", "LWRA", "LWRB", "LFIN")


@pytest.fixture(scope="module")
def take(truth):
    return simulate_markers(sliced(truth, 0, 40), SUIT, noise_mm=1.0, seed=2)[0]


@pytest.fixture(scope="module")
def walker(truth):
    return Subject("walker", truth.skeleton, SUIT)


def renamed(take, labels):
    return replace(take, names=tuple(f"other {name}" if name in labels else name for name in take.names))


def test_a_limb_without_markers_beyond_its_hinge_is_open():
    worn = [name for name in SUIT.names if name not in ARM]
    assert open_limbs(SUIT, SUIT.names) == []
    assert open_limbs(SUIT, [*worn, "LFIN"]) == []
    assert open_limbs(SUIT, [*worn, "LUPA"]) == ["left arm"]
    legs = SUIT.worn([name for name in worn if not name.startswith("R")])
    assert open_limbs(legs, legs.names) == []  # the set itself leaves the arms to the database
    lower = [marker.name for marker in SUIT.markers if marker.joint == "root" or marker.joint[1:] in ("tibia", "foot")]
    assert open_limbs(SUIT, lower) == ["left arm", "right arm", "trunk"]


def test_an_open_limb_is_told_and_lowers_the_confidence(take, walker, database):
    whole = perfanim.solve(take, walker, database, QUICK)
    part = perfanim.solve(renamed(take, ARM), walker, database, QUICK)
    assert whole.report["coverage"] == f"{len(SUIT)} of {len(SUIT)} markers known"
    assert not any("no marker determines" in reason.text for reason in whole.verdict.reasons)
    assert (
        part.report["coverage"]
        == f"{len(SUIT) - 6} of {len(SUIT)} markers known, 6 left out; no marker determines the left arm"
    )
    told = [reason for reason in part.verdict.reasons if "no marker determines the left arm" in reason.text]
    assert [reason.kind for reason in told] == [ReasonKind.LIMB]
    worn = worn_in(renamed(take, ARM), walker)
    alone = solve_take(renamed(take, ARM), worn, database, SolveSettings("nearest"), no_progress, causal=True)
    assert part.summary()["confidence"] == pytest.approx(0.75 * alone.summary()["confidence"])  # one of four limbs
    live = solve_take(renamed(take, ARM), worn, database, SolveSettings(), no_progress, causal=True).poses_of()[-1]
    pose = doubted(live, ["left arm"])
    is_arm = np.array([part in ("left arm", "left hand") for part in PARTS])
    assert np.all(pose.part_confidences[is_arm] < DOUBTFUL)
    np.testing.assert_allclose(pose.part_confidences[~is_arm], live.part_confidences[~is_arm])
    assert pose.confidence < live.confidence
    assert pose.doubtful_parts == ["left arm", "left hand"]
    rows = {limb.limb: limb for limb in part.verdict.limbs}
    assert (rows["head"].markers, rows["head"].known, rows["head"].placed, rows["head"].left_out) == (5, 5, 0, 0)
    assert sum(limb.left_out for limb in rows.values()) == 6


def test_a_motion_whose_markers_were_guessed_is_not_called_good(take, walker, database):
    told = perfanim.solve(replace(take, is_guessed=True), walker, database, QUICK).verdict
    assert told.reasons[0].kind is ReasonKind.LABELS
    assert "the labels were recognised from the motion" in told.text


def test_a_limb_that_a_choice_of_markers_leaves_open_is_told(take, walker, database):
    chosen = tuple(name for name in SUIT.names if name not in ARM)
    solved = perfanim.solve(take, walker, database, replace(QUICK, markers=chosen))
    known = f"{len(chosen)} of {len(SUIT)} markers known"
    assert solved.report["coverage"] == f"{known}, {len(ARM)} left out; no marker determines the left arm"
    assert any("no marker determines the left arm" in reason.text for reason in solved.verdict.reasons)
    assert sum(limb.left_out for limb in solved.verdict.limbs) == len(ARM)


def test_unused_markers_count_for_the_nearest_limb(take, truth):
    motion = sliced(truth, 0, 40)
    columns = [take.names.index(name) for name in ("RTOE", "LWRA", "LFIN")]
    far = take.positions_m[:, columns[:1]] + 5.0
    points_m = np.concatenate((take.positions_m[:, columns], far), axis=1)
    assert near_limbs(motion, points_m) == {"right foot": 1, "left hand": 2}
    assert near_limbs(motion, points_m[:, :0]) == {}
