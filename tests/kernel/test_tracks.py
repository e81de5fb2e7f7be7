"""Tracks of markers and limits of rotation rates by the kernel are NumPy's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from perfanim.core.body.pose_slew_limit import PosesBefore, TurnLimits, limited_turns
from perfanim.core.geometry import rotations as rot
from perfanim.core.labelling.marker_tracks import Tracks, expected_markers, located_tracks
from two_bodies import assert_same, spoiled

SPECIAL = [None, np.nan, np.inf, -np.inf, 1e300, 1e-300, 0.0]


def tracks_of(generator: np.random.Generator, count: int, near_m: float) -> Tracks:
    """Tracks some of which are unknown, hidden for any time, or without a velocity."""
    positions_m = generator.normal(scale=near_m, size=(count, 3))
    velocities_m_s = generator.normal(scale=2.0, size=(count, 3))
    velocities_m_s[generator.random(count) < 0.2] = np.nan
    hidden_s = generator.choice([0.0, 0.0, 1 / 60, 0.09, 0.5, np.inf], count)
    positions_m[np.isinf(hidden_s)] = np.nan
    return Tracks(positions_m, velocities_m_s, hidden_s, *(generator.random((2, count)) < 0.7))


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.sampled_from([0, 1, 9, 60]),
    points=st.sampled_from([0, 1, 9, 80]),
    near_m=st.sampled_from([0.05, 1.0, 100.0]),
    elapsed_s=st.sampled_from([0.0, 1e-9, 1 / 60, 0.2]),
    special=st.sampled_from(SPECIAL),
    place=st.integers(0, 2000),
)
def test_any_tracks(
    seed: int, count: int, points: int, near_m: float, elapsed_s: float, special: float | None, place: int
) -> None:
    generator = np.random.default_rng(seed)
    tracks = tracks_of(generator, count, near_m)
    labels = np.full(points, -1)
    some = min(points, count) // 2 + min(points, count) % 2
    labels[generator.permutation(points)[:some]] = generator.permutation(count)[:some]
    points_m = generator.normal(scale=near_m, size=(points, 3))
    close = labels >= 0
    points_m[close] = np.where(
        generator.random((some, 1)) < 0.7,
        tracks.positions_m[labels[close]] + generator.normal(scale=0.02, size=(some, 3)),
        points_m[close],
    )
    torso, predicted_m = generator.random(count) < 0.5, generator.normal(size=(count, 3))
    for spoiled_field in (None, 0, 1, 2):
        changed = list(tracks)
        if spoiled_field is not None:
            changed[spoiled_field] = spoiled(changed[spoiled_field], special, place)
        assert_same(expected_markers, Tracks(*changed), torso, predicted_m, elapsed_s)
        assert_same(located_tracks, Tracks(*changed), points_m, labels, elapsed_s)
    assert_same(expected_markers, tracks, torso, spoiled(predicted_m, special, place), elapsed_s)
    assert_same(located_tracks, tracks, spoiled(points_m, special, place), labels, elapsed_s)


def test_a_label_without_a_marker_is_refused() -> None:
    tracks = tracks_of(np.random.default_rng(0), 3, 1.0)
    with pytest.raises(IndexError):
        located_tracks.compiled_body(tracks, np.zeros((2, 3)), np.array([0, 3]), 0.1)


@given(
    seed=st.integers(0, 2**32 - 1),
    joints=st.sampled_from([1, 2, 31]),
    markers=st.sampled_from([1, 9, 60]),
    turns=st.sampled_from([0, 4, 5]),
    rates=st.sampled_from([0.0, 0.02, 0.5]),
    held=st.booleans(),
    special=st.sampled_from(SPECIAL),
    place=st.integers(0, 2000),
)
def test_any_turns(
    seed: int, joints: int, markers: int, turns: int, rates: float, held: bool, special: float | None, place: int
) -> None:
    generator = np.random.default_rng(seed)
    rotations = rot.normalize(generator.normal(size=(joints, 4)))
    turn = rates * generator.normal(size=(joints, 3))
    raw = rot.multiply(rotations, rot.from_rotation_vector(-turn))
    shown = rot.multiply(raw, rot.from_rotation_vector(0.2 * rates * generator.normal(size=(joints, 3))))
    earlier = turn * generator.uniform(0.0, 1.2, size=(turns, joints, 1))
    usual, ways = generator.uniform(0.0, 0.1, joints), generator.uniform(0.0, 0.15, markers)
    shares = generator.uniform(size=(markers, joints)) * (generator.random((markers, joints)) < 0.5)
    values = rotations, raw, shown, earlier, usual, shares, ways
    for frames in (0.1, 0.5, 1.0, 2.0, 14.0):
        assert_same(limited_turns, frames, rotations, PosesBefore(*values[1:4]), TurnLimits(*values[4:]), held)
    for index in range(len(values)):
        changed = [spoiled(each, special, place) if n == index else each for n, each in enumerate(values)]
        assert_same(limited_turns, 1.0, changed[0], PosesBefore(*changed[1:4]), TurnLimits(*changed[4:]), held)
