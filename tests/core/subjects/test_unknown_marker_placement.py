"""Markers that no set knows, placed on the body by the motion of a take."""

from dataclasses import replace

import numpy as np
import perfanim
import pytest
from perfanim.core.body.calibration_poses import standing
from perfanim.core.body.motion import Motion, resampled, sliced
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.markers.label_matching import rename_labels
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.marker_selection import worn_in
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.subjects.unknown_marker_placement import place_markers
from perfanim.core.system.assets import MOTION

SUIT = load_marker_set("plug-in-gait")
ARM_MARKERS = [side + name for side in "LR" for name in ("UPA", "ELB", "FRM", "WRA", "WRB", "FIN")]
ARM = ("clavicle", "humerus", "radius", "wrist", "hand")


@pytest.fixture(scope="module")
def walker(truth):
    return Subject("walker", truth.skeleton, SUIT)


@pytest.fixture(scope="module")
def renamed(truth):
    """A walk whose arms and left knee have labels that no set knows, with a marker that is on no bone."""
    take = simulate_markers(sliced(truth, 0, 120), SUIT, noise_mm=1.0, seed=2)[0]
    new = {name: f"X{number}" for number, name in enumerate([*ARM_MARKERS, "LKNE"])}
    flying = np.cumsum(np.full((take.frames, 1, 3), 0.01), axis=1) + np.linspace(0.0, 3.0, take.frames)[:, None, None]
    positions = np.concatenate((take.positions_m, flying), axis=1)
    return rename_labels(replace(take, names=(*take.names, "fly"), positions_m=positions), new), new


@pytest.fixture(scope="module")
def placed(renamed, walker, database):
    return place_markers(renamed[0], walker, database)


def test_unknown_markers_are_placed_on_the_bones_that_carry_them(renamed, placed):
    markers = {marker.name: marker for marker in placed.marker_set.markers if marker.placed}
    assert set(markers) == set(renamed[1].values())  # and not the one that flies past
    for true_name, label in renamed[1].items():
        joint = markers[label].joint
        assert joint[0] == true_name[0].lower(), (true_name, joint)
        assert joint[1:] in (("femur", "tibia") if true_name == "LKNE" else ARM), (true_name, joint)


def test_the_verdict_names_the_limbs_that_only_placed_markers_hold(renamed, walker, database):
    told = perfanim.solve(renamed[0], walker, database, perfanim.SolveRequest("nearest", place_markers=True)).verdict
    held = "only markers placed from the motion determine the left arm, the right arm: check the labels"
    assert held in [reason.text for reason in told.reasons]


def test_markers_on_an_arm_lay_no_leg_that_has_none(truth, walker, database):
    legs = [marker.name for marker in SUIT.markers if marker.joint[1:] in ("femur", "tibia", "foot", "toes")]
    arms = {side + name: f"X{side}{name}" for side in "LR" for name in ("FRM", "WRA")}
    pose = standing(truth.skeleton)
    still = Motion("still", 60.0, truth.skeleton, np.tile(pose, (60, 1, 1)), np.tile([0.0, 1.0, 0.0], (60, 1)))
    take = simulate_markers(still, SUIT, noise_mm=1.0, seed=2)[0]
    upper = [i for i, name in enumerate(take.names) if name not in legs]
    names = tuple(take.names[i] for i in upper)
    take = rename_labels(replace(take, names=names, positions_m=take.positions_m[:, upper]), arms)
    found = place_markers(take, walker, database).marker_set.markers
    joints = {marker.name: marker.joint for marker in found if marker.placed}
    assert set(joints) == set(arms.values())
    assert all(joint[1:] in ARM for joint in joints.values())


def test_markers_that_are_rarely_seen_are_not_placed_and_do_not_disturb_the_others(renamed, walker, database):
    take, new = renamed
    positions = take.positions_m.copy()
    for name, shown in (("LUPA", [0]), ("LKNE", [5]), ("RFIN", [0, 1, 2])):
        hidden = ~np.isin(np.arange(take.frames), shown)
        positions[hidden, take.names.index(new[name])] = np.nan
    half = take.frames // 2
    positions[:half, take.names.index(new["RUPA"])] = np.nan
    positions[half:, take.names.index(new["RELB"])] = np.nan
    found = place_markers(replace(take, positions_m=positions), walker, database)
    names = {marker.name for marker in found.marker_set.markers if marker.placed}
    assert {new[name] for name in ("LELB", "LWRA", "RFRM", "RELB")} <= names
    assert not names & {new[name] for name in ("LUPA", "LKNE", "RFIN")}


def test_a_solve_with_placed_markers_finds_the_arms(renamed, walker, placed, truth, database):
    take = renamed[0]
    joints = [truth.skeleton.index(side + "wrist") for side in "lr"]
    true_m = forward_kinematics(truth.skeleton, truth.rotations[:120], truth.root_positions_m[:120])[0][:, joints]
    worn = worn_in(take, placed)
    motion = solve_take(take, worn, database, SolveSettings(), lambda fraction, text: None, causal=True).motion
    found_m = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0][:, joints]
    assert np.median(np.linalg.norm(found_m - true_m, axis=-1)) < 0.06


def test_a_take_without_unknown_markers_leaves_the_subject(renamed, walker, database):
    known = replace(renamed[0], names=tuple(f"{i}" for i in range(len(renamed[0].names))))
    assert place_markers(known, walker, database) is walker  # no torso: nothing can be placed
    own = [i for i, name in enumerate(renamed[0].names) if name in SUIT.names]
    only = replace(
        renamed[0], names=tuple(renamed[0].names[i] for i in own), positions_m=renamed[0].positions_m[:, own]
    )
    assert place_markers(only, walker, database) is walker


@pytest.mark.long
def test_arms_bent_at_the_side_of_a_runner_are_found_as_by_their_true_names(database):
    motion = sliced(resampled(read_motion(MOTION / "running-05-proud.bvh"), 30.0), 0, 60)
    off_m = np.random.default_rng(5).uniform(-0.015, 0.015, (len(SUIT), 3))
    take = simulate_markers(motion, SUIT.with_offsets(SUIT.offsets_m + off_m), noise_mm=1.0, seed=2)[0]
    under = {name: f"X{number}" for number, name in enumerate(ARM_MARKERS)}
    hands_m = []
    for named in (take, rename_labels(take, under)):
        solved = perfanim.solve(named, None, database).motion
        hands = [solved.skeleton.index(side + joint) for side in "lr" for joint in ("radius", "hand")]
        hands_m.append(forward_kinematics(solved.skeleton, solved.rotations, solved.root_positions_m)[0][:, hands])
    apart_m = np.linalg.norm(hands_m[1] - hands_m[0], axis=-1)
    assert np.median(apart_m, axis=0).max() < 0.03
