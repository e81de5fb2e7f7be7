"""Keypoints of a person whom nobody measured: body, poses and confidence, with errors of centimetres."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.motion import sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.simulated_keypoints import KeypointErrors, simulate_keypoints
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.subjects.from_motion import subject_from_motion
from perfanim.core.subjects.keypoint_bones import sized_by_distances

FRAMES = 60


def third_differences_m(points_m):
    return float(np.sqrt(np.mean(np.sum(np.diff(points_m, 3, axis=0) ** 2, axis=-1))))


@pytest.fixture(scope="module")
def walk(embedded_motion):
    return sliced(embedded_motion["walking-02-energetic"], 0, FRAMES)


@pytest.fixture(scope="module")
def take(walk):
    return simulate_keypoints(walk, load_marker_set("halpe-26"), seed=4)


@pytest.fixture(scope="module")
def fitted(take, database):
    return subject_from_motion(take, Subject("walker", default_skeleton(1.6), load_marker_set("halpe-26")), database)


def test_distances_show_bones_without_poses(take, walk):
    start = Subject("walker", default_skeleton(1.95), load_marker_set("halpe-26"))
    hidden = take.positions_m.copy()
    hidden[:, take.names.index("RKnee")] = np.nan  # the other side shows them
    found = sized_by_distances(start, hidden).skeleton
    for name in ("ltibia", "rtibia", "lfoot", "lradius"):
        lengths = [np.linalg.norm(each.offsets_m[each.index(name)]) for each in (start.skeleton, walk.skeleton, found)]
        assert abs(lengths[2] - lengths[1]) < 0.5 * abs(lengths[0] - lengths[1]), name
    nothing = sized_by_distances(start, np.full_like(hidden, np.nan)).skeleton
    np.testing.assert_allclose(nothing.offsets_m, start.skeleton.offsets_m, atol=1e-12)


def test_bones_come_from_the_distances_of_joints(fitted, walk):
    for name in ("ltibia", "rtibia", "lfoot", "rfoot", "lradius"):
        found, true = (np.linalg.norm(each.offsets_m[each.index(name)]) for each in (fitted.skeleton, walk.skeleton))
        assert found == pytest.approx(true, rel=0.06), name
    sides = [np.linalg.norm(fitted.skeleton.offsets_m[fitted.skeleton.index(side + "tibia")]) for side in "lr"]
    assert sides[0] == pytest.approx(sides[1], rel=1e-6)


@pytest.mark.long
def test_a_calm_body_is_smoothed_more_than_a_moving_one(walk, database):
    still = replace(walk, rotations=walk.rotations[:1].repeat(FRAMES, 0), root_positions_m=0.0 * walk.root_positions_m)
    subject, shares = Subject("walker", walk.skeleton, load_marker_set("halpe-26")), []
    for motion in (walk, still):
        take = simulate_keypoints(motion, subject.marker_set, 5, KeypointErrors(slow_m=0.01, fast_m=0.002))
        solved = solve_take(take, subject, database, SolveSettings(), lambda *_: None).motion
        joints_m = forward_kinematics(solved.skeleton, solved.rotations, solved.root_positions_m)[0]
        shares.append(third_differences_m(joints_m) / third_differences_m(take.positions_m))
    assert shares[1] < 0.5 * shares[0]


@pytest.mark.parametrize("causal", [True, False])
def test_motion_is_calmer_and_nearer_than_the_points(fitted, take, walk, database, causal):
    solved = solve_take(take, fitted, database, SolveSettings(), lambda *_: None, causal=causal)
    ideal = load_marker_set("halpe-26").positions_on(walk.skeleton, walk.rotations, walk.root_positions_m)
    off_m = float(np.sqrt(np.mean(np.sum((take.positions_m - ideal) ** 2, axis=-1))))
    figures = evaluate(solved.motion, walk)
    assert figures["mpjpe_mm"] < 800.0 * off_m
    skeleton, motion = solved.motion.skeleton, solved.motion
    markers = fitted.marker_set.positions_on(skeleton, motion.rotations, motion.root_positions_m)
    assert third_differences_m(markers) < third_differences_m(take.positions_m) / 3.0
    assert np.mean([pose.confidence for pose in solved.poses_of()]) > 0.4
