"""Feet that stand: in one place between keys, on their toes, stepping where few examples stand, lifted as they step."""

import numpy as np
import pytest
from perfanim.core.sketch.stances import Foot, held_foot, lift_of, stances_of, toes_place

FPS = 30.0
FRAMES = 33
LENGTH_M = 0.14
KEYED = np.array([0, 16, 32])


def foot_through(ankles_m, keyed=KEYED, **kwargs):
    """Return a flat foot with keys at (K, 3), straight between them, toes ahead."""
    at = np.arange(FRAMES)
    ankle = np.column_stack([np.interp(at, keyed, axis) for axis in np.array(ankles_m).T])
    toes = ankle + np.array([0.0, -0.05, np.sqrt(LENGTH_M**2 - 0.05**2)])
    return Foot(ankle, toes, np.zeros_like(ankle), keyed, **kwargs)


def test_a_foot_stands_between_keys_of_one_place_whatever_the_examples_do():
    foot = foot_through([(0.0, 0.08, 0.0), (0.003, 0.08, 0.0), (0.0, 0.08, 0.003)])
    assert stances_of(foot, np.zeros(FRAMES), FPS) == [(0, FRAMES)]
    held = held_foot(foot, np.zeros(FRAMES), None, FPS)
    assert held.stands.all()
    assert np.ptp(held.toes_m, axis=0).max() < 0.003
    np.testing.assert_allclose(held.ankle_m[KEYED], foot.ankle_m[KEYED], atol=1e-9)


def test_a_raised_heel_turns_about_the_toes():
    raised = np.array([0.0, LENGTH_M * np.sin(0.9) + 0.03, LENGTH_M * (np.cos(0.365) - np.cos(0.9))])
    foot = foot_through([(0.0, 0.08, 0.0), raised, (0.0, 0.08, 0.0)])
    held = held_foot(foot, np.full(FRAMES, 0.6), None, FPS)
    assert held.stands.all()
    assert np.ptp(held.toes_m, axis=0).max() < 0.005
    np.testing.assert_allclose(held.ankle_m[KEYED], foot.ankle_m[KEYED], atol=1e-9)


@pytest.mark.parametrize("seldom", [5, 10])
def test_a_step_is_short_and_where_fewest_examples_stand(seldom):
    foot = foot_through([(0.0, 0.08, 0.0), (0.0, 0.08, 0.2), (0.0, 0.08, 0.2)])
    share = np.full(FRAMES, 0.4)
    share[seldom : seldom + 3] = 0.1
    held = held_foot(foot, share, None, FPS)
    moving = np.flatnonzero(~held.stands)
    np.testing.assert_array_equal(moving, np.arange(seldom, seldom + 3))
    assert np.ptp(held.toes_m[: moving[0]], axis=0).max() < 1e-6
    assert np.ptp(held.toes_m[moving[-1] + 1 :], axis=0).max() < 1e-6
    np.testing.assert_allclose(held.ankle_m[KEYED], foot.ankle_m[KEYED], atol=1e-9)


def test_a_step_lasts_as_long_as_no_example_stands():
    foot = foot_through([(0.0, 0.08, 0.0), (0.0, 0.08, 0.2), (0.0, 0.08, 0.2)])
    share = np.full(FRAMES, 0.9)
    share[6:14] = 0.0
    np.testing.assert_array_equal(np.flatnonzero(~held_foot(foot, share, None, FPS).stands), np.arange(6, 14))


def test_between_keys_strides_apart_a_foot_steps_when_the_motion_does():
    at, stood = np.arange(61), np.array([0, 15, 25, 38, 48, 60])
    ankle = np.column_stack((np.zeros(61), np.full(61, 0.08), np.interp(at, stood, (0.0, 0.0, 0.8, 0.8, 1.6, 1.6))))
    foot = Foot(ankle, ankle + np.array([0.0, -0.05, 0.13]), np.zeros_like(ankle), np.array([0, 60]))
    stances = stances_of(foot, np.full(61, 0.8), FPS)
    assert len(stances) == 3
    np.testing.assert_allclose(np.ravel(stances), stood + np.array([0, 1, 0, 1, 0, 1]), atol=1)
    small = Foot(0.2 * ankle, 0.2 * foot.toes_m, np.zeros_like(ankle), foot.keyed)
    assert len(stances_of(small, np.full(61, 0.8), FPS)) == 2  # one step is enough


def test_keys_of_the_toes_are_met_and_the_foot_keeps_its_length():
    foot = foot_through([(0.0, 0.08, 0.0), (0.0, 0.08, 0.3), (0.0, 0.08, 0.3)], by_toes=True)
    held = held_foot(foot, np.full(FRAMES, 0.4), None, FPS)
    np.testing.assert_allclose(held.toes_m[KEYED], foot.toes_m[KEYED], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(held.toes_m - held.ankle_m, axis=1), LENGTH_M, atol=1e-9)


def test_a_foot_without_keys_stands_on_the_floor_when_its_motion_does():
    foot = foot_through([(0.0, 0.1, 0.0)] * 3)
    foot = Foot(foot.ankle_m, foot.toes_m, foot.displacement_m, np.zeros(0, dtype=np.int64))
    share = np.where(np.arange(FRAMES) < 12, 1.0, 0.0)
    held = held_foot(foot, share, 0.025, FPS)
    np.testing.assert_array_equal(held.stands, share > 0.5)
    np.testing.assert_allclose(held.toes_m[:12, 1], 0.025)


def test_the_toes_place_is_a_foots_length_from_all_ankles():
    place = np.array([0.1, 0.03, 0.4])
    ways = np.array([(0.0, 1.0, -1.0), (0.0, 0.4, -1.0), (0.2, 0.8, -1.0)])
    ankles = place + LENGTH_M * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    found = toes_place(ankles, place + np.array([[0.0, 0.0, 0.01]] * 3), np.full(3, LENGTH_M))
    assert np.abs(np.linalg.norm(ankles - found, axis=1) - LENGTH_M).max() < 0.003
    assert np.linalg.norm(found - place) < 0.01


def test_a_stepping_foot_is_lifted_and_a_standing_or_keyed_one_is_not():
    at = np.arange(30)
    toes = np.column_stack((np.zeros(30), np.full(30, 0.02), np.interp(at, [8, 20], [0.0, 0.6])))
    places = np.where(((at <= 8) | (at >= 20))[:, None], toes, np.nan)
    keyed = np.array([0, 17, 29])
    up_m = lift_of(toes, places, keyed, FPS)
    fixed = np.isfinite(places[:, 0])
    fixed[keyed] = True
    assert (up_m[fixed] == 0.0).all()
    assert up_m[12:14].min() > 0.015
    assert up_m.max() < 0.03


def test_a_far_step_has_time():
    foot = foot_through([(0.0, 0.08, 0.0), (0.0, 0.08, 1.0), (0.0, 0.08, 1.0)])
    share = np.full(FRAMES, 0.9)
    share[8] = 0.0
    held = held_foot(foot, share, None, FPS)
    speeds = np.linalg.norm(np.diff(held.toes_m, axis=0), axis=1) * FPS
    assert held.stands[:4].all()
    assert held.stands[12:].all()
    assert speeds.max() < 8.0
