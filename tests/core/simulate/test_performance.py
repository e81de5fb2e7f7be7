"""Shipped performances: cut, repeated, mirrored, on other bodies."""

import numpy as np
import pytest
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import SettingsError
from perfanim.core.geometry import rotations as rot
from perfanim.core.simulate.shipped_performance import BEHAVIOURS, DEMO, T_POSE_S, load_performance, performance


def test_a_performer_who_moves_at_once_has_no_t_pose() -> None:
    whole, start = load_performance("boxing")
    for seconds in (None, 8.0):
        motion = performance("boxing", seconds, at_once=True)
        np.testing.assert_allclose(motion.root_positions_m[0], whole.root_positions_m[start], atol=1e-6)
        assert motion.frames == (481 if seconds else whole.frames - start)


@pytest.mark.parametrize("behaviour", [DEMO, *BEHAVIOURS])
def test_it_stands_in_the_t_pose_first(behaviour):
    motion, start = load_performance(behaviour)
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    held = positions[: round(0.8 * T_POSE_S * motion.fps)]
    for side in "lr":
        reach = held[:, motion.skeleton.index(f"{side}hand")] - held[:, motion.skeleton.index(f"{side}humerus")]
        assert np.all(np.abs(reach[:, 1]) < 0.15 * np.abs(reach[:, 0]))  # straight out
    assert motion.frames - start > 10 * motion.fps


def test_a_longer_one_repeats_the_behaviour_without_a_jump():
    shipped, start = load_performance("walking")
    motion = performance("walk", 60.0)
    assert motion.frames == 60 * 60 + 1
    assert np.array_equal(motion.rotations[: shipped.frames], shipped.rotations)
    again = shipped.frames + round(1.5 * 60) - 1
    assert np.array_equal(motion.rotations[again : again + 100], shipped.rotations[start : start + 100])
    turns = np.degrees(rot.angle_between(motion.rotations[1:], motion.rotations[:-1]))
    assert turns.max() <= 1.01 * np.degrees(rot.angle_between(shipped.rotations[1:], shipped.rotations[:-1])).max()


def test_another_rate_and_length():
    motion = performance("boxing", 8.0, 30.0)
    assert motion.fps == 30.0
    assert motion.duration_s == pytest.approx(8.0)


@pytest.mark.parametrize("mirrored", [False, True])
def test_feet_stay_on_the_floor_on_another_body(mirrored):
    skeleton = default_skeleton(1.6)
    motion = performance("walking", 10.0, skeleton=skeleton, mirrored=mirrored)
    shipped = performance("walking", 10.0)
    lowest = [
        forward_kinematics(m.skeleton, m.rotations, m.root_positions_m)[0][..., 1].min() for m in (motion, shipped)
    ]
    assert lowest[0] == pytest.approx(lowest[1] * 1.6 / 1.75, abs=1e-6)


def test_mirrored_it_leads_with_the_other_hand():
    plain, mirrored = performance("boxing", 8.0), performance("boxing", 8.0, mirrored=True)
    left, right = (plain.skeleton.index(name) for name in ("lhand", "rhand"))
    a = forward_kinematics(plain.skeleton, plain.rotations, plain.root_positions_m)[0]
    b = forward_kinematics(mirrored.skeleton, mirrored.rotations, mirrored.root_positions_m)[0]
    np.testing.assert_allclose(a[:, left] * [-1.0, 1.0, 1.0], b[:, right], atol=1e-6)


def test_unknown_and_too_short_are_refused():
    with pytest.raises(SettingsError, match="unknown behaviour 'flying'"):
        performance("flying")
    with pytest.raises(SettingsError, match="too short"):
        performance("walking", 2.0)


@pytest.mark.parametrize("seconds", [1e9, np.inf, np.nan])
def test_an_absurd_length_is_refused_before_memory_is_taken(seconds):
    with pytest.raises(SettingsError, match="too long; give 5 to 5000 s"):
        performance("walking", seconds)


@pytest.mark.parametrize("fps", [0.0, 1e6, np.inf, np.nan])
def test_a_rate_that_no_camera_has_is_refused(fps):
    with pytest.raises(SettingsError, match="frame rate"):
        performance("walking", fps=fps)
